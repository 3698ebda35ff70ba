"""The Warp backend against the native one and against itself.

Compiling Warp's kernels takes a minute or two the first time, so these tests run only where MuJoCo Warp is installed
and `MIMICBENCH_WARP=1` is set; where torch sees a GPU as well, on that too.
"""

import os

import numpy as np
import pytest
import torch

if os.environ.get("MIMICBENCH_WARP") != "1":
    pytest.skip("set MIMICBENCH_WARP=1 to test the Warp backend (a minute or two)", allow_module_level=True)
pytest.importorskip("mujoco_warp", reason="MuJoCo Warp is not installed: pip install 'mimicbench[gpu]'")

import stool
from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadObject, UnknownName
from mimicbench.objects.families.box import make_box
from mimicbench.objects.registry import FAMILIES
from mimicbench.objects.shape import SceneObject
from mimicbench.sim.backends import make_physics
from mimicbench.sim.broken import load_broken, replay
from mimicbench.sim.native import NativePhysics
from mimicbench.sim.physics import PhysicsConfig
from mimicbench.sim.rows import Rows
from mimicbench.sim.scene import FLOOR_GROUP, OBJECT_GROUP, ROBOT_GROUP, build_model
from mimicbench.sim.warp import WarpPhysics
from mimicbench.sim.warp_objects import PER_WORLD
from stool import H1, block, place, seated, standing

DEVICES = ["warp-cpu", *(["cuda"] if torch.cuda.is_available() else [])]
ON = [device.removeprefix("warp-") for device in DEVICES]
POS, JOINTS = standing()
TOLERANCE = 5e-5
"""[rad, m] Warp computes with 32 bits, so a joint angle near 1 is rounded by 6e-8 in each of 80 steps here, and contact
makes two ways part further: measured were 2e-7 after 5 control steps and 2e-6 after 20, seated or standing, with moving
targets. Robots that are thrown, or that start inside of something, part for good after a few tenths of a second, on any
two simulators."""


@pytest.fixture(params=DEVICES)
def device(request):
    return request.param


@pytest.fixture(params=ON)
def on(request):
    return request.param


def scenes():
    """A stool to stand before; a stool, a chair and a sofa to sit on."""
    objects = [block(), block(), FAMILIES.get("chair").make(0, 0), FAMILIES.get("sofa").make(1, 0)]
    pos = np.stack([POS, *([0, 0, obj.require_seat() + 0.237] for obj in objects[1:])])
    joints = np.stack([JOINTS, *[seated(0.4)[1]] * 3])
    return objects, pos, joints


def upright(n):
    return np.tile(rot.IDENTITY, (n, 1))


def test_the_same_episode_on_both(device, tmp_path):
    objects, pos, joints = scenes()
    both = [make_physics(name, H1, objects, PhysicsConfig(broken_dir=tmp_path), workers=1) for name in ("cpu", device)]
    for physics in both:
        stool.put(
            physics,
            np.arange(4),
            pos,
            upright(4),
            joints,
            root_lin_vel_w=np.full((4, 3), 0.05),
            root_ang_vel_b=np.full((4, 3), 0.02),
            joint_vel=np.full((4, 19), 0.03),
        )
    for step in range(20):
        target = torch.from_numpy(joints + 0.2 * np.sin(step / 7 + np.arange(19)))
        if step == 8:
            for physics in both:
                push = torch.zeros(4, 3, device=physics.device)
                push[1] = torch.tensor([0.1, 0.2, 0.0])
                physics.push(push)
                stool.put(physics, np.array([2]), pos[2:3], upright(1), joints[2:3])
        for physics in both:
            running = torch.tensor([True, True, True, False], device=physics.device) if step == 12 else None
            physics.step(target.to(physics.device), True, running)
    native, warp = both
    for field in ("root_pos_w", "root_quat_w", "joint_pos"):
        torch.testing.assert_close(
            getattr(warp.state(), field).cpu(), getattr(native.state(), field), atol=TOLERANCE, rtol=0
        )
    for field in (
        "root_lin_vel_w",
        "root_ang_vel_b",
        "joint_vel",
    ):  # a difference that grows within a physics step of 0.005 s
        torch.testing.assert_close(
            getattr(warp.state(), field).cpu(), getattr(native.state(), field), atol=TOLERANCE / 0.005, rtol=0
        )
    for field in ("pos_w", "quat_w", "lin_vel_w", "ang_vel_w"):
        slack = TOLERANCE if field in ("pos_w", "quat_w") else TOLERANCE / 0.005
        torch.testing.assert_close(
            getattr(warp.links(), field).cpu(), getattr(native.links(), field), atol=slack, rtol=0
        )
    torch.testing.assert_close(warp.effort.cpu(), native.effort, rtol=0.01, atol=1e-3)
    np.testing.assert_allclose(warp.qpos(), native.qpos(), atol=TOLERANCE)
    np.testing.assert_array_equal(warp.object_pose()[0], native.object_pose()[0])
    assert not warp.diverged.any() and warp.broken.count == 0


def lift(physics, steps=15):
    """Arms that come together above a box that falls 10 cm."""
    place(physics, POS, JOINTS)
    for step in range(steps):
        physics.step(torch.tensor(JOINTS + 0.02 * step).expand(physics.num_envs, 19))
    return physics.qpos(), physics.qvel()


def test_boxes_move_alike(device):
    boxes = [make_box(i) for i in (0, 7)]
    native, warp = (make_physics(name, H1, boxes, workers=1) for name in ("cpu", device))
    np.testing.assert_allclose(lift(warp)[0], lift(native)[0], atol=TOLERANCE)
    np.testing.assert_allclose(warp.object_pose()[0], native.object_pose()[0], atol=TOLERANCE)


@pytest.mark.parametrize("family", ["box", "household"])
def test_exchanged_objects_are_as_in_a_fresh_scene(on, family):
    old, new = [FAMILIES.get(family).make(i, 0) for i in range(3)], [FAMILIES.get(family).make(i, 0) for i in (9, 4, 6)]
    exchanged, fresh = (WarpPhysics(H1, objects, device=on) for objects in (old, new))
    lift(exchanged, 5)
    stool.exchange(exchanged, [new[1]], [1])
    assert [obj.id for obj in exchanged.objects] == [old[0].id, new[1].id, old[2].id]
    stool.exchange(exchanged, [new[2], new[0]], [2, 0])
    for name in PER_WORLD:
        first = 1 if name == "body_subtreemass" else 0  # the world's own, which nothing reads
        there = getattr(exchanged._model, name).numpy()
        np.testing.assert_array_equal(there[:, first:], getattr(fresh._model, name).numpy()[:, first:], err_msg=name)
        for env, obj in enumerate(new):
            full = getattr(build_model(H1, obj), name)
            np.testing.assert_allclose(
                there[env].reshape(full.shape)[first:], full[first:], rtol=1e-5, atol=1e-7, err_msg=name
            )
    if on == "cpu":  # on a GPU, sums have no fixed order
        for one, other in zip(lift(exchanged), lift(fresh), strict=True):
            np.testing.assert_array_equal(one, other)


def test_nothing_else_of_a_scene_depends_on_its_object():
    # colors, trees that Warp does not have, short cuts that it does not take, and what only sleeping bodies need
    harmless = {"geom_rgba", "bvh_aabb", "bvh_nodeid", "geom_sameframe", "body_sameframe", "dof_M0", "dof_length"}
    for family in ("household", "box"):
        models = [build_model(H1, FAMILIES.get(family).make(i, 0)) for i in range(6)]
        differ = set()
        for name in dir(models[0]):
            values = [getattr(model, name) for model in models] if not name.startswith("_") else []
            if values and isinstance(values[0], np.ndarray):
                differ |= {name for value in values if value.shape != values[0].shape or (value != values[0]).any()}
        assert differ <= set(PER_WORLD) | harmless, family


def test_only_the_broken_world_ends(device, tmp_path):
    objects, pos, joints = scenes()
    target = torch.from_numpy(joints)
    whole, broken = (
        make_physics(device, H1, objects, PhysicsConfig(broken_dir=tmp_path / name)) for name in ("whole", "broken")
    )
    for physics in (whole, broken):
        stool.put(physics, np.arange(4), pos, upright(4), joints)
        physics.step(target)
    bad = target.clone()
    bad[1, 3] = torch.nan
    broken.step(bad, True)
    whole.step(target, True)
    stool.put(broken, np.array([2]), np.full((1, 3), np.nan), upright(1), joints[2:3])
    for _ in range(3):
        for physics in (whole, broken):
            physics.step(target, True)
    assert broken.diverged.tolist() == [False, True, True, False] and not whole.diverged.any()
    assert (
        torch.isfinite(broken.state().joint_pos).all()
        and torch.isfinite(broken.links().pos_w).all()
        and torch.isfinite(broken.effort).all()
    )
    np.testing.assert_allclose(
        broken.qpos()[[0, 3]], whole.qpos()[[0, 3]], atol=0 if device == "warp-cpu" else TOLERANCE
    )
    assert (broken.broken.count, whole.broken.count) == (2, 0)
    by_target, by_position = (load_broken(path) for path in broken.broken.paths)
    assert (by_target.scene, by_target.backend, by_target.obj.id) == (
        1,
        "warp",
        objects[1].id,
    ) and "targets" in by_target.reason
    assert replay(by_target).warnings == ("BADCTRL",)
    assert by_position.scene == 2 and "positions" in by_position.reason and "BADQPOS" in replay(by_position).warnings
    stool.put(broken, np.array([1, 2]), pos[1:3], upright(2), joints[1:3])
    broken.step(target)
    assert not broken.diverged.any()


def test_a_world_is_told_of_with_what_it_broke_beside(device, tmp_path):
    """Though it was given another object, and is pushed no longer, before anybody asks."""
    objects, pos, joints = scenes()
    physics = make_physics(device, H1, objects, PhysicsConfig(broken_dir=tmp_path))
    stool.put(physics, np.arange(4), pos, upright(4), joints)
    physics.assist(torch.full((4, 3), 7.0), torch.full((4, 3), 2.0))
    bad = torch.from_numpy(joints)
    bad[2, 3] = torch.nan
    physics.step(bad)
    physics.set_objects(Rows.of(torch.tensor([2]), 4), torch.tensor([0]))
    stool.put(physics, np.array([2]), pos[2:3], upright(1), joints[2:3])
    physics.assist(torch.zeros(4, 3), torch.zeros(4, 3))
    (path,) = physics.broken.paths
    told = load_broken(path)
    assert told.scene == 2 and told.obj.id == objects[2].id and told.wrench.tolist() == [7.0] * 3 + [2.0] * 3


def test_a_world_with_too_many_contacts_ends(on, tmp_path):
    # two robots of four high in the air, one standing with 8 contacts, one dropped on its back, with 10 for a moment:
    # 40 rows, and room for 35
    physics = WarpPhysics(H1, [block()] * 4, PhysicsConfig(broken_dir=tmp_path), on, contacts=4)
    pos, quat = np.tile([-1.5, 0, 3.0], (4, 1)), upright(4)
    pos[1], pos[2], quat[2] = POS, [-1.8, 0, 0.1], [np.sqrt(0.5), 0, -np.sqrt(0.5), 0]
    stool.put(physics, np.arange(4), pos, quat, np.tile(JOINTS, (4, 1)))
    for _ in range(10):
        physics.step(torch.tensor(JOINTS).expand(4, 19))
    assert physics.diverged.tolist() == [False, False, True, False]
    assert "contacts" in load_broken(physics.broken.paths[0]).reason


def test_rays_see_alike(device):
    objects = [make_box(3), make_box(5), make_box(6)]
    both = [make_physics(name, H1, objects, workers=1) for name in ("cpu", device)]
    for physics in both:
        place(physics, POS, JOINTS)
    random = np.random.default_rng(1)
    starts, rays = np.tile([0.0, 0.3, 1.5], (2, 200, 1)), random.normal(size=(2, 200, 3))
    rays[..., 2] -= 2.0
    for groups in ((OBJECT_GROUP,), (FLOOR_GROUP, OBJECT_GROUP, ROBOT_GROUP)):
        native, warp = (physics.ray(starts, rays, groups, np.array([0, 2])) for physics in both)
        hit = native > 0
        assert hit.any() and (hit != (warp > 0)).mean() < 0.01, "only a ray along an edge may tell them apart"
        both_hit = hit & (warp > 0)
        np.testing.assert_allclose(warp[both_hit], native[both_hit], rtol=1e-4, atol=1e-5)


def test_what_warp_cannot_do_is_said():
    ones = np.ones((1, 3))
    corners = np.array([[0.2, 0, 0], [-0.2, 0.2, 0], [-0.2, -0.2, 0], [0, 0, 0.4]])
    pyramid = SceneObject(
        "pyramid", "own", "tent", np.array([[0, 0, 0.2]]), rot.IDENTITY[None], 0.2 * ones, ones, hulls=(corners,)
    )
    physics = WarpPhysics(H1, [block()], device="cpu")
    with pytest.raises(BadObject, match="pyramid has convex pieces.*--device cpu"):
        stool.exchange(physics, [pyramid])
    with pytest.raises(BadObject, match="is movable"):
        stool.exchange(physics, [make_box(0)])
    with pytest.raises(UnknownName, match="device 'gpu'"):
        make_physics("gpu", H1, [block()])
    with pytest.raises(ValueError, match="read-only"):
        physics.qpos()[0] = 0.0


def test_a_device_is_all_that_differs(device):
    assert isinstance(make_physics("cpu", H1, [block()], workers=1), NativePhysics)
    physics = make_physics(device, H1, [block()])
    assert isinstance(physics, WarpPhysics) and physics.device in ("cpu", "cuda")
    assert physics.state().root_pos_w.device.type == physics.device
    assert physics.model(0).ngeom == build_model(H1, block()).ngeom
    assert (physics.model(0).geom_group == OBJECT_GROUP).any()
