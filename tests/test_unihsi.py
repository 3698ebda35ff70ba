"""Real people: recordings are read exactly, their sitting parts found, and a chair fitted under each."""

import copy
import functools
import os
import pickle
from pathlib import Path

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadFile, BadMotion
from mimicbench.core.foreign.untrusted import load_restricted
from mimicbench.core.motion import HumanMotion
from mimicbench.core.skeleton import forward_kinematics
from mimicbench.references.body.body import unihsi_body
from mimicbench.references.body.skeletons import UNIHSI
from mimicbench.references.checks.contacts import drop_short
from mimicbench.references.importers.unihsi import import_skeleton_motion
from mimicbench.references.recordings.cutting import FPS, JUMP, smooth_jumps
from mimicbench.references.recordings.fit_object import seated_frame
from mimicbench.references.recordings.real_clips import sitting_clips
from mimicbench.references.recordings.segments import find_sittings

DATA = Path(__file__).parents[1].parent / "shared" / "data"
CLIPS = DATA / "unihsi" / "motion_clips"
SITTING = ("armchair", "armchair002", "chair_mo001", "chair_mo012")

real = pytest.mark.skipif(not CLIPS.is_dir(), reason=f"the real recordings are not at {CLIPS}")


def made_up(seconds=8.0, fps=30):
    """A recording as the format has it: somebody glides back to a seat 0.37 m high and sits down over fixed feet."""
    frames = int(seconds * fps)
    time = np.arange(frames) / fps
    ease = np.clip((time - 4) / 1.5, 0, 1)
    hip = -np.pi / 2 * ease**2 * (3 - 2 * ease)
    thigh = 0.421546
    root = np.stack(
        [np.maximum(2 - 0.5 * time, 0) + thigh * np.sin(hip), 0.3 + 0 * time, 0.88 - thigh * (1 - np.cos(hip))], -1
    )
    quat = np.zeros((frames, 15, 4))
    quat[..., 0] = 1
    for upper, lower in (("left_thigh", "left_shin"), ("right_thigh", "right_shin")):
        quat[:, UNIHSI.index(upper)] = np.stack([np.cos(hip / 2), 0 * hip, np.sin(hip / 2), 0 * hip], -1)
        quat[:, UNIHSI.index(lower)] = np.stack([np.cos(hip / 2), 0 * hip, -np.sin(hip / 2), 0 * hip], -1)
    return {
        "__name__": "SkeletonMotion",
        "is_local": True,
        "fps": fps,
        "rotation": {"arr": quat[..., [1, 2, 3, 0]].astype(np.float32)},
        "root_translation": {"arr": root.astype(np.float32)},
        "skeleton_tree": {
            "node_names": list(UNIHSI.joint_names),
            "parent_indices": {"arr": np.array(UNIHSI.parents)},
            "local_translation": {"arr": UNIHSI.offsets.astype(np.float32)},
        },
    }


def write(folder: Path, data, name="clip.npy") -> Path:
    path = folder / name
    np.save(path, np.array(data, dtype=object), allow_pickle=True)
    return path


@functools.cache
def imported(name: str):
    return sitting_clips(import_skeleton_motion(CLIPS / f"{name}.npy"), "sit-chair")


def test_a_made_up_recording_comes_out_as_it_went_in(tmp_path):
    data = made_up()
    motion = import_skeleton_motion(write(tmp_path, data))
    np.testing.assert_allclose(motion.local_quat, data["rotation"]["arr"][..., [3, 0, 1, 2]], atol=1e-6)
    # standing legs are 0.8814 m long with the soles, so the pelvis at 0.88 m puts the floor at -0.0014 m
    np.testing.assert_allclose(motion.root_pos_w[:, 2], data["root_translation"]["arr"][:, 2] + 0.001416, atol=1e-5)
    assert motion.fps == 30 and len(motion.assumed) == 3


def test_a_made_up_person_gets_a_chair(tmp_path):
    [(motion, chair)] = sitting_clips(import_skeleton_motion(write(tmp_path, made_up(), "made.npy")), "sit-chair")
    assert (motion.id, motion.object_id, chair.id, motion.source) == (
        "real-made-0",
        "fitted-made-0",
        "fitted-made-0",
        "made",
    )
    assert abs(chair.seat_height - (0.88 - 0.421546 + 0.0014 - unihsi_body().buttock)) < 2e-3
    origin, yaw, _ = seated_frame(motion, slice(motion.frames - 30, None))
    assert abs(origin[1]) < 1e-3 and abs(yaw) < 1e-3
    assert motion.contacts[-10:].all(), "both feet and the pelvis bear"
    assert not motion.contacts[:30, 2].any()


def test_world_rotations_are_made_local(tmp_path):
    data = made_up()
    local = data["rotation"]["arr"][..., [3, 0, 1, 2]].astype(float)
    _, world = forward_kinematics(UNIHSI, data["root_translation"]["arr"].astype(float), local)
    data["rotation"]["arr"], data["is_local"] = world[..., [1, 2, 3, 0]], False
    motion = import_skeleton_motion(write(tmp_path, data))
    assert rot.angle_between(motion.local_quat, local).max() < 1e-5
    assert any("relative to the parents" in line for line in motion.assumed)


def armed(data):
    """The same person with ASE's sword in the hand and shield on the arm, numbered as in ASE's files."""
    tree, names = data["skeleton_tree"], list(UNIHSI.joint_names)
    for name, on in (("sword", "right_hand"), ("shield", "left_lower_arm")):
        at = names.index(on) + 1
        names.insert(at, name)
        for key in ("rotation", "global_velocity"):
            if key in data:
                data[key]["arr"] = np.insert(data[key]["arr"], at, data[key]["arr"][:, at - 1], axis=1)
        tree["local_translation"]["arr"] = np.insert(tree["local_translation"]["arr"], at, 0.1, axis=0)
    above = dict(zip(UNIHSI.joint_names, (UNIHSI.joint_names[max(p, 0)] for p in UNIHSI.parents), strict=True))
    above |= {"sword": "right_hand", "shield": "left_lower_arm"}
    tree["node_names"] = names
    tree["parent_indices"]["arr"] = np.array([-1 if name == "pelvis" else names.index(above[name]) for name in names])
    return data


def test_a_sword_and_a_shield_are_dropped(tmp_path):
    bare = made_up()
    pos, _ = forward_kinematics(
        UNIHSI, bare["root_translation"]["arr"].astype(float), bare["rotation"]["arr"][..., [3, 0, 1, 2]].astype(float)
    )
    bare["global_velocity"] = {"arr": np.gradient(pos, 1 / 30, axis=0)}
    plain = import_skeleton_motion(write(tmp_path, bare))
    motion = import_skeleton_motion(write(tmp_path, armed(copy.deepcopy(bare))))
    np.testing.assert_array_equal(motion.local_quat, plain.local_quat)
    assert any("sword, shield: no parts of a person" in line for line in motion.assumed)
    data = armed(copy.deepcopy(bare))
    data["skeleton_tree"]["parent_indices"]["arr"][5] = data["skeleton_tree"]["node_names"].index("left_hand")
    with pytest.raises(BadMotion, match="right_hand hangs on left_hand, expected right_lower_arm"):
        import_skeleton_motion(write(tmp_path, data))
    with pytest.raises(BadMotion, match="lacks right_upper_arm and has right_wing;"):
        import_skeleton_motion(write(tmp_path, renamed()))


def test_a_backflip_is_done_by_a_person(tmp_path):
    """The pelvis is highest while it is upside down."""
    data = made_up(3.0)
    frames = len(data["root_translation"]["arr"])
    turn = 2 * np.pi * np.clip((np.arange(frames) / 30 - 1) / 0.9, 0, 1)
    data["rotation"]["arr"][:, 0] = np.stack([0 * turn, -np.sin(turn / 2), 0 * turn, np.cos(turn / 2)], -1)
    data["root_translation"]["arr"][:, 2] += 0.4 * (1 - np.cos(turn)) + 0.1 * np.sin(turn / 2)
    motion = import_skeleton_motion(write(tmp_path, data))
    upright = rot.rotate(motion.local_quat[:, 0], np.array([0.0, 0.0, 1.0]))[:, 2]
    assert upright[motion.root_pos_w[:, 2].argmax()] < -0.9, "the highest frame is upside down"
    np.testing.assert_allclose(motion.root_pos_w[0, 2], 0.8814, atol=1e-3)


def test_labels_lose_their_noise():
    label = np.array([1, 1, 0, 1, 1, 1, 0, 0, 0, 0, 1, 0, 0, 0], bool)
    np.testing.assert_array_equal(drop_short(label, 3), np.array([1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0], bool))


def test_a_jump_is_bridged():
    angle = np.where(np.arange(40) < 20, 0.0, 1.2)
    quat = rot.from_rotvec(angle[:, None, None] * np.array([0.0, 0.0, 1.0]))
    smooth = smooth_jumps(quat, 30.0)
    speed = np.linalg.norm(rot.to_rotvec(rot.multiply(rot.conjugate(smooth[:-1]), smooth[1:])), axis=-1) * 30
    assert speed.max() < 6
    np.testing.assert_allclose(smooth[[0, 10, 30, 39]], quat[[0, 10, 30, 39]], atol=1e-12)


@pytest.mark.parametrize(("frame", "size"), [(1, 1.5), (20, 3.0), (39, 1.5)])
def test_a_bridge_is_as_long_as_a_jump_needs(frame, size):
    """A fast turn is no more than a jump, also where the clip ends."""
    angle = np.where(np.arange(40) < frame, 0.0, size)
    smooth = smooth_jumps(rot.from_rotvec(angle[:, None, None] * np.array([0.0, 0.0, 1.0])), 30.0)
    speed = np.linalg.norm(rot.to_rotvec(rot.multiply(rot.conjugate(smooth[:-1]), smooth[1:])), axis=-1) * 30
    assert speed.max() <= JUMP


def broken(**changes):
    data = copy.deepcopy(made_up())
    data.update(changes)
    return data


def with_array(key, change):
    data = made_up()
    data[key]["arr"] = change(data[key]["arr"].copy())
    return data


def renamed():
    data = made_up()
    data["skeleton_tree"]["node_names"][3] = "right_wing"
    return data


def set_nan(array):
    array[5] = np.nan
    return array


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (broken(__name__="SkeletonState"), "SkeletonState"),
        (broken(__name__=np.zeros(3)), "holds 'dict', not a SkeletonMotion"),
        ([1, 2], "ndarray"),
        (with_array("rotation", lambda a: 1.2 * a), "unit length"),
        (with_array("rotation", set_nan), "NaN"),
        (with_array("root_translation", set_nan), "NaN"),
        (with_array("rotation", lambda a: a[:0]), "0 frames"),
        (with_array("rotation", lambda a: a[:-3]), "frames of rotations"),
        (with_array("rotation", lambda a: a[..., :3]), "shape"),
        (with_array("rotation", lambda a: a[..., [3, 0, 1, 2]]), "wxyz where this format has xyzw"),
        (with_array("root_translation", lambda a: a * 1e6), "not in meters"),
        (renamed(), "another skeleton"),
        (broken(skeleton_tree=None), "another skeleton"),
        (broken(fps=0), "frame rate"),
        (broken(fps=float("nan")), "frame rate"),
        (broken(fps="30"), "frame rate"),
        (broken(is_local=None), "local"),
        (broken(global_velocity={"arr": np.full((240, 15, 3), 2.0)}), "stored velocities fit"),
    ],
)
def test_each_fault_has_one_clear_sentence(tmp_path, data, says):
    with pytest.raises(BadMotion, match=says) as caught:
        import_skeleton_motion(write(tmp_path, data))
    assert "\n" not in str(caught.value)


def test_a_walk_is_not_a_sitting(tmp_path):
    data = made_up()
    data["root_translation"]["arr"][:, 2] = 0.88
    with pytest.raises(BadMotion, match="walks up and sits down"):
        sitting_clips(import_skeleton_motion(write(tmp_path, data)), "sit-chair")


def test_a_pickle_that_calls_something_is_refused(tmp_path):
    trace = tmp_path / "trace"

    class Evil:
        def __reduce__(self):
            return os.system, (f"touch {trace}",)

    for raw in (made_up() | {"rotation": Evil()}, Evil()):
        with pytest.raises(BadFile, match="system"):
            sitting_clips(import_skeleton_motion(write(tmp_path, raw)), "sit-chair")
        path = tmp_path / "plain.npy"
        path.write_bytes(pickle.dumps(raw))
        with pytest.raises(BadFile, match="system"):
            sitting_clips(import_skeleton_motion(path), "sit-chair")
    assert not trace.exists()


def test_cut_off_anywhere_is_one_error(tmp_path):
    raw = write(tmp_path, made_up(seconds=1.0)).read_bytes()
    path = tmp_path / "cut.npy"
    for length in np.linspace(0, len(raw) - 1, 60).astype(int):
        path.write_bytes(raw[:length])
        with pytest.raises(BadFile):
            import_skeleton_motion(path)


def test_mutated_files_are_read_or_refused(tmp_path):
    raw = write(tmp_path, made_up(seconds=3.0)).read_bytes()
    path = tmp_path / "mutated.npy"
    random = np.random.default_rng(0)
    # most bytes are numbers of the motion: aim at the structure around them, too
    structure = [i for i in range(len(raw)) if i < 600 or i > len(raw) - 900]
    outcomes = {"read": 0, "refused": 0}
    for i in range(200):
        changed = bytearray(raw)
        for _ in range(int(random.integers(1, 4))):
            place = int(random.choice(structure)) if i % 3 else int(random.integers(len(raw)))
            changed[place] = int(random.integers(256))
        path.write_bytes(bytes(changed))
        try:
            recording = import_skeleton_motion(path)
            pos, _ = forward_kinematics(recording.skeleton, recording.root_pos_w, recording.local_quat)
            find_sittings(recording.skeleton, pos, recording.fps)
            outcomes["read"] += 1
        except (BadFile, BadMotion) as error:
            assert "\n" not in str(error)
            outcomes["refused"] += 1
    assert outcomes["refused"] > 50 and outcomes["read"] > 10, outcomes


@real
@pytest.mark.parametrize(
    "path", sorted(CLIPS.glob("*.npy")) + [DATA / "ase" / "amp_humanoid_walk.npy"], ids=lambda path: path.stem[:20]
)
def test_forward_kinematics_agrees_with_the_stored_velocities(path):
    data = load_restricted(path, 1 << 26)
    recording = import_skeleton_motion(path)
    pos, _ = forward_kinematics(recording.skeleton, recording.root_pos_w, recording.local_quat)
    # the files store velocities smoothed by a Gaussian of two frames
    velocity = gaussian_filter1d(np.gradient(pos, 1 / recording.fps, axis=0), 2, axis=0, mode="nearest")
    stored = data["global_velocity"]["arr"]
    assert np.sqrt(((velocity - stored) ** 2).mean() / (stored**2).mean()) < 1e-4


@real
@pytest.mark.parametrize("name", SITTING)
def test_every_real_sitting_gets_a_chair(name):
    clips = imported(name)
    assert len(clips) == 1
    for motion, chair in clips:
        assert motion.fps == FPS and motion.task == "sit-chair" and motion.object_id == chair.id
        assert 3 < motion.duration < 10
        assert 0.34 <= chair.seat_height <= 0.44, "a real seat of about 0.36 to 0.40 m"
        end, start = motion.root_pos_w[-1], motion.root_pos_w[0]
        low, high = chair.seat_polygon.min(0), chair.seat_polygon.max(0)
        assert (end[:2] > low).all() and (end[:2] < high).all(), "the person ends on the seat"
        assert abs(end[2] - unihsi_body().buttock - chair.seat_height) < 0.02
        assert np.linalg.norm(start[:2]) < 2.4 and not chair.contains_xy(start), "and starts beside the chair, near it"
        assert motion.contacts[-20:, 2].all() and not motion.contacts[:30, 2].any()
        assert 0.2 < motion.contacts[:, :2].mean() < 0.95
        _, yaw, _ = seated_frame(motion, slice(motion.frames - 45, None))
        assert abs(yaw) < 0.05


@real
@pytest.mark.parametrize("name", SITTING)
def test_nobody_walks_or_sits_through_the_chair(name):
    from mimicbench.references.checks.quality import check_clip

    for motion, chair in imported(name):
        measures = check_clip(motion, chair)
        assert measures["object_depth"] < 0.03
        assert measures["joint_speed"] < 12
        assert measures["floor_depth"] < 0.06, "real ankles are noisy"


@real
def test_real_clips_survive_saving(tmp_path):
    motion, chair = imported(SITTING[0])[0]
    motion.save(tmp_path / "clip.npz")
    again = HumanMotion.load(tmp_path / "clip.npz")
    np.testing.assert_allclose(again.root_pos_w, motion.root_pos_w, atol=1e-6)
    assert again.contact_names == motion.contact_names and (again.contacts == motion.contacts).all()
    assert again.source == "armchair" and chair.id == again.object_id


@real
@pytest.mark.parametrize("name", ["lie_down", "lie_down_2", "lie_down_10", "locomotion_random"])
def test_lying_and_walking_are_left_out(name):
    with pytest.raises(BadMotion, match="walks up and sits down"):
        sitting_clips(import_skeleton_motion(CLIPS / f"{name}.npy"), "sit-chair")
