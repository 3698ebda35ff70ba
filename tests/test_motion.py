"""Motions: what a clip must be, what its file says, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadFile, BadMotion
from mimicbench.core.files import read_npz, write_npz
from mimicbench.core.motion import HumanMotion, RobotMotion
from mimicbench.core.skeleton import Skeleton
from mimicbench.robots.registry import ROBOTS

H1 = ROBOTS.get("h1")
ARM = Skeleton("arm", ("shoulder", "elbow", "hand"), (-1, 0, 1), np.array([[0, 0, 0], [1, 0, 0], [0, 0, 2]], float))


def human(frames=7):
    turns = rot.from_rotvec(np.linspace(0, 1, frames * 9).reshape(frames, 3, 3))
    contacts = np.arange(frames * 2).reshape(frames, 2) % 3 == 0
    return HumanMotion(
        "clip-0",
        "sit-chair",
        ARM,
        30.0,
        np.linspace(0, 1, frames * 3).reshape(frames, 3),
        turns,
        "chair-0-00001",
        ("left_foot", "right_foot"),
        contacts,
        {"speed": 0.6},
    )


def robot(frames=7, fps=30.0):
    t = np.arange(frames)[:, None] / fps
    return RobotMotion(
        "clip-0",
        "sit-chair",
        "h1",
        H1.joint_names,
        fps,
        np.hstack([t, 0 * t, 1 + 0 * t]),
        rot.from_rotvec(t * [0.0, 0.0, 0.7]),
        0.1 * np.sin(t + np.arange(19)),
        "chair-0-00001",
        "clip-0",
        ("left_foot",),
        t > 0.1,
        {},
        {"loss": 0.1},
        success=False,
    )


def test_forward_kinematics_by_hand():
    # a quarter turn about z at the elbow: upper arm along x, and the hand 2 m above it whichever way it turns
    quats = np.tile(rot.IDENTITY, (2, 3, 1))
    quats[:, 0] = rot.from_rotvec(np.array([0.0, np.pi / 2, 0.0]))  # the arm points down, and up becomes forward
    motion = HumanMotion("c", "t", ARM, 30.0, np.array([[0, 0, 1.5]] * 2), quats, "o")
    pos, quat = motion.forward_kinematics()
    np.testing.assert_allclose(pos[0], [[0, 0, 1.5], [0, 0, 0.5], [2, 0, 0.5]], atol=1e-12)
    np.testing.assert_allclose(quat[0, 2], quats[0, 0], atol=1e-12)


@pytest.mark.parametrize("motion", [human(), robot()], ids=["human", "robot"])
def test_save_and_load(motion, tmp_path):
    motion.save(tmp_path / "m.npz")
    again = type(motion).load(tmp_path / "m.npz")
    for name, value in vars(motion).items():
        found = getattr(again, name)
        if isinstance(value, np.ndarray):
            np.testing.assert_allclose(found, value, atol=1e-6)
        elif name != "skeleton":
            assert found == value
    again.save(tmp_path / "n.npz")
    assert (tmp_path / "m.npz").read_bytes() == (tmp_path / "n.npz").read_bytes(), "a second round changes nothing"


def test_skeleton_survives(tmp_path):
    human().save(tmp_path / "m.npz")
    skeleton = HumanMotion.load(tmp_path / "m.npz").skeleton
    assert (skeleton.name, skeleton.joint_names, skeleton.parents) == (ARM.name, ARM.joint_names, ARM.parents)
    np.testing.assert_array_equal(skeleton.offsets, ARM.offsets)


def test_a_hand_may_have_no_goal(tmp_path):
    one = replace(human(), wrist_goal_w=np.array([[0.4, 0.2, 1.0], [np.nan] * 3]))
    one.save(tmp_path / "one.npz")
    np.testing.assert_allclose(HumanMotion.load(tmp_path / "one.npz").wrist_goal_w, one.wrist_goal_w, atol=1e-7)
    for goals in ([[0.4, np.nan, 1.0], [0.4, 0.2, 1.0]], [[np.nan] * 3] * 2, [[np.inf] * 3, [0.4, 0.2, 1.0]]):
        with pytest.raises(BadMotion, match="wrist_goal_w"):
            replace(one, wrist_goal_w=np.array(goals))


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("name", ["root_pos_w", "local_quat"])
def test_human_clip_with_nan(name, bad):
    array = getattr(human(), name).copy()
    array.reshape(-1)[5] = bad
    with pytest.raises(BadMotion, match="clip-0: .*NaN or infinity"):
        replace(human(), **{name: array})


@pytest.mark.parametrize("name", ["root_pos_w", "root_quat_w", "joint_pos"])
def test_robot_clip_with_nan(name, tmp_path):
    robot().save(tmp_path / "m.npz")
    header, arrays = read_npz(tmp_path / "m.npz", "robot_motion")
    arrays[name].reshape(-1)[3] = np.nan
    write_npz(tmp_path / "m.npz", header, arrays)
    with pytest.raises(BadMotion, match="NaN"):
        RobotMotion.load(tmp_path / "m.npz")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"fps": 0.0}, "not a frame rate"),
        ({"fps": float("nan")}, "not a frame rate"),
        ({"root_pos_w": np.zeros((1, 3))}, "has 1 frames"),
        ({"root_pos_w": np.zeros((7, 2))}, "shape"),
        ({"joint_pos": np.zeros((7, 18))}, "shape"),
        ({"root_quat_w": np.full((7, 4), 0.9)}, "wxyz"),
        ({"root_quat_w": np.zeros((7, 4))}, "unit length"),
        ({"contacts": np.zeros((6, 1), bool)}, "contacts"),
    ],
)
def test_what_a_clip_must_be(change, message):
    with pytest.raises(BadMotion, match=message):
        replace(robot(), **change)


@pytest.mark.parametrize("order", ["xyzw", None])
def test_another_quaternion_order_is_refused(order, tmp_path):
    for motion, kind in ((human(), "human_motion"), (robot(), "robot_motion")):
        motion.save(tmp_path / "m.npz")
        header, arrays = read_npz(tmp_path / "m.npz", kind)
        write_npz(tmp_path / "m.npz", {**header, "quaternion_order": order}, arrays)
        with pytest.raises(BadMotion, match="wxyz"):
            type(motion).load(tmp_path / "m.npz")


def test_lengths_of_stored_quaternions_are_checked_before_they_are_mended(tmp_path):
    robot().save(tmp_path / "m.npz")
    header, arrays = read_npz(tmp_path / "m.npz", "robot_motion")
    write_npz(tmp_path / "m.npz", header, {**arrays, "root_quat_w": arrays["root_quat_w"] * np.float32(1.001)})
    np.testing.assert_allclose((RobotMotion.load(tmp_path / "m.npz").root_quat_w ** 2).sum(-1), 1, atol=1e-12)
    write_npz(tmp_path / "m.npz", header, {**arrays, "root_quat_w": arrays["root_quat_w"] * np.float32(1.1)})
    with pytest.raises(BadMotion, match="unit length"):
        RobotMotion.load(tmp_path / "m.npz")


def test_another_robot_is_refused(tmp_path):
    replace(robot(), robot="g1").save(tmp_path / "m.npz")
    with pytest.raises(BadMotion, match="robot 'g1', not of 'h1'"):
        RobotMotion.load(tmp_path / "m.npz", "h1")
    with pytest.raises(BadFile, match="holds 'robot_motion', expected 'human_motion'"):
        HumanMotion.load(tmp_path / "m.npz")


@pytest.mark.parametrize("missing", ["id", "fps", "joint_names", "schema", "style"])
def test_a_header_that_lacks_something(missing, tmp_path):
    human().save(tmp_path / "m.npz")
    header, arrays = read_npz(tmp_path / "m.npz", "human_motion")
    write_npz(tmp_path / "m.npz", {key: value for key, value in header.items() if key != missing}, arrays)
    with pytest.raises(BadMotion, match=missing):
        HumanMotion.load(tmp_path / "m.npz")


@pytest.mark.parametrize(
    "change", [{"fps": "fast"}, {"joint_names": 3}, {"parents": [0, 1, 2]}, {"parents": [-1, 0]}, {"fps": None}]
)
def test_a_header_that_says_something_else(change, tmp_path):
    human().save(tmp_path / "m.npz")
    header, arrays = read_npz(tmp_path / "m.npz", "human_motion")
    write_npz(tmp_path / "m.npz", {**header, **change}, arrays)
    with pytest.raises(BadMotion):
        HumanMotion.load(tmp_path / "m.npz")


def test_an_array_that_is_missing(tmp_path):
    robot().save(tmp_path / "m.npz")
    header, arrays = read_npz(tmp_path / "m.npz", "robot_motion")
    arrays.pop("joint_pos")
    write_npz(tmp_path / "m.npz", header, arrays)
    with pytest.raises(BadMotion, match="joint_pos"):
        RobotMotion.load(tmp_path / "m.npz")


def test_resampling_keeps_the_motion_and_its_contacts():
    motion = robot(31).resampled(50.0)
    assert motion.frames == 51 and motion.duration == pytest.approx(1.0)
    np.testing.assert_allclose(motion.root_pos_w[:, 0], np.arange(51) / 50, atol=1e-12)
    np.testing.assert_allclose(rot.yaw_of(motion.root_quat_w), 0.7 * np.arange(51) / 50, atol=1e-9)
    assert (
        motion.contacts.shape == (51, 1)
        and motion.contacts[0] == robot(31).contacts[0]
        and motion.contacts[-1] == robot(31).contacts[-1]
    )
    assert robot().resampled(30.0) is not None and robot(31).resampled(50.0).resampled(30.0).frames == 31


def test_skeletons():
    assert ARM.index("hand") == 2
    np.testing.assert_array_equal(ARM.scaled(1.1).offsets, 1.1 * ARM.offsets)
    with pytest.raises(BadMotion, match="no joint 'foot'; it has shoulder, elbow, hand"):
        ARM.index("foot")
    with pytest.raises(BadMotion, match="parents must come before"):
        replace(ARM, parents=(-1, 2, 1))


def test_thinning_keeps_every_nth_frame():
    motion = human(8)
    thin = motion.thinned(3)
    assert thin.fps == pytest.approx(motion.fps / 3) and thin.frames == (motion.frames + 2) // 3
    np.testing.assert_array_equal(thin.local_quat, motion.local_quat[::3])
    np.testing.assert_array_equal(thin.contacts, motion.contacts[::3])


@pytest.mark.parametrize("field", ["id", "object_id"])
@pytest.mark.parametrize("name", ["../elsewhere", "/tmp/x", ".hidden", "a\0b", 7])
def test_ids_that_lead_elsewhere_are_refused(field, name, tmp_path):
    for motion, kind in ((human(), "human_motion"), (robot(), "robot_motion")):
        motion.save(tmp_path / "m.npz")
        header, arrays = read_npz(tmp_path / "m.npz", kind)
        write_npz(tmp_path / "m.npz", {**header, field: name}, arrays)
        with pytest.raises(BadMotion, match="cannot be a file's name"):
            type(motion).load(tmp_path / "m.npz")
