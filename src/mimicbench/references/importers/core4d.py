"""Imports CORE4D's people: SMPL-X parameters with stored joints (`person1_poses.npz`), beside the track of their
object.

Also home of what all of SMPL's family share: the rest pose (a T-pose, y up, facing +z) and the 22 joints of the body.
No body model is
needed: the bones are where the stored joints are.
"""

from pathlib import Path

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion
from mimicbench.core.foreign.untrusted import load_npz, load_restricted
from mimicbench.references.body.body import core4d_body
from mimicbench.references.body.skeletons import CORE4D
from mimicbench.references.importers.format import Format
from mimicbench.references.importers.recording import (
    MAX_BYTES,
    ObjectTrack,
    Recording,
    Wishes,
    check_array,
    check_rate,
    finish,
)
from mimicbench.references.importers.rest_pose import Adopted, adopt, axis_up, hanging_turns, into_our_rest

FPS = 15.0
"""Of CORE4D's real motions."""
OBJECT_POSES = "smooth_objposes.npy"
FEET, HEAD = (10, 11), 15
SLACK = 0.02
"""Stored joints may be off from what bones of constant length allow by this [m]."""


def import_core4d(path: Path, wishes: Wishes) -> Recording:
    """Read one person. The object's poses are taken from `smooth_objposes.npy` in the same folder, if there.

    Raises BadFile or BadMotion.
    """
    person = load_npz(path, MAX_BYTES, ["arr_0"]).get("arr_0")
    if not isinstance(person, dict) or not {"global_orient", "body_pose", "joints"} <= set(person):
        raise BadMotion(f"{path} has no global_orient, body_pose and joints; give a person's poses of CORE4D")
    root, rest = (
        check_array(path, "global_orient", person["global_orient"], (3,)),
        check_array(path, "body_pose", person["body_pose"], (21, 3)),
    )
    if len(root) != len(rest):
        raise BadMotion(
            f"{path} has {len(root)} frames of global_orient and {len(rest)} of body_pose; it is damaged: get it again"
        )
    rotvec = np.concatenate([root[:, None], rest], 1)
    joints = check_joints(path, person["joints"], len(rotvec))
    up = wishes.up or "y+"
    assumed = [
        "y is up and lengths are in meters, as in all of CORE4D" if wishes.up is None else f"{up} is up, as told"
    ]
    fps = check_rate(path, FPS, wishes)
    assumed.append(
        "15 frames per second, as in CORE4D's real motions"
        if wishes.fps is None
        else f"{fps:g} frames per second, as told"
    )
    track, said = _object_track(path, len(rotvec), up)
    return smpl_recording(path, rotvec, joints, up, fps, [*assumed, said], wishes, track)


def smpl_recording(
    path: Path,
    rotvec: np.ndarray,
    joints: np.ndarray,
    up: str,
    fps: float,
    assumed: list[str],
    wishes: Wishes,
    track: ObjectTrack | None = None,
) -> Recording:
    """A recording from SMPL's rotations (T, 22, 3) [rad] and joints (T, 22+, 3) [m] in a world in which `up` points up.

    Raises BadMotion.
    """
    body = core4d_body()
    _, turn = axis_up(up)
    quat = rot.multiply(turn, world_rotations(rotvec))
    adopted = adopt(CORE4D, range(22), rot.rotate(turn, joints[:, :22]), quat)
    if adopted.residual > SLACK:
        raise BadMotion(
            f"{path}: its joints and its rotations disagree by {adopted.residual:.2g} m; it is "
            "damaged, or they belong to different people"
        )
    skeleton, local = into_our_rest(body, adopted, smpl_turns(path, adopted))
    recording = Recording(path.stem, skeleton, fps, adopted.pos, local, tuple(assumed), track, wishes)
    return finish(path, recording)


def smpl_turns(path: Path, adopted: Adopted) -> np.ndarray:
    """The constant rotations (22, 4) from SMPL's rest pose into ours. Raises BadMotion."""
    try:
        return hanging_turns(core4d_body(), adopted.offsets, np.tile(rot.IDENTITY, (22, 1)), np.array([0.0, 1.0, 0.0]))
    except BadMotion as error:
        raise BadMotion(f"{path}: {error}; its joints are not in the order of SMPL, or it is damaged") from None


def world_rotations(rotvec: np.ndarray) -> np.ndarray:
    """(T, 22, 4) orientations of SMPL's joints in the file's world, from rotation vectors relative to the parents
    [rad].
    """
    local = rot.from_rotvec(rotvec)
    world = local.copy()
    for j, parent in enumerate(CORE4D.parents):
        if parent >= 0:
            world[:, j] = rot.multiply(world[:, parent], local[:, j])
    return world


def check_joints(path: Path, value: object, frames: int) -> np.ndarray:
    """Stored positions (T, 22 or more, 3) [m] for as many frames as there are rotations. Raises BadMotion."""
    count = value.shape[1] if isinstance(value, np.ndarray) and value.ndim == 3 else 0
    if count < 22:
        raise BadMotion(
            f"{path}: joints has {count} joints, expected the 22 of SMPL's body or more; it is "
            "damaged or in another format"
        )
    joints = check_array(path, "joints", value, (count, 3))
    if len(joints) != frames:
        raise BadMotion(
            f"{path} has {frames} frames of rotations and {len(joints)} of joints; it is damaged: get it again"
        )
    return joints


def _object_track(path: Path, frames: int, up: str) -> tuple[ObjectTrack | None, str]:
    """The object's track in a world with z up, and what to say about it."""
    file = path.with_name(OBJECT_POSES)
    if not file.is_file():
        return None, f"no object: there is no {OBJECT_POSES} beside it"
    poses = check_array(file, "the object's poses", load_restricted(file, MAX_BYTES), (4, 4))
    turns = poses[:, :3, :3]
    if len(poses) != frames:
        raise BadMotion(
            f"{file} has {len(poses)} poses, but {path.name} has {frames} frames; they do not belong "
            "together: get them again"
        )
    if np.abs(turns @ turns.swapaxes(-1, -2) - np.eye(3)).max() > 0.05 or not (np.linalg.det(turns) > 0).all():
        raise BadMotion(f"{file} holds matrices that are no rotations; it is damaged: get it again")
    _, turn = axis_up(up)
    return ObjectTrack(
        rot.rotate(turn, poses[:, :3, 3]), rot.multiply(turn, rot.from_matrix(turns))
    ), f"the object moves as {OBJECT_POSES} says"


FORMAT = Format(
    "core4d",
    import_core4d,
    lambda file: file.content == "zip" and file.pickled,
    heeds=("mesh",),
    beside=(OBJECT_POSES,),
)
