"""Links by kinematics alone are those of the whole scene, to the last bit."""

import mujoco
import numpy as np
import torch

import stool
from mimicbench.objects.families.box import make_box
from mimicbench.objects.families.chair import make_chair
from mimicbench.sensors.proprioception import s_current
from mimicbench.sim.native import NativePhysics
from stool import H1, place, standing


def moving(count, workers=1, make=make_chair):
    """Robots beside objects, after ten steps of random targets."""
    physics = NativePhysics(H1, [make(i) for i in range(count)], workers=workers)
    pos, joints = standing()
    place(physics, pos, joints)
    random = np.random.default_rng(3)
    targets = torch.from_numpy(joints + 0.4 * random.normal(size=(10, 8, 19)))
    for target in targets:
        physics.step(target[:count], True)
    return physics, targets[-1, :count].float()


def test_links_are_those_of_the_whole_scene():
    for make in (make_chair, make_box):
        physics, _ = moving(2, make=make)
        links = physics.links()
        for env in range(2):
            model = physics.model(env)
            data = mujoco.MjData(model)
            data.qpos[:], data.qvel[:] = physics.qpos()[env], physics.qvel()[env]
            mujoco.mj_forward(model, data)
            rows = [model.body(name).id for name in H1.link_names]
            velocity = np.empty((len(rows), 6))
            for row, body in zip(velocity, rows, strict=True):
                mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_XBODY, body, row, 0)
            expected = data.xpos[rows], data.xquat[rows], velocity[:, 3:], velocity[:, :3]
            for found, there in zip(vars(links).values(), expected, strict=True):
                np.testing.assert_array_equal(found[env].numpy(), there.astype(np.float32))


def test_looking_changes_nothing():
    (looked, target), (other, _) = moving(2), moving(2)
    for _ in range(3):
        looked.links()
        looked.step(target)
        other.step(target)
    assert looked.qpos().tobytes() == other.qpos().tobytes()


def test_a_robot_feels_the_same_beside_any_others_and_on_any_threads():
    seen = []
    for count, workers in ((8, 2), (8, 1), (3, 1), (1, 1)):
        physics, last = moving(count, workers)
        seen.append(s_current(physics.state(), physics.links(), last))
    for fewer in seen:
        assert torch.equal(fewer, seen[0][: len(fewer)])


def test_models_of_objects_that_came_by_are_not_kept_forever(monkeypatch):
    monkeypatch.setattr("mimicbench.sim.native.KEPT_MODELS", 4)
    physics = NativePhysics(H1, [make_chair(0)], workers=1)
    for i in range(1, 8):
        stool.exchange(physics, [make_chair(i)])
    assert len(physics._compiled) == 4
    assert physics.model(0).geom("object_0").pos.tolist() == make_chair(7).box_pos[0].tolist()


def test_poses_alone_are_those_of_links():
    physics, _ = moving(3)
    poses, links = physics.link_poses(), physics.links()
    assert poses.pos_w.equal(links.pos_w) and poses.quat_w.equal(links.quat_w)
    assert physics.links().lin_vel_w.equal(links.lin_vel_w), "and leave the velocities as they are"
