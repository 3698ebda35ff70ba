"""Imports motions of SMPL, SMPL-H and SMPL-X as AMASS and many after it store them (`.npz`): rotation vectors,
translation, shape.

Where the file has the joints' positions, these are the bones. Where it has not, no body model is asked for either: the
bones are those of our skeleton, scaled so that the pelvis is as high, or that standing feet stand still.
"""

from pathlib import Path

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion
from mimicbench.core.foreign.untrusted import load_npz
from mimicbench.core.skeleton import Skeleton, forward_kinematics
from mimicbench.references.body.body import core4d_body
from mimicbench.references.body.skeletons import CORE4D
from mimicbench.references.importers.core4d import FEET, HEAD, check_joints, smpl_recording
from mimicbench.references.importers.format import Format
from mimicbench.references.importers.recording import (
    MAX_BYTES,
    Recording,
    Wishes,
    check_array,
    check_rate,
)
from mimicbench.references.importers.rest_pose import axis_up, guess_up
from mimicbench.references.importers.stride import stride_scale

RATES = ("mocap_framerate", "mocap_frame_rate", "fps", "frame_rate")
ROOTS, BODIES, PLACES = ("root_orient", "global_orient"), ("pose_body", "body_pose"), ("trans", "transl")
ANKLES = (7, 8)
TOE = 0.025
"""Height of SMPL's ball of the foot over the sole [m]."""
PELVIS = 0.02
"""How far SMPL's pelvis is above its translation, with z up [m]."""
SIZES = (0.75, 1.25)
"""Of people, over our skeleton's."""
DISAGREE = 0.2
"""If height and steps differ by more than this, as a logarithm, the floor is not at 0."""

_KNEE, _ANKLE, _ELBOW, _WRIST = (
    (0.0573, -0.4231, -0.0126),
    (-0.0392, -0.4470, -0.0307),
    (0.2753, -0.0765, -0.0368),
    (0.2776, 0.0204, -0.0050),
)


def _t_pose() -> Skeleton:
    """CORE4D's skeleton as SMPL rests: y up, facing +z, arms to the sides (the limbs of the same person's T-pose)."""
    offsets = CORE4D.offsets[:, [1, 2, 0]].copy()
    for joint, bone in (("knee", _KNEE), ("ankle", _ANKLE), ("elbow", _ELBOW), ("wrist", _WRIST)):
        offsets[CORE4D.index(f"left_{joint}")] = bone
        offsets[CORE4D.index(f"right_{joint}")] = np.array(bone) * (-1, 1, 1)
    return Skeleton("smpl", CORE4D.joint_names, CORE4D.parents, offsets)


T_POSE = _t_pose()


def import_amass(path: Path, wishes: Wishes) -> Recording:
    """Read one motion. Raises BadFile or BadMotion."""
    data = load_npz(path, MAX_BYTES, ["poses", *ROOTS, *BODIES, *PLACES, *RATES, "joints"])
    rotvec = _rotations(path, data)
    place = next((data[name] for name in PLACES if name in data), None)
    if place is None:
        raise BadMotion(f"{path} has no {' or '.join(PLACES)}; without it nobody gets anywhere: leave it out")
    trans = check_array(path, "trans", place, (3,))
    if len(trans) != len(rotvec):
        raise BadMotion(
            f"{path} has {len(rotvec)} frames of rotations and {len(trans)} of positions; it is damaged: get it again"
        )
    stored = next((data[name] for name in RATES if name in data), None)
    if stored is None and wishes.fps is None:
        raise BadMotion(f"{path} does not say its frame rate ({', '.join(RATES)}); say it (--fps)")
    fps = check_rate(path, stored, wishes)
    assumed = [f"{fps:g} frames per second, as {'told' if wishes.fps else 'the file says'}"]
    if "joints" in data:
        joints = check_joints(path, data["joints"], len(rotvec))
        assumed.append("the bones are as long as the stored joints are apart")
        up, why = _up(joints, wishes)
    else:
        bare, _ = forward_kinematics(T_POSE, np.zeros((len(trans), 3)), rot.from_rotvec(rotvec))
        up, why = _up(bare, wishes)
        size, said = _size(trans, bare, up, fps)
        joints = trans[:, None] + size * bare
        assumed.append(said)
    return smpl_recording(path, rotvec, joints, up, fps, [*assumed, why], wishes)


def _up(joints: np.ndarray, wishes: Wishes) -> tuple[str, str]:
    if wishes.up is not None:
        return wishes.up, f"{wishes.up} is up, as told"
    return guess_up(joints[:, HEAD] - joints[:, FEET].mean(1), "z+")


def _rotations(path: Path, data: dict) -> np.ndarray:
    """(T, 22, 3) rotation vectors of root and body, of which fingers and face were cut off. Raises BadMotion."""
    if "poses" in data:
        poses = data["poses"]
        width = poses.shape[1] if isinstance(poses, np.ndarray) and poses.ndim == 2 else 0
        if width < 66 or width % 3:
            raise BadMotion(
                f"{path}: poses has {width} numbers per frame, expected three for each of SMPL's 22 "
                "joints or more; it is in another format"
            )
        return check_array(path, "poses", poses, (width,), most=100.0)[:, :66].reshape(-1, 22, 3)
    root = next((data[name] for name in ROOTS if name in data), None)
    body = next((data[name] for name in BODIES if name in data), None)
    if (
        not isinstance(root, np.ndarray)
        or not isinstance(body, np.ndarray)
        or not min(root.ndim, body.ndim)
        or not len(root) == len(body)
        or not len(root)
    ):
        raise BadMotion(
            f"{path} has no poses, and no {ROOTS[0]} with {BODIES[0]} of as many frames; it is no motion of SMPL"
        )
    body = body.reshape(len(body), -1)
    if body.shape[1] < 63:
        raise BadMotion(
            f"{path}: {BODIES[0]} has {body.shape[1]} numbers per frame, expected three for each of "
            "21 joints or more; it is in another format"
        )
    whole = np.concatenate([root.reshape(len(root), -1)[:, :3], body[:, :63]], 1)
    return check_array(path, "the pose", whole, (66,), most=100.0).reshape(-1, 22, 3)


def _size(trans: np.ndarray, bare: np.ndarray, up: str, fps: float) -> tuple[float, str]:
    """How tall the person is over our skeleton, from the height over a floor at z = 0, or from the steps, and what to
    say about it.

    The translation is a constant away from the pelvis: with z up by about PELVIS of height only, with y up by about as
    much as a thigh's half.
    """
    _, turn = axis_up(up)
    place, body = rot.rotate(turn, trans), rot.rotate(turn, bare)
    stride = stride_scale(CORE4D, place[:, None] + body, fps)
    stride = stride if stride is not None and SIZES[0] <= stride <= SIZES[1] else None
    if up == "z+":
        size = _over_floor(place[:, 2] + PELVIS, body)
        if SIZES[0] <= size <= SIZES[1] and (stride is None or abs(np.log(size / stride)) < DISAGREE):
            return size, _said(size, "by how high the pelvis is over a floor at z = 0")
    if stride is not None:
        return stride, _said(stride, "so that feet stand still in walking")
    return 1.0, _said(1.0, "for want of anything to tell its size by")


def _over_floor(pelvis: np.ndarray, body: np.ndarray) -> float:
    """The size at which the lower sole is usually at 0 while the person is up, from the pelvis's height (T,) over the
    floor [m] and the joints (T, 22, 3) beside it of a person of size 1 [m].
    """
    person = core4d_body()
    ankle = body[:, ANKLES, 2] - body[:, :1, 2] - person.sole
    toe = body[:, FEET, 2] - body[:, :1, 2] - TOE
    reach = -np.minimum(ankle, toe).min(-1)
    up = reach >= 0.8 * np.quantile(reach, 0.98)
    return float(np.median(pelvis[up] / reach[up]))


def _said(size: float, how: str) -> str:
    return f"no joints are stored: bones are {size:.3f} times those of our 1.80 m tall skeleton, {how}"


FORMAT = Format(
    "amass", import_amass, lambda file: file.content == "zip" and bool(file.names & {"poses", *ROOTS, *BODIES})
)
