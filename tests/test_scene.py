"""Scenes: equal sizes whatever the object, the same bits at any number of threads, effort by hand, and broken
physics flagged.
"""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
import torch

import stool
from mimicbench.core import rotations as rot
from mimicbench.core.errors import UnknownName
from mimicbench.objects.families.chair import make_chair
from mimicbench.objects.shape import SLOTS
from mimicbench.sim.native import NativePhysics
from mimicbench.sim.physics import PhysicsConfig
from mimicbench.sim.scene import build_model
from mimicbench.sim.timing import CONTROL_DT, PHYSICS_DT, SUBSTEPS
from stool import H1, JOINT, block, place, seated, standing


def test_rates():
    np.testing.assert_allclose((1 / PHYSICS_DT, 1 / CONTROL_DT, SUBSTEPS), (200, 50, 4))


def test_all_scenes_have_the_same_sizes():
    names = ("nq", "nv", "nu", "nbody", "ngeom", "njnt", "nM", "nsensor")
    sizes = {
        tuple(getattr(build_model(H1, obj), name) for name in names)
        for obj in (*(make_chair(i) for i in range(12)), block())
    }
    assert len(sizes) == 1
    assert next(iter(sizes))[:3] == (26, 25, 19)


def test_the_object_is_where_it_says_it_is():
    obj = make_chair(3)
    model = build_model(H1, obj)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for slot in range(SLOTS):
        geom = model.geom(f"object_{slot}").id
        if slot < len(obj.box_pos):
            np.testing.assert_allclose(data.geom_xpos[geom], obj.box_pos[slot], atol=1e-12)
            np.testing.assert_allclose(model.geom_size[geom], obj.box_half[slot])
        else:
            inside = rot.rotate_inverse(obj.box_quat[0], data.geom_xpos[geom] - obj.box_pos[0])
            assert (np.abs(inside) + 0.001 <= obj.box_half[0]).all(), "a slot to spare is hidden in the first box"


def test_a_slot_to_spare_is_hidden_in_a_piece_that_does_not_fill_its_box():
    gusset = np.array([[0, 0, 0], [0.4, 0, 0], [0, 0.4, 0], [0, 0, 0.4]])  # the middle of the box around it is air
    obj = replace(block(), hulls=(gusset,))
    model = build_model(H1, obj, meshes=True)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for slot in range(1, SLOTS):
        x, y, z = data.geom_xpos[model.geom(f"object_{slot}").id]
        assert min(x, y, z) > 0.01 and x + y + z < 0.38


def test_pictures_change_nothing():
    plain, shown = build_model(H1, make_chair(0)), build_model(H1, make_chair(0), visuals=True)
    assert (plain.nq, plain.nv, plain.nbody) == (shown.nq, shown.nv, shown.nbody) and shown.ngeom > plain.ngeom
    np.testing.assert_array_equal(plain.body_mass, shown.body_mass)
    np.testing.assert_array_equal(plain.body_inertia, shown.body_inertia)


def test_a_movable_object_has_its_mass():
    model = build_model(H1, block(0.3, 0.15, movable=True, mass=2.5))
    assert model.body("object").mass[0] == pytest.approx(2.5)
    assert model.nq == 26 + 7


def test_unknown_control():
    with pytest.raises(UnknownName, match="known are: position, torque, velocity"):
        build_model(H1, block(), control="thought")


def test_a_seated_robot_stays():
    physics = NativePhysics(H1, [block()], workers=1)
    pos, joints = seated(0.42)
    place(physics, pos, joints)
    for _ in range(100):
        physics.step(torch.tensor(joints)[None])
    state = physics.state()
    assert np.linalg.norm(state.root_pos_w[0, :2].numpy() - pos[:2]) < 0.05
    assert 0.0 < state.root_pos_w[0, 2] - 0.42 < 0.27, "inside K's band"
    assert rot.angle_between(state.root_quat_w, torch.tensor([[1.0, 0, 0, 0]]))[0] < 0.15
    assert state.root_lin_vel_w.norm() < 0.05
    assert not physics.diverged.any()


def test_a_standing_robot_rests_on_its_soles():
    physics = NativePhysics(H1, [block()], workers=1)
    pos, joints = standing()
    place(physics, pos, joints)
    for _ in range(10):
        physics.step(torch.tensor(joints)[None])
    links = physics.links()
    soles = [
        H1.keypoint_pos(f"{side}_sole", links.pos_w.numpy(), links.quat_w.numpy())[0, 2] for side in ("left", "right")
    ]
    assert np.abs(soles).max() < 0.02


def test_link_velocities_are_the_derivatives_of_link_positions():
    physics = NativePhysics(H1, [block()], PhysicsConfig(control="torque"), workers=1)
    random = np.random.default_rng(1)
    place(
        physics,
        [-1.5, 0, 3.0],
        np.array(H1.rest_pose),
        root_lin_vel_w=random.normal(size=(1, 3)),
        root_ang_vel_b=random.normal(size=(1, 3)),
        joint_vel=random.normal(size=(1, 19)),
    )
    before = physics.links()
    qpos, qvel = physics.qpos()[0].copy(), physics.qvel()[0].copy()
    small = 1e-6
    mujoco.mj_integratePos(physics.model(0), qpos, qvel, small)
    pos, quat = H1.forward_kinematics(qpos[:3], qpos[3:7], qpos[7:])
    start_pos, start_quat = H1.forward_kinematics(*np.split(physics.qpos()[0], [3, 7]))
    np.testing.assert_allclose(before.lin_vel_w[0], (pos - start_pos) / small, atol=1e-4)
    np.testing.assert_allclose(
        before.ang_vel_w[0], rot.to_rotvec(rot.multiply(quat, rot.conjugate(start_quat))) / small, atol=1e-4
    )
    state = physics.state()
    np.testing.assert_allclose(state.root_lin_vel_w[0], before.lin_vel_w[0, 0], atol=1e-5)
    np.testing.assert_allclose(
        rot.rotate(state.root_quat_w, state.root_ang_vel_b)[0], before.ang_vel_w[0, 0], atol=1e-5
    )


def drive(workers):
    """Six robots beside six chairs under random targets, some exchanged and pushed on the way."""
    random = np.random.default_rng(2)
    physics = NativePhysics(H1, [make_chair(i) for i in range(6)], workers=workers)
    pos, joints = standing()
    place(physics, pos, joints)
    for step in range(30):
        if step == 15:
            stool.exchange(physics, [make_chair(9)], np.array([2]))
            stool.put(physics, np.array([2]), pos[None], rot.IDENTITY[None], joints[None])
            push = torch.zeros(6, 3)
            push[4, 0] = 0.5
            physics.push(push)
        physics.step(torch.tensor(joints + 0.3 * random.normal(size=(6, 19))), measure_effort=step % 2 == 0)
    return physics.qpos().tobytes(), physics.qvel().tobytes(), physics.effort.numpy().tobytes()


def test_one_and_two_threads_give_the_same_bits():
    assert drive(1) == drive(2)


def test_effort_by_hand():
    # appendix D.2 in free fall: e = sum of (mean torque * mean velocity)^2 over the joints, means over the four
    # substeps
    physics = NativePhysics(H1, [block()], PhysicsConfig(control="torque"), workers=1)
    pos, joints = np.array([-2.0, 0, 5.0]), np.array(H1.rest_pose)
    place(physics, pos, joints)
    torque = np.zeros(19)
    torque[JOINT["left_elbow"]], torque[JOINT["torso"]], torque[JOINT["right_elbow"]] = 5.0, -20.0, 999.0
    given = torque.copy()
    given[JOINT["right_elbow"]] = 18.0  # all that it has
    model = build_model(H1, block(), control="torque")
    data = mujoco.MjData(model)
    data.qpos[:] = *pos, 1, 0, 0, 0, *joints
    data.ctrl[:] = torque
    for _ in range(3):
        physics.step(torch.tensor(torque)[None], measure_effort=True)
        speeds = []
        for _ in range(SUBSTEPS):
            mujoco.mj_step(model, data)
            speeds.append(data.qvel[6:25].copy())
        by_hand = ((given * np.mean(speeds, 0)) ** 2).sum()
        assert physics.effort[0].item() == pytest.approx(by_hand, rel=1e-9)
    assert by_hand > 1


def test_control_modes():
    # all three push the elbow the same way when their targets mean the same torque at rest
    ends = []
    gains = H1.gains["improved"]
    elbow = JOINT["left_elbow"]
    for control, target in (
        ("position", 0.05),
        ("velocity", 0.05 * gains.kp[elbow] / gains.kd[elbow]),
        ("torque", 0.05 * gains.kp[elbow]),
    ):
        physics = NativePhysics(H1, [block()], PhysicsConfig(control=control), workers=1)
        place(physics, np.array([-2.0, 0, 5.0]), np.zeros(19))
        command = torch.zeros(1, 19)
        command[0, elbow] = target
        physics.step(command)
        ends.append(physics.state().joint_pos[0, elbow].item())
    assert all(0.001 < end < 0.05 for end in ends)
    assert max(ends) - min(ends) < 0.3 * max(ends)


def test_broken_physics_is_flagged_until_reset():
    physics = NativePhysics(H1, [block(), block()], workers=1)
    pos, joints = standing()
    place(physics, pos, joints, root_lin_vel_w=np.array([[0, 0, 0], [0, 0, 1e12]]))
    physics.step(torch.tensor(joints).expand(2, 19))
    assert physics.diverged.tolist() == [False, True]
    assert torch.isfinite(physics.state().root_pos_w).all()
    stool.put(physics, np.array([1]), pos[None], rot.IDENTITY[None], joints[None])
    physics.step(torch.tensor(joints).expand(2, 19))
    assert physics.diverged.tolist() == [False, False]


def test_step_of_some_leaves_the_others():
    physics = NativePhysics(H1, [block()] * 3, workers=1)
    pos, joints = standing()
    place(physics, pos, joints)
    before = physics.qpos().copy()
    physics.step(torch.tensor(joints).expand(3, 19), True, torch.tensor([False, True, False]))
    moved = (physics.qpos() != before).any(-1)
    assert moved.tolist() == [False, True, False]
    assert (physics.effort > 0).tolist() == [False, True, False]


@pytest.mark.parametrize("friction", [0.3, 1.4])
def test_an_object_is_as_slippery_as_it_says(friction):
    box = replace(block(0.3, 0.15, movable=True, mass=2.0), friction=friction)
    model = build_model(H1, box)
    data = mujoco.MjData(model)
    data.qpos[2] = 2.0  # the robot is out of the way
    for _ in range(20):
        mujoco.mj_step(model, data)
    floor, first = (mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, name) for name in ("floor", "object_0"))
    touching = [contact.friction[0] for contact in data.contact if {contact.geom1, contact.geom2} == {floor, first}]
    assert touching == [friction] * len(touching) and touching
