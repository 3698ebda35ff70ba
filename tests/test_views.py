"""Color and depth as networks see them: depth by rays, colors by hand, what is learned from is what is observed."""

import numpy as np
import pytest
import torch

from learning import ONE, ROBOT, clip_of
from mimicbench.core import rotations as rot
from mimicbench.envs.clip_starts import ClipStarts
from mimicbench.envs.reference import ReferenceBank
from mimicbench.envs.vec_env import VecEnv
from mimicbench.imitate.settings.inputs import InputConfig
from mimicbench.objects.registry import FAMILIES
from mimicbench.robots.rigs import HEAD_RIG, PELVIS_RIG
from mimicbench.sensors.elevation_cpu import RANGE, Poses
from mimicbench.sensors.rays import ray_depth
from mimicbench.sensors.sight.views import AMBIENT, FLOOR, LAMP, SIDE, SKY, CameraViews, side_of, views
from mimicbench.sim.native import NativePhysics
from mimicbench.sim.rows import Rows
from mimicbench.tasks.registry import TASKS
from stool import H1, block, put


def at(*root_pos, yaw=0.0):
    """A robot upright at a place, beside an object at the origin."""
    return Poses(np.array([root_pos]), rot.from_yaw(np.array([yaw])), np.zeros((1, 3)), rot.IDENTITY[None])


def apart(seen, rig):
    """(N, C, 4, side, side) the single cameras of a square of all."""
    side = side_of(rig)
    across = SIDE // side
    tiles = seen.reshape(len(seen), 4, across, side, across, side).transpose(0, 2, 4, 1, 3, 5)
    return tiles.reshape(len(seen), across**2, 4, side, side)[:, : len(rig.mounts)]


@pytest.mark.parametrize("rig", [PELVIS_RIG, HEAD_RIG], ids=lambda rig: rig.name)
@pytest.mark.parametrize("family", list(FAMILIES))
def test_depth_is_that_of_rays(family, rig):
    objects = [FAMILIES.get(family).make(index, 0) for index in range(3)]
    physics, random = NativePhysics(H1, objects), np.random.default_rng(1)
    pos = np.column_stack([random.uniform(-1.5, 1.5, (3, 2)), np.full(3, 1.1)])
    quat = rot.normalize(rot.IDENTITY + 0.1 * random.normal(size=(3, 4)))
    put(physics, range(3), pos, quat, np.tile(H1.rest_pose, (3, 1)))
    qpos, side = physics.qpos(), side_of(rig)
    seen = apart(views(objects, Poses(qpos[:, :3], qpos[:, 3:7], *physics.object_pose()), rig), rig)[:, :, 3]
    rays = np.minimum(ray_depth(physics, None, side, side, rig, robot=False) / RANGE, 1)
    assert seen.min() > 0 and seen.max() <= 1 and (seen < 1).mean() > 0.3
    assert (abs(seen - rays) < 1e-3).mean() > 0.99, "but for pixels on an edge, and cameras inside of a box"


def test_colors_by_hand():
    # 2 m before a stool of color 0.5, 1 m above the floor, both front cameras see it, the others floor and sky alone
    (seen,) = apart(views([block()], at(-2.0, 0.0, 1.0), PELVIS_RIG), PELVIS_RIG)
    lit = AMBIENT + (1 - AMBIENT) * LAMP[2]
    top, front = 0.5 * lit, 0.5 * AMBIENT  # of the lamp, which is at +x, the side at -x sees nothing
    floor, sky = FLOOR * lit, SKY
    colors = np.unique(seen[:, :3].transpose(0, 2, 3, 1).reshape(-1, 3).round(4), axis=0)
    wanted = [floor, sky, (top,) * 3, (front,) * 3]
    for color in wanted:
        assert (abs(colors - color).max(-1) < 1e-3).sum() == 1, color
    stool = abs(seen[:, 0] - top) < 1e-3
    assert (stool.sum((1, 2)) > 3).tolist() == [True, True, False, False]
    assert (seen[:, 0][seen[:, 3] == 1] == seen[:, 0].max()).any(), "the sky is farthest"
    # straight down the axis of a camera that looks 35 degrees down from 1 m the floor is 1 / sin 35 = 1.743 m away
    assert seen[2, 3, 31:33, 31:33].mean() * RANGE == pytest.approx(1.7434, abs=0.02)


def test_targets_are_one_red_pixel_each():
    places = np.array([[[-1.5, 0.1, 1.0], [np.nan] * 3]])
    (plain,), (told,) = (
        apart(views([block()], at(-2.0, 0.0, 1.0), HEAD_RIG, given), HEAD_RIG) for given in (None, places)
    )
    differs = (plain[0] != told[0]).any(0)
    assert differs.sum() == 1 and told[0, :3, differs].ravel().tolist() == [1, 0, 0]


def test_threads_and_company_change_no_byte():
    random = np.random.default_rng(0)
    objects = [FAMILIES.get(name).make(k, 0) for k in range(5) for name in ("chair", "bed", "box")]
    n = len(objects)
    pos = np.column_stack([random.uniform(-1.5, 1.5, (n, 2)), random.uniform(0.6, 1.1, n)])
    poses = Poses(pos, rot.from_yaw(random.uniform(-3, 3, n)), np.zeros((n, 3)), np.tile(rot.IDENTITY, (n, 1)))
    alone = views(objects, poses, PELVIS_RIG, workers=1)
    assert views(objects, poses, PELVIS_RIG, workers=3).tobytes() == alone.tobytes()
    assert views(objects[4:7], poses.part(slice(4, 7)), PELVIS_RIG).tobytes() == alone[4:7].tobytes()
    index = torch.arange(n)
    same = CameraViews(objects, PELVIS_RIG).sample(index, *(torch.from_numpy(x) for x in (pos, poses.root_quat_w)))
    assert same.numpy().tobytes() == alone.tobytes()


def test_nothing_is_seen_of_a_scene_that_broke():
    broken = Poses(np.full((1, 3), np.nan), np.full((1, 4), np.nan), np.zeros((1, 3)), rot.IDENTITY[None])
    assert np.isfinite(views([block()], broken, PELVIS_RIG, np.zeros((1, 2, 3)))).all()


@pytest.mark.parametrize("name", list(TASKS))
def test_they_are_observed(name):
    clips = clip_of(TASKS.get(name))
    env = VecEnv(clips.task, ROBOT, clips.scenes, ONE, bank=(bank := ReferenceBank(clips.motions, ROBOT)))
    start = ClipStarts(bank, env.physics.add_objects(clips.scenes), ROBOT)
    env.reset(Rows.every(1, env.device), start.at(torch.zeros(1).long(), torch.zeros(1).long()))
    seen = env.observe(("views",))["views"]
    assert seen.shape == (1, 4, SIDE, SIDE) and seen.dtype == torch.float32
    red = (seen[0, 0] == 1) & (seen[0, 1] == 0) & (seen[0, 2] == 0)
    assert int(red.sum()) <= 2 and bool(red.any()) == clips.task.goal.given


def test_who_sees_by_cameras_has_their_channels():
    task = TASKS.get("touch-points")
    inputs = InputConfig(views=True).of(ROBOT, task)
    assert inputs.sees and inputs.channels == 4 and inputs.targets
    assert InputConfig(elevation=False).of(ROBOT, task).sees is False
