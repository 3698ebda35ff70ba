"""The G1 as data: what Unitree's description says of it, and that it stands, sits and is followed like any robot."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion, UnknownName
from mimicbench.objects.families.chair import make_chair
from mimicbench.references.body.skeletons import SKELETONS
from mimicbench.retarget.mapping import bind, find_mapping
from mimicbench.robots.registry import ROBOTS
from mimicbench.sim.scene import build_model

G1 = ROBOTS.get("g1")
LEG = ("hip_pitch", "hip_roll", "hip_yaw", "knee", "ankle_pitch", "ankle_roll")
ARM = ("shoulder_pitch", "shoulder_roll", "shoulder_yaw", "elbow", "wrist_roll", "wrist_pitch", "wrist_yaw")
SIDES = ("left", "right")
PARTS = (
    *(f"{side}_{part}" for side in SIDES for part in LEG),
    *("waist_yaw", "waist_roll", "waist_pitch"),
    *(f"{side}_{part}" for side in SIDES for part in ARM),
)


@pytest.fixture(scope="module")
def model():
    return build_model(G1, make_chair(0))


@pytest.fixture(scope="module")
def upright():
    return G1.forward_kinematics(np.zeros(3), rot.IDENTITY, np.zeros(29))


def test_links_and_joints_in_the_descriptions_order():
    assert G1.joint_names == tuple(f"{part}_joint" for part in PARTS)
    links = [f"{part}_link".replace("waist_pitch", "torso") for part in PARTS]
    assert G1.link_names == ("pelvis", *links)
    assert (G1.joint_link == np.arange(1, 30)).all(), "joint i drives link i + 1"
    assert G1.links[G1.link_names.index("right_shoulder_pitch_link")].parent == G1.link_names.index("torso_link")


def test_mass():
    assert sum(link.mass for link in G1.links) == pytest.approx(33.341142, abs=1e-6)


@pytest.mark.parametrize(
    ("link", "place"),
    [
        # MuJoCo Menagerie's model at its zero pose, seen from the pelvis
        ("left_ankle_roll_link", (0.0, 0.1185, -0.7569)),
        ("left_shoulder_pitch_link", (0.0, 0.1002, 0.2918)),
        ("left_elbow_link", (0.0158, 0.1468, 0.1052)),
        ("left_wrist_yaw_link", (0.1998, 0.1487, 0.0952)),
        ("right_ankle_roll_link", (0.0, -0.1185, -0.7569)),
        ("right_wrist_yaw_link", (0.1998, -0.1487, 0.0952)),
    ],
)
def test_places_at_the_zero_pose(upright, link, place):
    np.testing.assert_allclose(upright[0][G1.link_names.index(link)], place, atol=1e-4)


def test_center_of_mass_and_height(upright):
    pos, quat = upright
    masses, middles = np.array([link.mass for link in G1.links]), np.array([link.com for link in G1.links])
    center = (masses[:, None] * (pos + rot.rotate(quat, middles))).sum(0) / masses.sum()
    np.testing.assert_allclose(center, (0.0203, 0.0001, -0.0887), atol=1e-4)
    assert G1.keypoint_pos("left_sole", pos, quat)[2] == pytest.approx(-0.7919, abs=1e-4)
    top = G1.keypoint_pos("head", pos, quat)[2] + 0.07
    assert 1.27 < top + 0.7919 < 1.33


def test_the_model_is_the_description(model):
    for joint in G1.joints:
        found = model.joint(joint.name)
        np.testing.assert_allclose(found.range, joint.range)
        np.testing.assert_allclose(model.actuator(joint.name).forcerange[1], joint.torque_limit)
        assert model.dof_armature[found.dofadr[0]] == joint.armature != G1.armature
    assert sum(model.body(name).mass[0] for name in G1.link_names) == pytest.approx(33.341142, abs=1e-6)


def test_forward_kinematics_is_mujocos(model):
    data, random = mujoco.MjData(model), np.random.default_rng(0)
    rows = [model.body(name).id for name in G1.link_names]
    for _ in range(5):
        quat, joints = rot.normalize(random.normal(size=4)), random.uniform(*G1.joint_range.T)
        data.qpos[:36] = 0.1, -0.2, 0.3, *quat, *joints
        mujoco.mj_kinematics(model, data)
        found_pos, found_quat = G1.forward_kinematics(np.array([0.1, -0.2, 0.3]), quat, joints)
        np.testing.assert_allclose(found_pos, data.xpos[rows], atol=1e-9)
        np.testing.assert_allclose(rot.angle_between(found_quat, data.xquat[rows]), 0, atol=1e-7)


def test_right_mirrors_left():
    for left, joint in enumerate(G1.joints):
        if joint.name.startswith("left"):
            right = G1.joint_names.index(joint.name.replace("left", "right"))
            sign = 1 if joint.axis[1] else -1  # a turn about y mirrors into itself, one about x or z into its opposite
            np.testing.assert_allclose(G1.joint_range[right], np.sort(sign * G1.joint_range[left]))
            assert all(gains.kp[left] == gains.kp[right] for gains in G1.gains.values())


def test_limits_and_gains():
    assert ((G1.joint_range[:, 0] <= G1.rest_pose) & (G1.joint_range[:, 1] >= G1.rest_pose)).all()
    assert set(G1.gains["paper"].kp) == {100} and set(G1.gains["paper"].kd) == {5}
    torque = np.array([joint.torque_limit for joint in G1.joints])
    gains = G1.gains["improved"]
    share = np.array(gains.kp) * gains.action_scale / torque
    assert (share > 0.2).all() and (share < 0.65).all(), "an action of 1 is about half of what a motor can do"


def test_it_can_sit(model):
    data = mujoco.MjData(model)
    data.qpos[:36] = 0, 0, 0, 1, 0, 0, 0, *np.zeros(29)
    mujoco.mj_forward(model, data)
    pelvis = [shape for shape in G1.collision if shape.link == 0]
    lowest = min(min(shape.start[2], shape.end[2]) - shape.size[0] for shape in pelvis)
    assert lowest == pytest.approx(-0.155)
    hip = data.xpos[model.body("left_hip_pitch_link").id, 2]
    assert 0.03 < hip - lowest < 0.09


def test_arms_down():
    joints = np.array([G1.arms_down.get(name, 0.0) for name in G1.joint_names])
    pos, quat = G1.forward_kinematics(np.zeros(3), rot.IDENTITY, joints)
    for side in SIDES:
        forearm = G1.keypoint_pos(f"{side}_wrist", pos, quat) - pos[G1.link_names.index(f"{side}_elbow_link")]
        assert forearm[2] / np.linalg.norm(forearm) < -0.99


def test_reach_is_straight_through_the_joints_between(upright):
    pos, _ = upright
    for hip, knee, foot in G1.legs:
        a, b, c = (G1.link_names.index(name) for name in (hip, knee, foot))
        assert G1.reach(a, b) == pytest.approx(np.linalg.norm(pos[b] - pos[a]))
        assert G1.reach(b, c) == pytest.approx(0.31757, abs=1e-5)
    with pytest.raises(UnknownName, match="link above left_knee_link 'torso_link'"):
        G1.reach(G1.link_names.index("torso_link"), G1.link_names.index("left_knee_link"))


@pytest.mark.parametrize("skeleton", SKELETONS.values(), ids=SKELETONS)
def test_people_are_followed_by_its_legs(skeleton):
    bound = bind(find_mapping(skeleton.name, G1), skeleton, G1)
    assert [G1.link_names[link] for leg in bound.legs for link in leg] == [name for leg in G1.legs for name in leg]
    assert (bound.lowered == 0).sum() == 2, "knees stay where the feet have them"


def test_a_mapping_to_a_foot_without_a_leg():
    mapping = find_mapping("unihsi", G1)
    wrong = replace(mapping, feet=((mapping.feet[0][0], "left_knee_link"), mapping.feet[1]))
    with pytest.raises(BadMotion, match="has no leg that ends in 'left_knee_link'"):
        bind(wrong, SKELETONS["unihsi"], G1)
