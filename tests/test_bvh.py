"""BVH of other programs: other rest poses, units, names, joints and feet than ours, each as real files have them."""

import re
from pathlib import Path

import numpy as np
import pytest

import recordings
from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion, MimicbenchError
from mimicbench.core.skeleton import forward_kinematics
from mimicbench.references.body.body import roam_body
from mimicbench.references.body.skeletons import ROAM
from mimicbench.references.checks.contacts import sole_points
from mimicbench.references.importers.bvh_file import read_bvh, world
from mimicbench.references.importers.joint_names import find_limbs, split_name
from mimicbench.references.importers.recording import Wishes
from mimicbench.references.importers.registry import import_recording
from mimicbench.references.importers.rest_pose import axis_up

MORE = Path(__file__).parents[1].parent / "shared" / "data" / "more" / "bvh"
LEGS = float(np.linalg.norm(ROAM.offsets[[18, 19]], axis=-1).sum())


def standing(seconds=1.0, then=1.5, seed=0):
    """Somebody who stands still at first, then moves all joints a little."""
    root, quat = recordings.made_up(ROAM, round(then * 30), seed)
    still = round(seconds * 30)
    return np.concatenate([np.repeat(root[:1], still, 0), root]), np.concatenate([np.repeat(quat[:1], still, 0), quat])


def along_x(hips: str) -> np.ndarray:
    """(27, 4) frames of a zero pose in which legs and spine point along +x, with the hips along `hips`."""
    frames = np.tile(rot.IDENTITY, (27, 1))
    smpl = rot.to_matrix(recordings.SMPL_FRAME)
    for j, name in enumerate(ROAM.joint_names):
        leg = any(part in name for part in ("UpLeg", "Leg", "Foot", "Toe"))
        trunk = any(part in name for part in ("Spine", "Neck", "Head", "Hips"))
        if not leg and not trunk:
            continue
        # columns: where x, y and z of the joint's own frame are in our rest pose
        x = np.array([0.0, 0, -1]) if leg else np.array([0.0, 0, 1])
        left = np.array([0.0, 1, 0])
        if hips == "x":  # as Rokoko: pelvis upright, hips across; only what hangs on it lies along x
            if name == "Hips":
                continue
            z = left if leg else -left
        else:
            z = left
        frames[j] = rot.from_matrix(smpl.T @ np.stack([x, np.cross(z, x), z], -1))
    return frames


@pytest.mark.parametrize("hips", ["z", "x"])
def test_legs_and_spine_along_one_axis_are_nobody_who_stands(tmp_path, hips):
    """LAFAN1 rests with legs and spine along +x, Rokoko with both legs along the line of the hips."""
    root, quat = standing()
    path = recordings.bvh(tmp_path / "take.bvh", 0.01, joint_frames=along_x(hips), motion=(root, quat))
    recording = import_recording(path)
    assert any("most upright" in line for line in recording.assumed)
    pos, expected = recording.forward_kinematics()[0], forward_kinematics(ROAM, root, quat)[0]
    np.testing.assert_allclose(pos - pos[:1, :1], expected - expected[:1, :1], atol=1e-4)
    trunk = [0, 1, 2, 3, 4, 5, 6, 7, 17, 18, 19, 22, 23, 24]
    assert rot.angle_between(recording.local_quat, quat)[:, trunk].max() < 0.02


def test_the_unit_is_one_that_gives_a_persons_legs(tmp_path):
    path = recordings.bvh(tmp_path / "take.bvh", unit=LEGS / 21.7)
    recording = import_recording(path)
    assert any(line.startswith("the unit is in: so the legs are 0.55 m long") for line in recording.assumed)
    assert any("m tall: look" in line for line in recording.assumed)
    told = import_recording(path, wishes=Wishes(scale=LEGS / 21.7))
    np.testing.assert_allclose(told.skeleton.offsets, ROAM.offsets, atol=1e-4)
    assert not any("m tall" in line for line in told.assumed)
    giant = import_recording(recordings.bvh(tmp_path / "giant.bvh", unit=0.01), wishes=Wishes(scale=0.014))
    assert any("m tall: look whether the unit" in line for line in giant.assumed)
    with pytest.raises(BadMotion, match="--scale"):
        import_recording(recordings.bvh(tmp_path / "odd.bvh", unit=0.2))


@pytest.mark.parametrize("wishes", [{"floor": np.nan}, {"fps": 0.0}, {"scale": -1.0}, {"scale": 1.0, "unit": "m"}])
def test_wishes_that_cannot_be(wishes):
    with pytest.raises(MimicbenchError, match=f"--{next(iter(wishes))}"):
        Wishes(**wishes)


def test_rows_after_the_last_frame_are_left_out(tmp_path):
    path = recordings.bvh(tmp_path / "take.bvh")
    whole = import_recording(path)
    text = path.read_text()
    path.write_text(text + text.splitlines()[-1] + "\n")
    more = import_recording(path)
    assert any("1 rows after its 45 frames" in line for line in more.assumed)
    np.testing.assert_array_equal(more.local_quat, whole.local_quat)
    path.write_text(text + "0.5 0.5\n")
    with pytest.raises(BadMotion, match="damaged"):
        import_recording(path)


def test_names_that_say_that_they_are_joints(tmp_path):
    assert split_name("LeftUpLeg_jnt") == split_name("jnt_l_upleg") == ("left", "upleg")
    recording = import_recording(recordings.bvh(tmp_path / "take.bvh", rename=lambda name: f"{name}_jnt"))
    np.testing.assert_allclose(recording.skeleton.offsets, ROAM.offsets, atol=1e-4)


def test_hips_that_move_against_the_pelvis_keep_the_ankles(tmp_path):
    """LHipJoint turns by a radian and so moves the thigh's joint by 8 cm."""
    root, quat = standing()
    # so that legs can reach: the knees are bent
    for joint, angle in ((17, -0.5), (18, 1.0), (19, -0.5), (22, -0.5), (23, 1.0), (24, -0.5)):
        bend = rot.from_rotvec(np.array([0.0, angle, 0.0]))
        quat[:, joint] = rot.multiply(quat[:, joint], bend)
    angle = 0.9 * np.sin(np.linspace(0, 6, len(root)))
    swing = rot.from_rotvec(angle[:, None] * np.array([0.0, 0.0, 1.0]))
    path = recordings.bvh(tmp_path / "take.bvh", 0.01, motion=(root, quat), hip_joint=swing)
    bvh = read_bvh(path)
    stored = 0.01 * rot.rotate(axis_up("y+")[1], world(bvh)[0])
    hips = stored[:, bvh.names.index("LeftUpLeg")] - stored[:, 0]
    assert np.ptp(hips, axis=0).max() > 0.05, "the file's hips move"
    recording = import_recording(path)
    assert any("hips move against the pelvis" in line for line in recording.assumed)
    pos = recording.forward_kinematics()[0]
    for name in ("LeftFoot", "RightFoot", "LeftHand", "Head"):
        moved = pos[:, ROAM.index(name)] - pos[:, 0] - (stored[:, bvh.names.index(name)] - stored[:, 0])
        assert np.abs(moved).max() < 0.01, name


@pytest.mark.parametrize("roll", [15.0, 36.0])
def test_feet_are_level_where_they_stand_whatever_the_rest_pose(tmp_path, roll):
    """CMU's skeletons rest with rolled feet, others on tiptoe."""
    root, quat = standing()
    frames = np.tile(rot.IDENTITY, (27, 1))
    smpl = recordings.SMPL_FRAME
    for side, axis in (("Left", [1.0, 0, 0]), ("Right", [0, 1.0, 0])):
        turn = rot.from_rotvec(np.radians(roll) * np.array(axis))
        for part in ("Foot", "ToeBase", "ToeBaseSite"):
            frames[ROAM.index(side + part)] = rot.multiply(rot.conjugate(smpl), rot.multiply(turn, smpl))
    path = recordings.bvh(tmp_path / "take.bvh", 0.01, joint_frames=frames, motion=(root, quat))
    recording = import_recording(path)
    assert sum(f"foot is {roll:.0f} degrees off level" in line for line in recording.assumed) == 2
    body = roam_body()
    pos, world_quat = recording.forward_kinematics()
    for leg in body.legs:
        sole = sole_points(body, pos[:30, leg.end], world_quat[:30, leg.end])
        np.testing.assert_allclose(sole[..., 2], 0.0, atol=0.01)
    np.testing.assert_allclose(pos[:30, body.legs[0].end, 2], body.sole, atol=0.01)


def test_level_feet_of_a_rest_pose_stay_as_they_are(tmp_path):
    root, quat = standing()
    recording = import_recording(recordings.bvh(tmp_path / "take.bvh", motion=(root, quat)))
    assert not any("off level" in line for line in recording.assumed)
    assert rot.angle_between(recording.local_quat, quat).max() < 2e-3


def test_who_hops_is_on_the_floor_when_lowest(tmp_path):
    root, quat = standing()
    hop = np.abs(np.sin(np.linspace(0, 12, len(root))))
    root[:, 2] += 0.3 * hop
    recording = import_recording(recordings.bvh(tmp_path / "take.bvh", motion=(root, quat)))
    lowest = recording.root_pos_w[:, 2].min()
    assert lowest == pytest.approx(roam_body().standing_height, abs=0.05)


@pytest.mark.skipif(not MORE.is_dir(), reason=f"the real recordings are not at {MORE}")
@pytest.mark.parametrize(
    ("name", "tall"),
    [
        ("inches_dab", (1.1, 1.3)),
        ("lafan1_dance1_subject1_crop", (1.6, 1.95)),
        ("lafan1_walk1_subject1_stop", (1.6, 1.95)),
        ("rokoko_dance", (1.6, 1.95)),
    ],
)
def test_real_files_stand_on_their_floor(name, tall):
    recording = import_recording(MORE / f"{name}.bvh")
    floor = next(line for line in recording.assumed if line.startswith("the floor"))
    assert abs(float(floor.split("z = ")[1].split()[0])) < 0.05, "the recorder's own floor is at 0"
    pos, quat = recording.forward_kinematics()
    body = roam_body()
    assert tall[0] < pos[:, ROAM.index("HeadSite"), 2].max() + 0.05 < tall[1] + 0.4
    legs = [pos[:, leg.end] for leg in body.legs]
    low = np.minimum(legs[0][:, 2], legs[1][:, 2])
    assert np.quantile(low, 0.02) > 0.02, "no ankle is in the floor"
    across = pos[:, body.legs[0].root] - pos[:, body.legs[1].root]
    left = rot.rotate(quat[:, 0], np.array([0.0, 1.0, 0.0]))
    assert ((across * left).sum(-1) > 0.9 * np.linalg.norm(across, axis=-1)).all(), "left is left"


@pytest.mark.skipif(not MORE.is_dir(), reason=f"the real recordings are not at {MORE}")
@pytest.mark.parametrize("name", ["inches_dab", "lafan1_walk1_subject1_stop", "rokoko_dance"])
def test_who_is_mirrored_is_refused(name, tmp_path):
    """Which way people face follows from where left and right are; that knees bend forward does not."""
    text = (MORE / f"{name}.bvh").read_text()
    swapped = re.sub("left|right", lambda side: SIDES[side[0].lower()](side[0]), text, flags=re.IGNORECASE)
    assert swapped != text
    path = tmp_path / "mirrored.bvh"
    path.write_text(swapped)
    with pytest.raises(BadMotion, match="its knees bend backward; left and right are exchanged"):
        import_recording(path)


def _like(word):
    """The word in the case of the one that it replaces."""
    return lambda old: word.title() if old.istitle() else word.upper() if old.isupper() else word


SIDES = {"left": _like("right"), "right": _like("left")}
SMPL = {
    "LeftUpLeg": "left_hip", "LeftLeg": "left_knee", "LeftFoot": "left_ankle", "LeftToeBase": "left_foot",
    "LeftArm": "left_shoulder", "LeftForeArm": "left_elbow", "LeftHand": "left_wrist",
    "RightUpLeg": "right_hip", "RightLeg": "right_knee", "RightFoot": "right_ankle", "RightToeBase": "right_foot",
    "RightArm": "right_shoulder", "RightForeArm": "right_elbow", "RightHand": "right_wrist",
}  # fmt: skip


def test_feet_and_hands_that_hang_from_ankles_and_wrists_are_toes_and_fingers():
    path = Path("smpl.bvh")
    names = ["pelvis", "left_hip", "left_knee", "left_ankle", "left_foot", "right_hip", "right_knee", "right_ankle"]
    names += ["right_foot", "head"]
    parents = [-1, 0, 1, 2, 3, 0, 5, 6, 7, 0]
    for side in ("left", "right"):
        for joint in ("collar", "shoulder", "elbow", "wrist", "hand"):
            parents.append(0 if joint == "collar" else len(names) - 1)
            names.append(f"{side}_{joint}")
    limbs = find_limbs(path, names, parents)
    assert [names[j] for j in limbs.legs[0]] == ["left_hip", "left_knee", "left_ankle"]
    assert [names[j] for j in limbs.arms[1]] == ["right_shoulder", "right_elbow", "right_wrist"]
    assert [names[j] for j in limbs.toes] == ["left_foot", "right_foot"]


def test_smpls_names_give_the_same_person(tmp_path):
    one = import_recording(recordings.bvh(tmp_path / "one.bvh"))
    other = import_recording(recordings.bvh(tmp_path / "other.bvh", rename=lambda name: SMPL.get(name, name)))
    np.testing.assert_allclose(other.skeleton.offsets, one.skeleton.offsets, atol=1e-9)
    np.testing.assert_allclose(other.root_pos_w, one.root_pos_w, atol=1e-9)


@pytest.mark.parametrize("more", ["\n# made by nobody\n", "\x1a"])
def test_words_after_the_last_frame_do_no_harm(tmp_path, more):
    path = recordings.bvh(tmp_path / "take.bvh")
    whole = import_recording(path)
    path.write_text(path.read_text() + more)
    np.testing.assert_array_equal(import_recording(path).local_quat, whole.local_quat)
