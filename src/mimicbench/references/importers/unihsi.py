"""Imports people of UniHSI and ASE (15 bodies, z up): `SkeletonMotion` files (`.npy`), and rigid-body states
recorded from Isaac Gym.
"""

from pathlib import Path
from typing import Any

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion
from mimicbench.core.foreign.untrusted import load_npz, load_restricted
from mimicbench.core.skeleton import forward_kinematics
from mimicbench.references.body.body import unihsi_body
from mimicbench.references.body.skeletons import UNIHSI
from mimicbench.references.importers.format import Format, Glimpse
from mimicbench.references.importers.recording import (
    MAX_BYTES,
    Recording,
    Wishes,
    check_array,
    check_rate,
    check_unit_quat,
    check_upright,
    check_velocity,
    finish,
)
from mimicbench.references.importers.rest_pose import adopt, axis_up, into_our_rest
from mimicbench.references.importers.stride import check_stride

STATES_FPS = 30.0
"""UniHSI controls, and would record, at this rate."""
STATE, BODIES = 13, 15
"""Numbers of a body's state (position, quaternion xyzw, velocity, angular velocity), and bodies."""
STATE_NAMES = ("rigid_body_states", "rigid_body_state", "rigid_bodies", "body_states", "states", "arr_0")
"""What the array may be called in an `.npz` file."""
MAX_BODIES = 100
"""Of a person with all that hangs on it."""
SLACK = 0.02
"""[m] by which bodies may be off from bones of constant length."""


def import_skeleton_motion(path: Path, wishes: Wishes | None = None) -> Recording:
    """Read and check one recording. Raises BadFile or BadMotion with one sentence about what is wrong."""
    wishes = wishes or Wishes()
    data = load_restricted(path, MAX_BYTES)
    kind = data.get("__name__") if isinstance(data, dict) else None
    if not isinstance(data, dict) or not isinstance(kind, str) or kind != "SkeletonMotion":
        found = kind if isinstance(kind, str) else type(data).__name__
        hint = " (one pose, no motion)" if found == "SkeletonState" else ""
        raise BadMotion(f"{path} holds {found!r:.60}{hint}, not a SkeletonMotion; give a motion clip of UniHSI or ASE")
    bodies, dropped = _bodies(path, data.get("skeleton_tree"))
    _check_bones(path, _content(data["skeleton_tree"], "local_translation"), bodies)
    root = check_array(path, "root_translation", _content(data, "root_translation"), (3,))
    fps = check_rate(path, data.get("fps"), wishes)
    quat, was_local = _rotations(path, data, bodies, len(dropped))
    if len(quat) != len(root):
        raise BadMotion(
            f"{path} has {len(quat)} frames of rotations and {len(root)} of positions; it is damaged: get it again"
        )
    assumed = [
        "quaternions are xyzw, as in every SkeletonMotion",
        f"{wishes.up or 'z'} is up and lengths are in meters",
        *([f"{', '.join(dropped)[:200]}: no parts of a person; left out"] if dropped else []),
        *([] if was_local else ["rotations were relative to the world and were made relative to the parents"]),
    ]
    _, turn = axis_up(wishes.up or "z+")
    root, quat[:, 0] = rot.rotate(turn, root), rot.multiply(turn, quat[:, 0])
    check_upright(path, quat, wishes.up)
    stored = _content(data, "global_velocity")
    if (
        isinstance(stored, np.ndarray)
        and stored.shape == (len(quat), len(bodies) + len(dropped), 3)
        and stored.dtype.kind == "f"
        and np.isfinite(stored).all()
    ):
        check_velocity(path, forward_kinematics(UNIHSI, root, quat)[0], stored[:, bodies].astype(float), fps)
    return finish(path, Recording(path.stem, UNIHSI, fps, root, quat, tuple(assumed), wishes=wishes))


def _rotations(path: Path, data: dict, bodies: list[int], dropped: int) -> tuple[np.ndarray, bool]:
    """(T, 15, 4) of UniHSI's bodies relative to their parents, and whether they were so in the file."""
    quat = check_array(path, "rotation", _content(data, "rotation"), (len(bodies) + dropped, 4))
    is_local = data.get("is_local")
    if not isinstance(is_local, bool):
        raise BadMotion(
            f"{path} does not say whether its rotations are local (is_local is {is_local!r:.40}); it "
            "is damaged: get it again"
        )
    quat = check_unit_quat(path, quat[:, bodies])
    if is_local:
        return quat, True
    return np.stack(
        [
            quat[:, i] if p < 0 else rot.multiply(rot.conjugate(quat[:, p]), quat[:, i])
            for i, p in enumerate(UNIHSI.parents)
        ],
        1,
    ), False


def import_rigid_bodies(path: Path, wishes: Wishes) -> Recording:
    """Read recorded states (T, 15, 13) of Isaac Gym's rigid bodies, `.npy` or `.npz`. Raises BadFile or BadMotion."""
    states = read_states(path)
    fps = check_rate(path, STATES_FPS, wishes)
    _, turn = axis_up(wishes.up or "z+")
    quat = rot.multiply(turn, check_unit_quat(path, states[..., 3:7]))
    assumed = [
        "bodies are in UniHSI's order, quaternions xyzw",
        f"{wishes.up or 'z'} is up and lengths are in meters",
        f"{fps:g} frames per second, as {'told' if wishes.fps else 'UniHSI controls its humanoid'}",
    ]
    pos = rot.rotate(turn, states[..., :3])
    adopted = adopt(UNIHSI, range(BODIES), pos, quat)
    if adopted.residual > SLACK:
        raise BadMotion(
            f"{path}: its bodies and their rotations disagree by {adopted.residual:.2g} m; it is "
            "damaged or in another order"
        )
    check_velocity(path, states[..., :3], states[..., 7:10], fps)
    skeleton, local = into_our_rest(unihsi_body(), adopted, np.tile(rot.IDENTITY, (BODIES, 1)))
    recording = finish(path, Recording(path.stem, skeleton, fps, adopted.pos, local, tuple(assumed), wishes=wishes))
    check_stride(path, skeleton, recording.forward_kinematics()[0], fps)
    return recording


def read_states(path: Path) -> np.ndarray:
    """(T, 15, 13) states. Raises BadFile or BadMotion."""
    if path.suffix.lower() == ".npz":
        data = load_npz(path, MAX_BYTES, STATE_NAMES)
        if not data:
            raise BadMotion(f"{path} has none of {', '.join(STATE_NAMES)}; it holds no rigid-body states")
        value = next(iter(data.values()))
    else:
        value = load_restricted(path, MAX_BYTES)
    if isinstance(value, np.ndarray) and value.ndim == 4 and value.shape[1] == 1:
        value = value[:, 0]  # the one environment
    return check_array(path, "the states", value, (BODIES, STATE))


def _content(data: dict, key: str) -> Any:
    """One array of a SkeletonMotion; None if it is not there."""
    value = data.get(key)
    return value.get("arr") if isinstance(value, dict) else None


def _bodies(path: Path, tree: Any) -> tuple[list[int], list[str]]:
    """Where UniHSI's bodies are among the file's, and the names of those that are dropped, such as a sword.

    What is dropped must carry none of the person's. Raises BadMotion, naming what differs.
    """
    names = tree.get("node_names") if isinstance(tree, dict) else None
    parents = tree.get("parent_indices") if isinstance(tree, dict) else None
    parents = parents.get("arr") if isinstance(parents, dict) else None
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise BadMotion(f"{path} has another skeleton: its bodies have no names; it is damaged: get it again")
    lacks = [name for name in UNIHSI.joint_names if name not in names]
    if lacks:
        more = ", ".join(name for name in names if name not in UNIHSI.joint_names)[:200]
        raise BadMotion(
            f"{path} has another skeleton: it lacks {', '.join(lacks)[:200]}{more and f' and has {more}'}; only people "
            "with UniHSI's bodies can be imported"
        )
    if (
        len(names) > MAX_BODIES
        or not isinstance(parents, np.ndarray)
        or parents.shape != (len(names),)
        or parents.dtype.kind not in "iu"
        or len(set(names)) < len(names)
    ):
        raise BadMotion(f"{path} does not say which of its bodies hang together; it is damaged: get it again")
    where = [names.index(name) for name in UNIHSI.joint_names]
    for name, joint, parent in zip(UNIHSI.joint_names, where, UNIHSI.parents, strict=True):
        found, wanted = int(parents[joint]), -1 if parent < 0 else where[parent]
        if found != wanted:
            on = names[found] if 0 <= found < len(names) else "nothing"
            expected = "nothing" if parent < 0 else UNIHSI.joint_names[parent]
            raise BadMotion(f"{path}: its {name} hangs on {on}, expected {expected}; it cannot be imported")
    return where, [name for name in names if name not in UNIHSI.joint_names]


def _check_bones(path: Path, offsets: Any, bodies: list[int]) -> None:
    """The file's bones must be as long as UniHSI's. Raises BadMotion."""
    if (
        not isinstance(offsets, np.ndarray)
        or offsets.ndim != 2
        or offsets.shape[1] != 3
        or len(offsets) <= max(bodies)
        or offsets.dtype.kind != "f"
        or not np.isfinite(offsets).all()
    ):
        raise BadMotion(f"{path}: its bones have no lengths; it is damaged: get it again")
    off = np.abs(offsets[bodies][1:] - UNIHSI.offsets[1:]).max(-1)
    if off.max() > 0.02:
        wrong = [name for name, much in zip(UNIHSI.joint_names[1:], off > 0.02, strict=True) if much]
        raise BadMotion(
            f"{path}: its bones differ from UniHSI's by up to {off.max():.2g} m ({', '.join(wrong)}); scale it to "
            "that skeleton first"
        )


def _recognizes(file: Glimpse) -> bool:
    return (file.content == "npy" and file.pickled) or (not file.content and file.suffix in (".npy", ".pkl", ".pickle"))


FORMAT = Format("unihsi", import_skeleton_motion, _recognizes)
