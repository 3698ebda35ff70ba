"""Senses: maps of scenes known in closed form, odometry, and that no label reaches a policy."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

import stool
from mimicbench.bench.sensors import bench_senses
from mimicbench.core import rotations as rot
from mimicbench.core.motion import RobotMotion
from mimicbench.drawing.opengl import NoPictures
from mimicbench.envs.clips import ClipSet
from mimicbench.envs.vec_env import EnvConfig
from mimicbench.evaluate.rollout import run_policy
from mimicbench.objects.families.chair import make_chair
from mimicbench.robots.rigs import HEAD_RIG, PELVIS_RIG
from mimicbench.sensors.cameras import CameraMaps
from mimicbench.sensors.elevation import camera_map, down_map, map_from_depth
from mimicbench.sensors.heightmap import CELL, box_heightmap, cell_centers
from mimicbench.sensors.proprioception import Odometry, body_state, gravity, s_current, s_current_names
from mimicbench.sensors.render import RigCameras
from mimicbench.sim.native import NativePhysics
from mimicbench.sim.physics import RobotState
from mimicbench.sim.rows import Rows
from mimicbench.tasks.sit_chair import TASK as SIT_CHAIR
from stool import H1, block, standing


def scene(obj, poses):
    """One robot per pose (x, y, yaw) beside the object."""
    physics = NativePhysics(H1, [obj] * len(poses), workers=1)
    poses = np.array(poses, float)
    (_, _, height), joints = standing()
    pos = np.column_stack([poses[:, :2], np.full(len(poses), height)])
    stool.put(physics, np.arange(len(poses)), pos, rot.from_yaw(poses[:, 2]), np.tile(joints, (len(poses), 1)))
    return physics, height


def test_map_of_a_stool():
    # 1.2 m ahead of the robot, 0.42 m high, +-0.25 m wide
    physics, height = scene(block(), [(-1.2, 0.0, 0.0)])
    found = down_map(physics)[0].numpy()
    x = cell_centers()
    stool = (abs(x - 1.2) < 0.25)[:, None] & (abs(x) < 0.25)[None, :]
    np.testing.assert_allclose(found, np.where(stool, 0.42 - height, -height), atol=1e-5)
    seen = camera_map(physics)[0].numpy()
    inner = (abs(x - 1.2) < 0.25 - CELL)[:, None] & (abs(x) < 0.25 - CELL)[None, :]
    top, floor = abs(seen - (0.42 - height)) < 1e-3, abs(seen + height) < 1e-3
    assert (top | floor)[inner].all() and top[inner].mean() > 0.5, "the seat, and cells between the rays"
    assert seen.max() < 0.42 - height + 1e-3 and seen.min() > -height - 1e-5
    outer = (abs(x - 1.2) < 0.25 + CELL)[:, None] & (abs(x) < 0.25 + CELL)[None, :]
    assert floor[~outer].all()


@pytest.mark.parametrize("see", [down_map, camera_map])
def test_a_map_turns_with_the_robot(see):
    physics, _ = scene(make_chair(1), [(-1.013, 0.307, 0.3 + k * np.pi / 2) for k in range(4)])
    maps = see(physics).numpy()
    for k in range(1, 4):
        assert (abs(maps[k] - np.rot90(maps[0], -k)) > 1e-4).mean() < 2e-3


@pytest.mark.parametrize("see", [down_map, camera_map])
def test_robot_and_chair_turned_together_look_the_same(see):
    chair, turn = make_chair(1), rot.from_yaw(np.array(0.8))
    turned = replace(chair, box_pos=rot.rotate(turn, chair.box_pos), box_quat=rot.multiply(turn, chair.box_quat))
    spot = rot.rotate(turn, np.array([-1.1, 0.2, 0.0]))
    first, second = see(scene(chair, [(-1.1, 0.2, 0.1)])[0]), see(scene(turned, [(*spot[:2], 0.9)])[0])
    assert (abs(first - second) > 1e-4).float().mean() < 2e-3


def test_down_map_is_the_exact_map():
    chair = make_chair(2)
    physics, height = scene(chair, [(-1.1, 0.3, 0.4)])
    exact = box_heightmap(chair, np.array([-1.1, 0.3, height]), 0.4)
    assert (abs(down_map(physics)[0].numpy() - exact) > 1e-4).mean() < 1e-3


def test_the_floor_stays_level_when_the_robot_leans():
    physics, height = scene(block(), [(-1.2, 0.0, 0.0)])
    lean = rot.multiply(rot.from_yaw(np.array(0.5)), rot.from_rotvec(np.array([0.1, 0.25, 0.0])))
    stool.put(physics, np.arange(1), np.array([[-1.2, 0, height]]), lean[None], np.array([H1.rest_pose]))
    seen = camera_map(physics)[0].numpy()
    assert abs(seen.min() + height) < 1e-4 and abs(seen.max() - (0.42 - height)) < 1e-3


def test_the_robots_own_body_is_not_in_its_map():
    physics, height = scene(block(), [(-3.5, 0.0, 0.0)])
    for see in (down_map, camera_map):
        np.testing.assert_allclose(see(physics)[0], -height, atol=1e-4)


def test_what_is_behind_the_back_of_a_chair_is_hidden_from_cameras_only():
    wall = replace(
        block(),
        box_pos=np.array([[-0.3, 0, 0.6], [0.1, 0, 0.1]]),
        box_half=np.array([[0.02, 0.8, 0.6], [0.1, 0.1, 0.1]]),
        box_quat=np.tile(rot.IDENTITY, (2, 1)),
        box_rgb=np.ones((2, 3)),
    )
    physics, height = scene(wall, [(-1.2, 0.0, 0.0)])
    box = abs(down_map(physics)[0] - (0.2 - height)) < 1e-3
    assert box.sum() >= 16 and not (camera_map(physics)[0][box] > -height + 0.01).any()


def test_some_robots_maps_are_those_of_all():
    physics, _ = scene(make_chair(1), [(-1.1, 0.1 * k, 0.2 * k) for k in range(3)])
    for see in (down_map, camera_map):
        assert torch.equal(see(physics, np.array([0, 2])), see(physics)[[0, 2]])


def test_maps_without_a_simulator_agree():
    chairs = [make_chair(0), make_chair(4)]
    poses = [(-1.3, 0.2, 0.1), (0.9, 1.1, -2.0), (1.4, -0.6, 2.5)]
    for i, chair in enumerate(chairs):
        physics, _ = scene(chair, poses)
        state = physics.state()
        quick = CameraMaps(chairs).sample(torch.full((3,), i), state.root_pos_w, state.root_quat_w)
        seen = camera_map(physics)
        raised = (seen > seen.amin() + 0.01).sum()
        assert (abs(quick - seen) > 1e-3).sum() < 0.03 * raised
        quick = CameraMaps(chairs, 120, 160, rig=HEAD_RIG, cell=0.02).sample(
            torch.full((3,), i), state.root_pos_w, state.root_quat_w
        )
        seen = camera_map(physics, None, 120, 160, HEAD_RIG, 0.02)
        assert (abs(quick - seen) > 1e-3).sum() <= 0.03 * (seen > seen.amin() + 0.01).sum()


def rendered_map(physics, env, rig, cell, height, width):
    """The map of one scene as the paper makes it."""
    qpos = physics.qpos()[env]
    try:
        with RigCameras(physics.model(env), rig, height, width, robot=False) as cameras:
            depth = cameras.look(qpos, color=False, labels=False).depth
    except NoPictures as error:
        pytest.skip(str(error))
    return map_from_depth(depth[None], qpos[None, :3], qpos[None, 3:7], rig, cell)[0]


@pytest.mark.parametrize(
    ("rig", "cell", "height", "width"),
    [(PELVIS_RIG, 0.04, 90, 120), (HEAD_RIG, 0.01, 180, 240), (HEAD_RIG, 0.04, 90, 120)],
)
def test_rendered_depth_and_rays_make_the_same_map(rig, cell, height, width):
    """Of the cells that either raises above the floor, 99 % are within 1 cm; of all cells, 99.99 %."""
    within, raised = [], []
    for chair, pose in (
        (make_chair(0), (-0.7, 0.1, 0.1)),
        (make_chair(4), (0.5, 0.5, -2.2)),
        (block(), (0.6, 0.1, 3.0)),
    ):
        physics, height_w = scene(chair, [pose])
        lean = rot.multiply(rot.from_yaw(np.array([pose[2]])), rot.from_rotvec(np.array([[0.05, 0.15, 0.0]])))
        stool.put(physics, np.arange(1), np.array([[*pose[:2], height_w]]), lean, np.array([H1.rest_pose]))
        by_rays = camera_map(physics, None, height, width, rig, cell)[0]
        drawn = rendered_map(physics, 0, rig, cell, height, width)
        within.append((abs(by_rays - drawn) < 0.01).numpy())
        raised.append((torch.maximum(by_rays, drawn) > -height_w + 0.01).numpy())
    within, raised = np.array(within), np.array(raised)
    assert raised.sum() > 200 and within[raised].mean() > 0.99 and within.mean() > 0.9999


def test_rendered_map_of_a_stool():
    # 1.2 m ahead, 0.42 m high, +-0.25 m wide; at 360 x 480 no cell of its top lies between the pixels
    physics, height = scene(block(), [(-1.2, 0.0, 0.0)])
    seen = rendered_map(physics, 0, PELVIS_RIG, CELL, 360, 480).numpy()
    x = cell_centers()
    inner = (abs(x - 1.2) < 0.25 - CELL)[:, None] & (abs(x) < 0.25 - CELL)[None, :]
    outer = (abs(x - 1.2) < 0.25 + CELL)[:, None] & (abs(x) < 0.25 + CELL)[None, :]
    np.testing.assert_allclose(seen[inner], 0.42 - height, atol=1e-3)
    np.testing.assert_allclose(seen[~outer], -height, atol=1e-3)


def test_depth_beyond_6_meters_is_left_out():
    depth, upright = np.full((1, 1, 3, 3), 1.2), rot.IDENTITY[None]
    root = np.array([[0.0, 0.0, 1.0]])
    near = map_from_depth(depth, root, upright, HEAD_RIG)
    # the middle pixel: 0.15 + 1.2 cos 55 = 0.838 m ahead, 0.55 - 1.2 sin 55 = -0.433 m high: row 64 + 20, column 64
    assert near[0, 84, 64] == pytest.approx(-0.433, abs=1e-3)
    assert (map_from_depth(depth + 5, root, upright, HEAD_RIG) == -1).all()


def test_maps_of_touch_points_are_finer():
    # a shelf board of 30 x 40 cm, 1.2 m high and 20 cm ahead of the robot: 30 rows and 40 columns of 1 cm
    board = replace(block(), box_pos=np.array([[0.15, 0, 1.19]]), box_half=np.array([[0.15, 0.2, 0.01]]))
    physics, height = scene(board, [(-0.2, 0.0, 0.0)])
    found = down_map(physics, cell=0.01)[0].numpy()
    x = cell_centers(cell=0.01)
    expected = (abs(x - 0.35) < 0.15)[:, None] & (abs(x) < 0.2)[None, :]
    assert expected.sum() == 1200
    np.testing.assert_allclose(found, np.where(expected, 1.2 - height, -height), atol=1e-5)
    seen = camera_map(physics, None, 360, 480, HEAD_RIG, 0.01)[0].numpy()
    assert (abs(seen[expected] - (1.2 - height)) < 1e-3).mean() > 0.95 and (
        seen[~expected] < -height + 1e-3
    ).mean() > 0.99


def test_fine_maps_are_made_from_the_papers_pictures():
    physics, _ = scene(block(), [(-0.5, 0.0, 0.0)])
    assert torch.equal(
        camera_map(physics, rig=HEAD_RIG, cell=0.01), camera_map(physics, None, 360, 480, HEAD_RIG, 0.01)
    )
    assert torch.equal(camera_map(physics), camera_map(physics, None, 90, 120))


def test_a_moved_box_is_where_it_is():
    box = block(movable=True, mass=2.0)
    physics, height = scene(box, [(-1.2, 0.0, 0.0), (-1.2, 0.0, 0.0)])
    # moved by 0.4 m to the left, turned by 90 degrees and lifted by 0.3 m
    physics.qpos()[1, -7:] = [0.0, 0.4, 0.3, np.sqrt(0.5), 0, 0, np.sqrt(0.5)]
    x = cell_centers()
    for see in (down_map, camera_map):
        found = see(physics).numpy()
        for env, (side, lift) in enumerate([(0.0, 0.0), (0.4, 0.3)]):
            inner = (abs(x - 1.2) < 0.2)[:, None] & (abs(x - side) < 0.2)[None, :]
            outer = (abs(x - 1.2) < 0.3)[:, None] & (abs(x - side) < 0.3)[None, :]
            assert found[env][inner].max() == pytest.approx(0.42 + lift - height, abs=1e-4)
            assert (abs(found[env][inner] - (0.42 + lift - height)) < 1e-3).mean() > 0.5
            assert (found[env][~outer] < -height + 1e-4).all()


def test_convex_pieces_are_seen_as_they_are():
    # a wedge that fills the lower half of its box, from the floor at the robot's side up to 0.6 m
    corners = np.array([(x, y, z) for y in (-0.3, 0.3) for x, z in ((-0.3, 0.0), (0.3, 0.0), (0.3, 0.6))])
    wedge = replace(block(), box_pos=np.array([[0, 0, 0.3]]), box_half=np.array([[0.3, 0.3, 0.3]]), hulls=(corners,))
    physics, height = scene(wedge, [(-1.0, 0.0, 0.0)])
    x = cell_centers()
    ramp = (abs(x - 1.0) < 0.28)[:, None] & (abs(x) < 0.28)[None, :]
    expected = np.broadcast_to((x - 0.7 - height)[:, None], ramp.shape)
    np.testing.assert_allclose(down_map(physics)[0].numpy()[ramp], expected[ramp], atol=1e-5)
    for seen in (camera_map(physics)[0].numpy(), rendered_map(physics, 0, PELVIS_RIG, CELL, 90, 120).numpy()):
        hit = ramp & (seen > -height + 0.01)
        assert hit.sum() > 50 and (abs(seen - expected)[hit] <= CELL / 2 + 1e-4).all()


@settings(max_examples=6, deadline=None)
@given(st.floats(-3, 3), st.floats(0.7, 1.8), st.floats(-3, 3), st.sampled_from([down_map, camera_map]))
def test_any_turn_of_robot_and_scene_together_changes_nothing(turn, distance, bearing, see):
    chair, quat = make_chair(1), rot.from_yaw(np.array(turn))
    turned = replace(chair, box_pos=rot.rotate(quat, chair.box_pos), box_quat=rot.multiply(quat, chair.box_quat))
    x, y = distance * np.cos(bearing), distance * np.sin(bearing)
    a, b = distance * np.cos(bearing + turn), distance * np.sin(bearing + turn)
    first, second = see(scene(chair, [(x, y, bearing + 2.5)])[0]), see(scene(turned, [(a, b, bearing + 2.5 + turn)])[0])
    assert (abs(first - second) > 1e-3).float().mean() < 2e-3


def test_a_rendered_map_turns_with_the_robot():
    # the four cameras are alike, so a quarter turn lets each see what its neighbor saw
    physics, _ = scene(make_chair(1), [(-1.013, 0.307, 0.3 + k * np.pi / 2) for k in range(2)])
    still, turned = (rendered_map(physics, env, PELVIS_RIG, CELL, 90, 120).numpy() for env in range(2))
    assert (abs(turned - np.rot90(still, -1)) > 1e-3).mean() < 2e-3


def test_bench_measures_every_maker():
    figures = bench_senses(H1, [block()], seconds=0.01)
    assert {"map_down_ms", "map_cameras_ms", "map_cameras_near_ms"} <= set(figures) and all(
        value > 0 for value in figures.values()
    )


def test_proprioception():
    physics, height = scene(block(), [(-1.2, 0.4, 0.7)])
    stool.put(
        physics,
        np.arange(1),
        np.array([[-1.2, 0.4, height]]),
        rot.from_yaw(np.array([0.7])),
        np.array([H1.rest_pose]),
        np.array([[0.0, 1.0, 0.2]]),
        np.array([[0.1, 0.2, 0.3]]),
        np.full((1, 19), 0.5),
    )
    state, links = physics.state(), physics.links()
    body = body_state(state)[0]
    assert body.shape == (48,)
    np.testing.assert_allclose(body[:3], [0, 0, -1], atol=1e-6)
    assert body[3] == pytest.approx(height, abs=1e-6)
    np.testing.assert_allclose(body[4:7], [np.sin(0.7), np.cos(0.7), 0.2], atol=1e-6)
    np.testing.assert_allclose(body[7:10], [0.1, 0.2, 0.3], atol=1e-6)
    np.testing.assert_allclose(body[10:29], H1.rest_pose, atol=1e-6)
    np.testing.assert_allclose(body[29:], 0.5, atol=1e-6)
    current = s_current(state, links, torch.full((1, 19), 0.25))[0]
    assert current.shape == (300,)
    np.testing.assert_allclose(current[:19], H1.rest_pose, atol=1e-6)
    positions, turns = current[38:98].reshape(20, 3), current[98:158].reshape(20, 3)
    np.testing.assert_allclose(positions[0], 0, atol=1e-6)
    np.testing.assert_allclose(turns[[0, 11]], 0, atol=1e-6)
    pos, _ = H1.forward_kinematics(np.zeros(3), rot.IDENTITY, np.array(H1.rest_pose))
    np.testing.assert_allclose(positions, pos, atol=1e-5)
    np.testing.assert_allclose(current[158:161], body[4:7], atol=1e-5)
    np.testing.assert_allclose(current[218:221], body[7:10], atol=1e-5)
    assert (current[278:297] == 0.25).all()
    np.testing.assert_allclose(current[297:], gravity(state)[0])
    named = dict(zip(s_current_names(H1), current.tolist(), strict=True))
    assert len(named) == 300
    assert named["left_knee_joint.pos"] == pytest.approx(H1.rest_pose[H1.joint_names.index("left_knee_joint")])
    assert named["left_knee_joint.vel"] == pytest.approx(0.5) and named["left_knee_joint.last_action"] == 0.25
    knee = [link.name for link in H1.links].index("left_knee_link")
    assert [named[f"left_knee_link.pos.{axis}"] for axis in "xyz"] == pytest.approx(pos[knee].tolist(), abs=1e-5)
    assert named["pelvis.ang_vel.z"] == pytest.approx(0.3) and named["gravity.z"] == pytest.approx(-1)


def walk(t):
    """A robot on a spiral that turns around itself more than twice."""
    t = torch.as_tensor(t, dtype=torch.float32)[None]
    yaw, speed = 1.0 + 1.5 * t, 0.4 + 0.05 * t
    heading = torch.stack([torch.cos(yaw), torch.sin(yaw)], -1)
    integral = torch.stack(
        [
            speed * torch.sin(yaw) / 1.5 + 0.05 * torch.cos(yaw) / 2.25,
            -speed * torch.cos(yaw) / 1.5 + 0.05 * torch.sin(yaw) / 2.25,
        ],
        -1,
    )
    zero = torch.zeros(1, 1)
    return RobotState(
        torch.cat([integral, zero + 1], -1),
        rot.from_yaw(yaw),
        torch.cat([speed[:, None] * heading, zero], -1),
        torch.zeros(1, 3),
        torch.zeros(1, 19),
        torch.zeros(1, 19),
    )


def test_odometry_is_the_truth_on_a_known_path():
    odometry, start, dt = Odometry(1), walk(0.0), 0.02
    odometry.reset(Rows.every(1), start)
    for step in range(1, 500):
        now = walk(step * dt)
        odometry.update(now, dt)
        truth = rot.rotate_inverse(start.root_quat_w, now.root_pos_w - start.root_pos_w)[:, :2]
        np.testing.assert_allclose(odometry.pos, truth, atol=2e-3)
        assert odometry.yaw[0] == pytest.approx(1.5 * step * dt, abs=1e-3), "over all turns, not only the last"
    odometry.reset(Rows.every(1), now)
    assert odometry.pos.tolist() == [[0, 0]] and odometry.yaw.tolist() == [0]


def test_odometry_under_physics():
    physics, _ = scene(block(), [(-2.5, 0.0, 0.9), (-2.5, 1.0, -2.0)])
    odometry, start = Odometry(2), physics.state()
    odometry.reset(Rows.every(2), start)
    for step in range(40):
        if step % 10 == 0:
            physics.push(torch.tensor([[0.3, 0.1, 0], [-0.2, 0.2, 0]]))
        physics.step(start.joint_pos)
        odometry.update(physics.state(), 0.02)
    now = physics.state()
    truth = rot.rotate_inverse(rot.from_yaw(rot.yaw_of(start.root_quat_w)), now.root_pos_w - start.root_pos_w)[:, :2]
    assert truth.norm(dim=-1).min() > 0.05
    np.testing.assert_allclose(odometry.pos, truth, atol=0.02)


class Recorder:
    """A policy that stands still and keeps all that it observes."""

    gains = "improved"

    def __init__(self, eyes):
        self.observations, self.seen = ("proprio", "state", "time", "odometry", eyes), []

    def to(self, device):
        assert device == "cpu"

    def reset(self, ids, obs):
        self.target = torch.tensor(H1.rest_pose).expand(len(ids), 19)

    def act(self, obs):
        self.seen.append([obs[name].numpy().copy() for name in self.observations])
        return self.target


@pytest.mark.parametrize("eyes", ["elevation", "heightmap"])
def test_no_label_reaches_a_policy(eyes):
    """At evaluation a policy senses the same wherever the chair says that its seat is, and something else when its
    shape moves.
    """
    chairs = [make_chair(0), make_chair(7)]
    pos, joints = standing()
    starts = [
        RobotMotion(
            f"start-{i}",
            "sit-chair",
            "h1",
            H1.joint_names,
            50.0,
            np.tile(pos + [0, 0.2 * i, 0], (3, 1)),
            np.tile(rot.IDENTITY, (3, 1)),
            np.tile(joints, (3, 1)),
            chair.id,
            f"start-{i}",
        )
        for i, chair in enumerate(chairs)
    ]
    task = replace(SIT_CHAIR, time_limit=0.1)

    def sensed(objects):
        policy = Recorder(eyes)
        run_policy(policy, ClipSet(task, H1, starts, {obj.id: obj for obj in objects}), env_config=EnvConfig(workers=1))
        assert len(policy.seen) == 5
        return policy.seen

    honest = sensed(chairs)
    moved_labels = [
        replace(
            c, seat_height=c.seat_height + 0.2, seat_polygon=c.seat_polygon + 0.5, kind="sofa", family="sofa", mass=3.0
        )
        for c in chairs
    ]
    for step, (told, lied) in enumerate(zip(honest, sensed(moved_labels), strict=True)):
        for one, other in zip(told, lied, strict=True):
            np.testing.assert_array_equal(one, other, err_msg=f"step {step}")
    moved_shapes = sensed([replace(c, box_pos=c.box_pos + [0.2, 0.1, 0]) for c in chairs])
    assert (honest[0][-1] != moved_shapes[0][-1]).any(), "but the map shows the shape"
    for one, other in zip(honest[0][:-1], moved_shapes[0][:-1], strict=True):
        np.testing.assert_array_equal(one, other)
