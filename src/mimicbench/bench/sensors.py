"""What the senses cost, per robot, in milliseconds of one core."""

import time
from collections.abc import Callable, Sequence

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.seeds import rng
from mimicbench.drawing.opengl import NoPictures
from mimicbench.objects.shape import SceneObject
from mimicbench.robots.description import Robot
from mimicbench.robots.rigs import HEAD_RIG, HEIGHT, PELVIS_RIG, WIDTH
from mimicbench.sensors.elevation import camera_map, down_map, map_from_depth
from mimicbench.sensors.heightmap import SMALL
from mimicbench.sensors.rays import ray_depth
from mimicbench.sensors.render import RigCameras
from mimicbench.sim.backends import make_physics
from mimicbench.sim.physics import Physics, RobotState
from mimicbench.sim.rows import Rows


def bench_senses(
    robot: Robot, objects: Sequence[SceneObject], seconds: float = 1.0, seed: int = 0, device: str = "cpu"
) -> dict[str, float]:
    """Measure the makers of elevation maps and the cameras' pictures.

    A robot stands 0.6 to 2 m from each object, and then, for the keys with `near`, on the object's middle, where every
    line of sight can meet it. Figures are processor time over all threads, and so those of one core however busy the
    machine is. What needs OpenGL is left out where there is none; where a graphics card draws, its own time does not
    count.

    Args:
        robot: The robot.
        objects: One or more objects; a few tens of them tell enough.
        seconds: How long each part is measured [s].
        seed: Of the robots' places.
        device: What computes the physics, and with it the rays.

    Returns:
        Milliseconds per robot. Maps: `map_down_ms` by rays straight down, `map_cameras_ms` by the rays of four pictures
        of 90 x 120, `map_rendered_ms` by four rendered depth images of 90 x 120, of which `render_depth_ms` is the
        drawing; for touch-points `map_down_touch_ms`, and `map_cameras_touch_ms` by the rays of one picture of 360 x
        480. Pictures: `ray_depth_ms`, four depth images of 90 x 120 by rays; `render_all_ms`, color, depth and
        segmentation of four cameras at 360 x 480.
    """
    count, random = len(objects), rng(seed, "bench", "senses")
    physics = make_physics(device, robot, objects, workers=1)
    around, distance = random.uniform(-np.pi, np.pi, count), random.uniform(0.6, 2.0, count)
    yaw = around + np.pi + random.uniform(-0.5, 0.5, count)
    joints = np.tile(robot.rest_pose, (count, 1))
    link_pos, link_quat = robot.forward_kinematics(np.zeros(3), rot.IDENTITY, np.array(robot.rest_pose))
    height = np.full(count, -robot.keypoint_pos("left_sole", link_pos, link_quat)[2])
    figures = {}
    rows, still = Rows.every(count, physics.device), np.stack([0 * yaw, 0 * yaw, height], -1)
    physics.reset(rows, RobotState.of(still, rot.from_yaw(yaw), joints, device=physics.device))
    figures["map_cameras_near_ms"] = _cost(lambda: camera_map(physics, None, *SMALL), count, seconds)
    away = np.stack([distance * np.cos(around), distance * np.sin(around), height], -1)
    physics.reset(rows, RobotState.of(away, rot.from_yaw(yaw), joints, device=physics.device))
    figures["map_cameras_ms"] = _cost(lambda: camera_map(physics, None, *SMALL), count, seconds)
    figures["map_cameras_touch_ms"] = _cost(
        lambda: camera_map(physics, None, HEIGHT, WIDTH, HEAD_RIG, 0.01), count, seconds
    )
    figures["map_down_ms"] = _cost(lambda: down_map(physics), count, seconds)
    figures["map_down_touch_ms"] = _cost(lambda: down_map(physics, cell=0.01), count, seconds)
    figures["ray_depth_ms"] = _cost(lambda: ray_depth(physics, None, *SMALL), count, seconds)
    return figures | _rendered(physics, seconds)


def _rendered(physics: Physics, seconds: float) -> dict[str, float]:
    """What needs OpenGL [ms]; nothing where there is none."""
    qpos, figures = physics.qpos().copy(), {}
    try:
        with RigCameras(physics.model(0), PELVIS_RIG, *SMALL, robot=False) as cameras:
            figures["render_depth_ms"] = _cost(lambda: cameras.look(qpos[0], color=False, labels=False), 1, seconds)
            figures["map_rendered_ms"] = _cost(
                lambda: map_from_depth(
                    cameras.look(qpos[0], color=False, labels=False).depth[None], qpos[:1, :3], qpos[:1, 3:7]
                ),
                1,
                seconds,
            )
        with RigCameras(physics.model(0), PELVIS_RIG) as cameras:
            figures["render_all_ms"] = _cost(lambda: cameras.look(qpos[0]), 1, seconds)
    except NoPictures:
        pass
    return figures


def _cost(work: Callable[[], object], robots: int, seconds: float) -> float:
    """Processor time of `work` per robot [ms], after one round to warm up."""
    work()
    rounds, started, until = 0, time.process_time(), time.perf_counter() + seconds
    while time.perf_counter() < until or not rounds:
        work()
        rounds += 1
    return 1e3 * (time.process_time() - started) / rounds / robots
