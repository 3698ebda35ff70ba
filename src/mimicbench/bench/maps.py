"""How many elevation maps a machine makes in a second, beside the physics of as many robots.

Maps and physics take turns, so that the share that a map has of a control step holds on a busy machine too. The
processor time of a map is that of all threads together, and holds as far as other work leaves the caches alone.
"""

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch

from mimicbench.core import rotations as rot
from mimicbench.core.seeds import rng
from mimicbench.objects.registry import make_object
from mimicbench.robots.registry import DEFAULT_ROBOT, ROBOTS
from mimicbench.sensors.elevation import ElevationMaps
from mimicbench.sensors.heightmap import MapView
from mimicbench.sim.backends import make_physics
from mimicbench.sim.physics import Physics, RobotState
from mimicbench.sim.rows import Rows
from mimicbench.tasks.registry import TASKS
from mimicbench.tasks.task import Task

_ROUNDS = 3
"""Turns of maps and physics at least."""


@dataclass(frozen=True)
class MapBenchConfig:
    """What to measure."""

    tasks: tuple[str, ...] = tuple(TASKS)
    """Whose objects, cameras and cells."""
    sizes: tuple[int, ...] = (64, 512, 4096)
    """Robots at once."""
    seconds: float = 2.0
    """How long each figure is measured [s]; three turns at least."""
    pool: int = 48
    """Objects of each task."""
    workers: int = 0
    """Threads; 0 for all processors."""
    device: str = "cpu"
    """What makes the maps, and the physics."""


@dataclass(frozen=True)
class MapRow:
    """One kind of map of one task at one size."""

    task: str
    eyes: str
    """`cameras`, or `rays` that go straight down."""
    robots: int
    maps_per_second: float
    core_ms: float
    """Processor time of a map over all threads [ms]; without meaning where a graphics card makes it."""
    physics_steps: float
    """Control steps of one robot's bare physics that take as long as a map."""


def bench_maps(config: MapBenchConfig, say: Callable[[str], None]) -> dict[str, Any]:
    """Measure both kinds of maps of all tasks at all sizes; everything as plain JSON values."""
    rows = []
    for name in config.tasks:
        for robots in config.sizes:
            rows += _bench_task(TASKS.get(name), robots, config, say)
    return {"config": asdict(config), "rows": [asdict(row) for row in rows]}


def _bench_task(task: Task, robots: int, config: MapBenchConfig, say: Callable[[str], None]) -> list[MapRow]:
    physics = _stand_around(task, robots, config)
    objects, target = physics.objects, physics.state().joint_pos.clone()
    qpos, (object_pos, object_quat) = physics.qpos(), physics.object_pose()
    poses = [
        torch.from_numpy(np.array(pose)).to(physics.device)
        for pose in (qpos[:, :3], qpos[:, 3:7], object_pos, object_quat)
    ]
    rows = []
    for eyes, rig in (("cameras", task.rig), ("rays", None)):
        maps = ElevationMaps(objects, MapView(rig, task.map_cell), physics.device, config.workers)
        turns = _take_turns(lambda maps=maps: maps.sample(*poses), lambda: physics.advance(target), config)
        wall, core, bare = (float(np.median(column)) / robots for column in zip(*turns, strict=True))
        share = float(np.median([a / b for a, _, b in turns]))
        rows.append(MapRow(task.name, eyes, robots, 1 / wall, 1e3 * core, share))
        say(
            f"{task.name}, {robots} robots, {eyes}: {1 / wall:.0f} maps per second, {1e3 * core:.3f} ms of a core "
            f"each, {share:.1f} control steps of physics ({1e6 * bare:.0f} us)"
        )
    return rows


def _take_turns(
    look: Callable[[], torch.Tensor], step: Callable[[], None], config: MapBenchConfig
) -> list[tuple[float, float, float]]:
    """Wall and processor time of a look, and wall time of a step [s], of each turn."""
    turns = []
    look()
    step()
    started = time.perf_counter()
    while time.perf_counter() - started < config.seconds or len(turns) < _ROUNDS:
        wall, core = time.perf_counter(), time.process_time()
        maps = look()
        if maps.is_cuda:
            torch.cuda.synchronize(maps.device)
        wall, core, begun = time.perf_counter() - wall, time.process_time() - core, time.perf_counter()
        step()
        turns.append((wall, core, time.perf_counter() - begun))
    return turns


def _stand_around(task: Task, robots: int, config: MapBenchConfig) -> Physics:
    """Robots 0.2 to 1.2 m from the rectangles around the task's objects, facing them."""
    robot, random = ROBOTS.get(DEFAULT_ROBOT), rng(0, "bench", "maps", task.name)
    pool = [make_object(f"{task.family}-0-{index:05d}") for index in range(min(config.pool, robots))]
    objects = [pool[n % len(pool)] for n in range(robots)]
    physics = make_physics(config.device, robot, objects, workers=config.workers)
    around = random.uniform(-np.pi, np.pi, robots)
    toward = np.stack([np.cos(around), np.sin(around)], -1)
    half = np.array([np.abs(obj.bounds()).max(0)[:2] for obj in objects])
    edge = (half / np.maximum(np.abs(toward), 1e-9)).min(-1)
    place = toward * (edge + random.uniform(0.2, 1.2, robots))[:, None]
    pos, quat = robot.forward_kinematics(np.zeros(3), rot.IDENTITY, np.array(robot.rest_pose))
    height = np.full(robots, -robot.keypoint_pos("left_sole", pos, quat)[2])
    yaw = around + np.pi + random.uniform(-0.5, 0.5, robots)
    rest = np.tile(robot.rest_pose, (robots, 1))
    state = RobotState.of(np.column_stack([place, height]), rot.from_yaw(yaw), rest, device=physics.device)
    physics.reset(Rows.every(robots, physics.device), state)
    return physics
