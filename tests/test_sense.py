"""Senses: where the cameras look, maps of scenes known in closed form, odometry, and that no label reaches a policy."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from mimicbench.core import rotations as rot
from mimicbench.core.motion import RobotMotion
from mimicbench.evaluate.rollout import run_policy
from mimicbench.objects.chairs import make_chair
from mimicbench.sense.cameras import CameraMaps
from mimicbench.sense.elevation import BEARINGS, PITCH, camera_map, camera_rays, down_map
from mimicbench.sense.heightmap import CELL, box_heightmap, cell_centers
from mimicbench.sense.proprioception import Odometry, body_state, gravity, s_current
from mimicbench.sim.native import NativePhysics
from mimicbench.sim.physics import RobotState
from mimicbench.tasks.sit_chair import SIT_CHAIR
from stool import H1, block, standing


@pytest.mark.parametrize(("camera", "yaw"), [(0, -45), (1, 45), (2, 135), (3, -135)])
def test_where_cameras_look(camera, yaw):
    # right front, left front, left back, right back; 35 degrees down (appendix C.2)
    middle = camera_rays(3, 3).reshape(4, 3, 3, 3)[camera, 1, 1]
    yaw, pitch = np.deg2rad(yaw), np.deg2rad(35)
    np.testing.assert_allclose(middle, [np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), -np.sin(pitch)], atol=1e-12)


def test_pictures_are_upright_and_wide():
    rays = camera_rays(90, 120).reshape(4, 90, 120, 3)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=-1), 1, atol=1e-12)
    for camera, bearing in enumerate(BEARINGS):
        frame = rot.multiply(rot.from_yaw(bearing), rot.from_rotvec(np.array([0.0, PITCH, 0.0])))
        local = rot.rotate_inverse(frame, rays[camera])
        assert (np.diff(local[:, 60, 2] / local[:, 60, 0]) < 0).all(), "rows go down"
        assert (np.diff(local[45, :, 1] / local[45, :, 0]) < 0).all(), "columns go right"
        # the outer edges of the outer pixels are 120 degrees apart
        half = np.arctan(abs(local[45, [0, -1], 1] / local[45, [0, -1], 0]) * 120 / 119)
        np.testing.assert_allclose(np.rad2deg(half), 60, atol=1e-9)


def scene(obj, poses):
    """One robot per pose (x, y, yaw) beside the object."""
    physics = NativePhysics(H1, [obj] * len(poses), workers=1)
    poses = np.array(poses, float)
    (_, _, height), joints = standing()
    pos = np.column_stack([poses[:, :2], np.full(len(poses), height)])
    physics.reset(np.arange(len(poses)), pos, rot.from_yaw(poses[:, 2]), np.tile(joints, (len(poses), 1)))
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
    physics.reset(np.arange(1), np.array([[-1.2, 0, height]]), lean[None], np.array([H1.rest_pose]))
    seen = camera_map(physics)[0].numpy()
    assert abs(seen.min() + height) < 1e-4 and abs(seen.max() - (0.42 - height)) < 1e-3


def test_the_robots_own_body_is_not_in_its_map():
    physics, height = scene(block(), [(-3.5, 0.0, 0.0)])
    for see in (down_map, camera_map):
        np.testing.assert_allclose(see(physics)[0], -height, atol=1e-4)


def test_what_is_behind_the_back_of_a_chair_is_hidden_from_cameras_only():
    wall = replace(block(), box_pos=np.array([[-0.3, 0, 0.6], [0.1, 0, 0.1]]), box_half=np.array([[0.02, 0.8, 0.6], [0.1, 0.1, 0.1]]),
                   box_quat=np.tile(rot.IDENTITY, (2, 1)), box_rgb=np.ones((2, 3)))  # fmt: skip
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


def test_proprioception():
    physics, height = scene(block(), [(-1.2, 0.4, 0.7)])
    physics.reset(np.arange(1), np.array([[-1.2, 0.4, height]]), rot.from_yaw(np.array([0.7])), np.array([H1.rest_pose]), np.array([[0.0, 1.0, 0.2]]),
                  np.array([[0.1, 0.2, 0.3]]), np.full((1, 19), 0.5))  # fmt: skip
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


def walk(t):
    """A robot on a spiral that turns around itself more than twice."""
    t = torch.as_tensor(t, dtype=torch.float32)[None]
    yaw, speed = 1.0 + 1.5 * t, 0.4 + 0.05 * t
    heading = torch.stack([torch.cos(yaw), torch.sin(yaw)], -1)
    integral = torch.stack([speed * torch.sin(yaw) / 1.5 + 0.05 * torch.cos(yaw) / 2.25, -speed * torch.cos(yaw) / 1.5 + 0.05 * torch.sin(yaw) / 2.25], -1)
    zero = torch.zeros(1, 1)
    return RobotState(torch.cat([integral, zero + 1], -1), rot.from_yaw(yaw), torch.cat([speed[:, None] * heading, zero], -1), torch.zeros(1, 3),
                      torch.zeros(1, 19), torch.zeros(1, 19))  # fmt: skip


def test_odometry_is_the_truth_on_a_known_path():
    odometry, start, dt = Odometry(1), walk(0.0), 0.02
    odometry.reset(torch.arange(1), start)
    for step in range(1, 500):
        now = walk(step * dt)
        odometry.update(now, dt)
        truth = rot.rotate_inverse(start.root_quat_w, now.root_pos_w - start.root_pos_w)[:, :2]
        np.testing.assert_allclose(odometry.pos, truth, atol=2e-3)
        assert odometry.yaw[0] == pytest.approx(1.5 * step * dt, abs=1e-3), "over all turns, not only the last"
    odometry.reset(torch.arange(1), now)
    assert odometry.pos.tolist() == [[0, 0]] and odometry.yaw.tolist() == [0]


def test_odometry_under_physics():
    physics, _ = scene(block(), [(-2.5, 0.0, 0.9), (-2.5, 1.0, -2.0)])
    odometry, start = Odometry(2), physics.state()
    odometry.reset(torch.arange(2), start)
    for step in range(40):
        if step % 10 == 0:
            physics.push(np.arange(2), np.array([[0.3, 0.1, 0], [-0.2, 0.2, 0]]))
        physics.step(start.joint_pos)
        odometry.update(physics.state(), 0.02)
    now = physics.state()
    truth = rot.rotate_inverse(rot.from_yaw(rot.yaw_of(start.root_quat_w)), now.root_pos_w - start.root_pos_w)[:, :2]
    assert truth.norm(dim=-1).min() > 0.05
    np.testing.assert_allclose(odometry.pos, truth, atol=0.02)


class Recorder:
    """A policy that stands still and keeps all that it senses."""

    gains = "improved"

    def __init__(self, eyes):
        self.eyes, self.seen = eyes, []

    def reset(self, ids, senses):
        self.target = torch.tensor(H1.rest_pose).expand(len(ids), 19)

    def act(self, senses):
        numbers = [value for name, value in vars(senses).items() if name != "elevation"]
        self.seen.append([part.numpy().copy() for part in (*numbers, senses.root_height, senses.elevation(torch.arange(len(senses.time))))])
        return self.target


@pytest.mark.parametrize("eyes", ["cameras", "rays"])
def test_no_label_reaches_a_policy(eyes):
    """At evaluation a policy senses the same wherever the chair says that its seat is, and something else when its shape moves."""
    chairs = [make_chair(0), make_chair(7)]
    pos, joints = standing()
    starts = [
        RobotMotion(f"start-{i}", "sit-chair", "h1", H1.joint_names, 50.0, np.tile(pos + [0, 0.2 * i, 0], (3, 1)), np.tile(rot.IDENTITY, (3, 1)),
                    np.tile(joints, (3, 1)), chair.id, f"start-{i}") for i, chair in enumerate(chairs)
    ]  # fmt: skip
    task = replace(SIT_CHAIR, time_limit=0.1)

    def sensed(objects):
        policy = Recorder(eyes)
        run_policy(policy, H1, task, starts, {obj.id: obj for obj in objects}, "improved", workers=1)
        assert len(policy.seen) == 5
        return policy.seen

    honest = sensed(chairs)
    moved_labels = [replace(c, seat_height=c.seat_height + 0.2, seat_polygon=c.seat_polygon + 0.5, kind="sofa", family="sofa", mass=3.0) for c in chairs]
    for step, (told, lied) in enumerate(zip(honest, sensed(moved_labels), strict=True)):
        for one, other in zip(told, lied, strict=True):
            np.testing.assert_array_equal(one, other, err_msg=f"step {step}")
    moved_shapes = sensed([replace(c, box_pos=c.box_pos + [0.2, 0.1, 0]) for c in chairs])
    assert (honest[0][-1] != moved_shapes[0][-1]).any(), "but the map shows the shape"
    for one, other in zip(honest[0][:-1], moved_shapes[0][:-1], strict=True):
        np.testing.assert_array_equal(one, other)
