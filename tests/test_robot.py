"""The H1 as data: what the paper and Unitree's description say of it, and MuJoCo's opinion of our kinematics."""

import mujoco
import numpy as np
import pytest

from mimicbench.core import rotations as rot
from mimicbench.core.errors import UnknownName
from mimicbench.objects.families.chair import make_chair
from mimicbench.robots.registry import ROBOTS
from mimicbench.sim.scene import build_model

H1 = ROBOTS.get("h1")
LEG, ARM = (
    ("hip_yaw", "hip_roll", "hip_pitch", "knee", "ankle"),
    ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow"),
)
PARTS = (
    *(f"left_{part}" for part in LEG),
    *(f"right_{part}" for part in LEG),
    "torso",
    *(f"left_{part}" for part in ARM),
    *(f"right_{part}" for part in ARM),
)


@pytest.fixture(scope="module")
def model():
    return build_model(H1, make_chair(0))


def random_poses(count):
    random = np.random.default_rng(0)
    quat = rot.normalize(random.normal(size=(count, 4)))
    return random.normal(size=(count, 3)), quat, random.uniform(*H1.joint_range.T, (count, 19))


def test_links_and_joints_in_the_papers_order():
    assert H1.link_names == ("pelvis", *(f"{part}_link" for part in PARTS))
    assert H1.joint_names == tuple(f"{part}_joint" for part in PARTS)
    assert (H1.joint_link == np.arange(1, 20)).all(), "joint i drives link i + 1"


def test_mass():
    assert sum(link.mass for link in H1.links) == pytest.approx(51.437, abs=0.001)


def test_the_model_is_the_description(model):
    for i, name in enumerate(H1.link_names):
        body = model.body(name)
        assert body.mass[0] == pytest.approx(H1.links[i].mass)
        np.testing.assert_allclose(body.ipos, H1.links[i].com, atol=1e-9)
        xx, yy, zz, xy, xz, yz = H1.links[i].inertia
        turn = rot.to_matrix(body.iquat)
        np.testing.assert_allclose(
            turn @ np.diag(body.inertia) @ turn.T, [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], atol=1e-8
        )
    for joint in H1.joints:
        found, motor = model.joint(joint.name), model.actuator(joint.name)
        np.testing.assert_allclose(found.range, joint.range)
        assert model.jnt_limited[found.id] and model.actuator_forcelimited[motor.id]
        np.testing.assert_allclose(motor.forcerange, [-joint.torque_limit, joint.torque_limit])
        assert model.dof_armature[found.dofadr[0]] == H1.armature


def test_forward_kinematics_is_mujocos(model):
    data = mujoco.MjData(model)
    rows = [model.body(name).id for name in H1.link_names]
    for pos, quat, joints in zip(*random_poses(10), strict=True):
        data.qpos[:26] = *pos, *quat, *joints
        mujoco.mj_kinematics(model, data)
        found_pos, found_quat = H1.forward_kinematics(pos, quat, joints)
        np.testing.assert_allclose(found_pos, data.xpos[rows], atol=1e-9)
        np.testing.assert_allclose(rot.angle_between(found_quat, data.xquat[rows]), 0, atol=1e-7)


def test_forward_kinematics_of_many_at_once():
    poses = random_poses(6)
    pos, quat = H1.forward_kinematics(*(part.reshape(2, 3, -1) for part in poses))
    for i, j in np.ndindex(2, 3):
        one = H1.forward_kinematics(*(part[3 * i + j] for part in poses))
        np.testing.assert_allclose(pos[i, j], one[0], atol=1e-12)
        np.testing.assert_allclose(quat[i, j], one[1], atol=1e-12)


def test_limits():
    limits = dict(zip(PARTS, H1.joint_range, strict=True))
    for side in ("left", "right"):
        np.testing.assert_allclose(limits[f"{side}_hip_pitch"], [-3.14, 2.53])
    torques = {joint.name: joint.torque_limit for joint in H1.joints}
    assert (
        torques["left_knee_joint"] == 300 and torques["right_ankle_joint"] == 40 and torques["left_elbow_joint"] == 18
    )
    assert ((H1.joint_range[:, 0] <= H1.rest_pose) & (H1.joint_range[:, 1] >= H1.rest_pose)).all()


def test_left_mirrors_right():
    flip = np.array([1, -1, 1])
    pairs = [(i, PARTS.index(part.replace("left", "right"))) for i, part in enumerate(PARTS) if part.startswith("left")]
    assert len(pairs) == 9
    for left, right in pairs:
        np.testing.assert_allclose(H1.link_pos[left + 1] * flip, H1.link_pos[right + 1])
        # a turn about y mirrors into itself, one about x or z into its opposite
        sign = 1 if H1.joints[left].axis[1] else -1
        np.testing.assert_allclose(H1.joint_range[left], np.sort(sign * H1.joint_range[right]))
        assert H1.joints[left].torque_limit == H1.joints[right].torque_limit
        for gains in H1.gains.values():
            assert gains.kp[left] == gains.kp[right] and gains.kd[left] == gains.kd[right]


def test_presets():
    assert set(H1.gains["paper"].kp) == {100} and set(H1.gains["paper"].kd) == {5}
    assert all(len(part) == 19 for gains in H1.gains.values() for part in (gains.kp, gains.kd, gains.action_scale))
    with pytest.raises(UnknownName, match="known are: improved, paper"):
        build_model(H1, make_chair(0), "fast")
    with pytest.raises(UnknownName, match="known are: g1, h1"):
        ROBOTS.get("r2d2")


def test_it_can_sit(model):
    # seen from the hip axis the buttocks end at most 0.09 m below, so that a seated pelvis is within K's band of 0.27 m
    data = mujoco.MjData(model)
    data.qpos[:26] = 0, 0, 0, 1, 0, 0, 0, *np.zeros(19)
    mujoco.mj_forward(model, data)
    lowest = min(
        data.geom_xpos[g, 2]
        - np.abs(data.geom_xmat[g].reshape(3, 3)[2] @ [0, 0, model.geom_size[g, 1]])
        - model.geom_size[g, 0]
        for g in range(model.ngeom)
        if model.geom_bodyid[g] == model.body("pelvis").id
    )
    hip_axis = data.xpos[model.body("left_hip_pitch_link").id, 2]
    assert 0 < hip_axis - lowest <= 0.09
    assert 0.2 < -lowest < 0.27


def test_standing_height():
    pos, quat = H1.forward_kinematics(np.zeros(3), rot.IDENTITY, np.zeros(19))
    head, sole = H1.keypoint_pos("head", pos, quat), H1.keypoint_pos("left_sole", pos, quat)
    assert 1.6 < head[2] - sole[2] < 1.8
    with pytest.raises(UnknownName, match="left_wrist"):
        H1.keypoint_pos("tail", pos, quat)


def test_elbow_link_ends_at_the_wrist():
    assert H1.keypoints["left_wrist"] == (15, (0.28, 0.0, -0.015)) and H1.keypoints["right_wrist"] == (
        19,
        (0.28, 0.0, -0.015),
    )


def test_arms_down():
    joints = np.zeros(19)
    for name, angle in H1.arms_down.items():
        joints[H1.joint_names.index(name)] = angle
    pos, quat = H1.forward_kinematics(np.zeros(3), rot.IDENTITY, joints)
    for side, elbow in (("left", 15), ("right", 19)):
        forearm = H1.keypoint_pos(f"{side}_wrist", pos, quat) - pos[elbow]
        assert forearm[2] / np.linalg.norm(forearm) < -0.99
