"""Imports what ROAM's Unity project shows: its actor's 27 bones per frame (text or `.npy`), and goal poses (27 places).

A bone is position (3), forward (3), up (3) and perhaps velocity (3), in meters, y up. ROAM's motion capture is BVH
(bvh.py).
"""

from pathlib import Path

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion
from mimicbench.core.foreign.untrusted import NPY, load_restricted, read_bytes
from mimicbench.core.motion_file import MAX_FRAMES
from mimicbench.references.body.body import roam_body
from mimicbench.references.body.skeletons import ROAM
from mimicbench.references.importers.bvh_file import numbers
from mimicbench.references.importers.format import Format, Glimpse
from mimicbench.references.importers.recording import (
    MAX_BYTES,
    UNITS,
    Recording,
    Wishes,
    check_array,
    check_rate,
    check_velocity,
    finish,
)
from mimicbench.references.importers.rest_pose import Adopted, adopt, axis_up, hanging_turns, into_our_rest

FPS = 25.0
"""ROAM's actors move at this rate."""
BONES, BONE, BONE_AND_VELOCITY = 27, 9, 12
SLACK = 0.03
"""[m] by which bones may be off from constant lengths."""


def import_roam(path: Path, wishes: Wishes) -> Recording:
    """Read the actor's bones in all frames. Raises BadFile or BadMotion, for a single pose too."""
    table = read_table(path)
    if table.shape[-1] == 3:
        raise BadMotion(
            f"{path} is a static goal pose (27 places), no motion; a clip needs at least two frames "
            "of bones: leave it out"
        )
    bones = check_array(path, "the bones", table, table.shape[1:])
    fps = check_rate(path, FPS, wishes)
    _, turn = axis_up(wishes.up or "y+")
    meters = wishes.scale or UNITS[wishes.unit or "m"]
    told = f"1 of its unit is {wishes.scale:.4g} m, as told" if wishes.scale else f"the unit is {wishes.unit}, as told"
    assumed = [
        f"{wishes.up or 'y+'} is up{', as told' if wishes.up else ', as in all of ROAM'}",
        told if wishes.scale or wishes.unit else "the unit is m, as in all of ROAM",
        f"{fps:g} frames per second, as {'told' if wishes.fps else 'ROAM moves its actors'}",
        "bones rest in a T-pose, their forward pointing backward, as in ROAM",
    ]
    pos, own = rot.rotate(turn, meters * bones[..., :3]), _orientations(path, bones)
    body, adopted = roam_body(), adopt(ROAM, range(BONES), pos, rot.multiply(turn, own))
    if adopted.residual > SLACK:
        raise BadMotion(
            f"{path}: its bones and their directions disagree by {adopted.residual:.2g} m; it is "
            "damaged or in another order"
        )
    if table.shape[-1] == BONE_AND_VELOCITY:
        check_velocity(path, bones[..., :3], bones[..., 9:], fps)
    skeleton, local = into_our_rest(body, adopted, _turns(path, adopted))
    return finish(path, Recording(path.stem, skeleton, fps, adopted.pos, local, tuple(assumed), wishes=wishes))


def read_table(path: Path) -> np.ndarray:
    """(T, 27, 3 | 9 | 12) numbers of a text or `.npy` file. Raises BadFile or BadMotion."""
    raw = read_bytes(path, MAX_BYTES)
    if raw.startswith(NPY):
        table = load_restricted(path, MAX_BYTES)
        if not isinstance(table, np.ndarray) or table.dtype.kind not in "fiu":
            raise BadMotion(f"{path} holds {type(table).__name__}, expected numbers; it is no file of ROAM's bones")
        table = table.astype(float)
    else:
        if raw.count(b"\n") > MAX_FRAMES:
            raise BadMotion(
                f"{path} has more than {MAX_FRAMES} lines; it is no file of ROAM's bones, or must be cut into parts"
            )
        lines = [line for line in raw.decode("utf-8", "replace").splitlines() if line.strip()]
        rows = [numbers(line.replace(",", " ")) for line in lines]
        if rows and not len(rows[0]):  # the columns' names
            del rows[0], lines[0]
        if len({len(row) for row in rows}) == 1:
            table = np.stack(rows)
        elif rows and len(lines) == BONES:
            table = np.concatenate(rows)
        else:
            raise BadMotion(
                f"{path} has rows of different lengths or none; it is cut off or no file of ROAM's bones: get it again"
            )
    width = BONES * BONE_AND_VELOCITY
    if table.ndim == 3 and table.shape[1] == BONES and table.shape[2] in (3, BONE, BONE_AND_VELOCITY):
        return table
    if table.size == BONES * 3:
        return table.reshape(1, BONES, 3)
    if table.ndim == 2 and table.shape[1] in (BONES * BONE, width):
        return table.reshape(len(table), BONES, -1)
    if table.ndim in (1, 2) and table.size and table.shape[-1] >= width and len(np.atleast_2d(table)) == 1:
        return table.reshape(-1)[:width].reshape(
            1, BONES, BONE_AND_VELOCITY
        )  # a frame of training data begins with the bones
    raise BadMotion(
        f"{path} has numbers of shape {table.shape}, expected 27 bones of {BONE} or "
        f"{BONE_AND_VELOCITY} numbers per frame, or one pose of 27 x 3"
    )


def _orientations(path: Path, bones: np.ndarray) -> np.ndarray:
    """(T, 27, 4) from forward (z) and up (y) of bones (T, 27, 9+)."""
    forward, up = bones[..., 3:6], bones[..., 6:9]
    lengths = np.linalg.norm(forward, axis=-1), np.linalg.norm(up, axis=-1)
    if max(np.abs(length - 1).max() for length in lengths) > 0.02 or np.abs((forward * up).sum(-1)).max() > 0.02:
        raise BadMotion(
            f"{path}: forward and up of its bones are not of unit length and perpendicular; it is "
            "damaged or in another order"
        )
    up = up / lengths[1][..., None]
    forward = forward - (forward * up).sum(-1, keepdims=True) * up
    forward = forward / np.linalg.norm(forward, axis=-1, keepdims=True)
    return rot.from_matrix(np.stack([np.cross(up, forward), up, forward], -1))


def _turns(path: Path, adopted: Adopted) -> np.ndarray:
    """The constant rotations from the actor's rest pose into ours: its frames are those of a T-pose, turned half
    round about the vertical.
    """
    try:
        return hanging_turns(roam_body(), adopted.offsets, np.tile(rot.IDENTITY, (BONES, 1)), np.array([0.0, 1.0, 0.0]))
    except BadMotion as error:
        raise BadMotion(f"{path}: {error}; its bones are in another order, or it is damaged") from None


def _recognizes(file: Glimpse) -> bool:
    if file.content == "npy":
        return not file.pickled and file.shape[-2:] != (15, 13)  # those are rigid-body states
    return not file.content and file.suffix in (".txt", ".csv")


FORMAT = Format("roam", import_roam, _recognizes, heeds=("unit", "scale"))
