"""Imports recordings of real people in the `SkeletonMotion` format of UniHSI and ASE (`.npy`, 15 bodies, z up)."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion
from mimicbench.core.motion import MAX_FRAMES, HumanMotion, Skeleton, forward_kinematics
from mimicbench.core.pickles import load_restricted
from mimicbench.objects.shape import SceneObject
from mimicbench.references.body import unihsi_body
from mimicbench.references.contacts import CONTACT_NAMES, detect_contacts, sole_points
from mimicbench.references.fit_object import fit_chair, seated_frame
from mimicbench.references.segments import Sitting, SittingRules, find_sittings
from mimicbench.references.skeletons import UNIHSI

MAX_BYTES = 256 << 20
FPS = 30.0
"""Frame rate of the clips that are made."""
JUMP, BRIDGE = 12.0, 0.17
"""A joint that turns faster than JUMP [rad/s] is taken for a fault of the recording and bridged over BRIDGE [s] before and after."""


@dataclass(frozen=True)
class SkeletonMotion:
    """A recording as imported, not yet next to any object."""

    name: str
    """The file's name without its ending."""
    skeleton: Skeleton
    fps: float
    root_pos_w: np.ndarray
    """(T, 3) pelvis [m]."""
    local_quat: np.ndarray
    """(T, 15, 4) wxyz."""
    assumed: tuple[str, ...]
    """What was taken for granted, and what was mended, one sentence each."""


def import_skeleton_motion(path: Path) -> SkeletonMotion:
    """Read and check one recording. Raises BadFile or BadMotion with one sentence about what is wrong."""
    data = load_restricted(path, MAX_BYTES)
    if not isinstance(data, dict) or data.get("__name__") != "SkeletonMotion":
        found = data.get("__name__") if isinstance(data, dict) else type(data).__name__
        raise BadMotion(f"{path} holds {found!r:.60}, not a SkeletonMotion; give a motion clip of UniHSI or ASE")
    skeleton = _skeleton(path, data.get("skeleton_tree"))
    quat = _array(path, data, "rotation", (len(skeleton.joint_names), 4))
    root = _array(path, data, "root_translation", (3,))
    if len(quat) != len(root):
        raise BadMotion(f"{path} has {len(quat)} frames of rotations and {len(root)} of positions; it is damaged: get it again")
    fps = data.get("fps")
    if isinstance(fps, bool) or not isinstance(fps, int | float | np.number) or not 1 <= fps <= 1000:
        raise BadMotion(f"{path} says {fps!r:.40} frames per second, which is no frame rate; mend its fps")
    norm = np.linalg.norm(quat, axis=-1)
    if np.abs(norm - 1).max() > 1e-2:
        raise BadMotion(f"{path} has quaternions that are not of unit length (off by {np.abs(norm - 1).max():.2g}); it is damaged or in another format")
    assumed = ["quaternions are xyzw, as in every SkeletonMotion", "z is up and lengths are in meters"]
    quat = rot.normalize(quat[..., [3, 0, 1, 2]])
    is_local = data.get("is_local")
    if not isinstance(is_local, bool):
        raise BadMotion(f"{path} does not say whether its rotations are local (is_local is {is_local!r:.40}); it is damaged: get it again")
    if not is_local:
        quat = np.stack([quat[:, i] if p < 0 else rot.multiply(rot.conjugate(quat[:, p]), quat[:, i]) for i, p in enumerate(skeleton.parents)], 1)
        assumed.append("rotations were relative to the world and were made relative to the parents")
    _check_upright(path, root, quat)
    _check_rate(path, data, skeleton, float(fps), root, quat)
    pos, world = forward_kinematics(skeleton, root, quat)
    floor = _floor(pos, world)
    root = root - np.array([0.0, 0.0, floor])
    assumed.append(f"the floor was taken to be where the soles usually are, at z = {floor:.3f} m")
    return SkeletonMotion(path.stem, skeleton, float(fps), root, quat, tuple(assumed))


def import_sitting(path: Path, rules: SittingRules | None = None) -> list[tuple[HumanMotion, SceneObject]]:
    """Every part of a recording in which somebody walks up and sits down, each with a chair fitted under the person.

    Ids are `real-<file>-<n>` and `fitted-<file>-<n>`. Raises BadFile, or BadMotion if the file is not such a recording.
    """
    recording = import_skeleton_motion(path)
    pos, _ = forward_kinematics(recording.skeleton, recording.root_pos_w, recording.local_quat)
    sittings = find_sittings(recording.skeleton, pos, recording.fps, rules)
    if not sittings:
        lowest, highest = pos[:, 0, 2].min(), pos[:, 0, 2].max()
        raise BadMotion(
            f"{path} has no part in which somebody walks up and sits down (the pelvis is between {lowest:.2f} and {highest:.2f} m high); leave it out"
        )
    return [_sitting_clip(recording, sitting, number) for number, sitting in enumerate(sittings)]


def _sitting_clip(recording: SkeletonMotion, sitting: Sitting, number: int) -> tuple[HumanMotion, SceneObject]:
    """One walk-to-seated part, moved to where its chair is at the origin facing +x, at FPS."""
    part = slice(sitting.start, sitting.end)
    local_quat = smooth_jumps(rot.normalize(rot.resample_quat(recording.local_quat[part], recording.fps, FPS)), FPS)
    motion = HumanMotion(
        f"real-{recording.name}-{number}", "sit-chair", recording.skeleton, FPS,
        rot.resample(recording.root_pos_w[part], recording.fps, FPS), local_quat,
        f"fitted-{recording.name}-{number}", source=recording.name, style={"body_scale": 1.0},
    )  # fmt: skip
    landing = min(motion.frames - 2, round((sitting.landing - sitting.start) * FPS / recording.fps))
    seated = slice(landing, motion.frames)
    origin, yaw, _ = seated_frame(motion, seated)
    motion = _moved(motion, origin, yaw)
    fit = fit_chair(motion.object_id, motion, seated)
    motion = _moved(motion, fit.offset, 0.0)
    motion = replace(motion, contact_names=CONTACT_NAMES, contacts=detect_contacts(motion, fit.obj))
    return motion, fit.obj


def smooth_jumps(local_quat: np.ndarray, fps: float) -> np.ndarray:
    """Joint rotations (T, J, 4) in which no joint turns faster than JUMP; where one did, it turns smoothly over BRIDGE on both sides.

    A straight leg has no definite twist, and in real recordings it sometimes jumps by a radian between two frames.
    """
    quat = local_quat.copy()
    reach = max(1, round(BRIDGE * fps))
    speed = np.linalg.norm(rot.to_rotvec(rot.multiply(rot.conjugate(quat[:-1]), quat[1:])), axis=-1) * fps
    for frame, joint in np.argwhere(speed > JUMP):
        first, last = max(0, frame + 1 - reach), min(len(quat) - 1, frame + reach)
        time = np.linspace(0, 1, last - first + 1)
        share = time**2 * (3 - 2 * time)
        ends = np.broadcast_to(quat[[first, last], joint][:, None], (2, len(share), 4))
        quat[first : last + 1, joint] = rot.slerp(ends[0], ends[1], share)
    return quat


def _moved(motion: HumanMotion, origin: np.ndarray, yaw: float) -> HumanMotion:
    """The motion seen from a frame on the floor at `origin` (2,) [m] that faces `yaw` [rad]."""
    turn = rot.from_yaw(np.array(-yaw))
    quat = motion.local_quat.copy()
    quat[:, 0] = rot.multiply(turn, quat[:, 0])
    return replace(motion, root_pos_w=rot.rotate(turn, motion.root_pos_w - np.array([*origin, 0.0])), local_quat=quat)


def _array(path: Path, data: dict, key: str, shape: tuple[int, ...]) -> np.ndarray:
    """One array of the file, (T, *shape), finite."""
    value: Any = data.get(key)
    array = value.get("arr") if isinstance(value, dict) else None
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "fiu" or array.shape[1:] != shape or array.ndim != len(shape) + 1:
        found = f"an array of shape {array.shape}" if isinstance(array, np.ndarray) else type(value).__name__
        raise BadMotion(f"{path}: {key} is {found}, expected numbers of shape (frames, {', '.join(map(str, shape))}); it is damaged or in another format")
    if not 2 <= len(array) <= MAX_FRAMES:
        raise BadMotion(f"{path} has {len(array)} frames; a motion needs between 2 and {MAX_FRAMES}: leave it out")
    if not np.isfinite(array).all():
        raise BadMotion(f"{path}: {key} holds NaN or infinity; mend or drop the clip")
    if np.abs(array).max() > 1e4:
        raise BadMotion(f"{path}: {key} holds numbers as large as {np.abs(array).max():.2g}; it is damaged, or not in meters")
    return array.astype(float)


def _skeleton(path: Path, tree: Any) -> Skeleton:
    """The file's skeleton, which must be UniHSI's but may have other bone lengths."""
    names = tree.get("node_names") if isinstance(tree, dict) else None
    if not isinstance(names, list) or tuple(map(str, names)) != UNIHSI.joint_names:
        raise BadMotion(f"{path} has another skeleton ({names!r:.80}); expected the joints {', '.join(UNIHSI.joint_names)}")
    arrays = [value.get("arr") if isinstance(value, dict) else None for value in (tree.get("parent_indices"), tree.get("local_translation"))]
    parents, offsets = arrays
    if not isinstance(parents, np.ndarray) or parents.shape != (15,) or tuple(parents.tolist()) != UNIHSI.parents:
        raise BadMotion(f"{path}: its joints hang together in another way than UniHSI's; it cannot be imported")
    if not isinstance(offsets, np.ndarray) or offsets.shape != (15, 3) or offsets.dtype.kind != "f" or not np.isfinite(offsets).all():
        raise BadMotion(f"{path}: its bones have no lengths; it is damaged: get it again")
    worst = np.abs(offsets[1:] - UNIHSI.offsets[1:]).max()
    if worst > 0.02:
        raise BadMotion(f"{path}: its bones differ from UniHSI's by up to {worst:.2g} m; scale it to that skeleton first")
    return UNIHSI


def _check_upright(path: Path, root: np.ndarray, quat: np.ndarray) -> None:
    """Somebody whose pelvis is at its highest stands; if only another order of the quaternion says so, the file is mixed up."""
    high = root[:, 2] >= np.quantile(root[:, 2], 0.8)
    as_read, swapped = quat[high, 0], quat[high, 0][:, [1, 2, 3, 0]]
    up = [float(rot.rotate(q, np.array([0.0, 0.0, 1.0]))[:, 2].mean()) for q in (as_read, swapped)]
    if up[0] < 0.5:
        hint = "its quaternions seem to be wxyz where this format has xyzw" if up[1] > 0.7 else "nobody stands upright in it, or z is not up"
        raise BadMotion(f"{path}: {hint}; convert it first")


def _check_rate(path: Path, data: dict, skeleton: Skeleton, fps: float, root: np.ndarray, quat: np.ndarray) -> None:
    """The stored velocities, if any, must be those of the positions at the stated rate."""
    stored = data.get("global_velocity")
    stored = stored.get("arr") if isinstance(stored, dict) else None
    if not isinstance(stored, np.ndarray) or stored.shape != quat.shape[:2] + (3,) or stored.dtype.kind != "f" or not np.isfinite(stored).all():
        return
    pos, _ = forward_kinematics(skeleton, root, quat)
    speed = np.linalg.norm(np.gradient(pos, 1 / fps, axis=0), axis=-1).mean()
    told = np.linalg.norm(stored.astype(float), axis=-1).mean()
    if max(speed, told) > 0.05 and not 0.7 < speed / max(told, 1e-6) < 1.4:
        raise BadMotion(f"{path} says {fps:g} frames per second, but its stored velocities fit {fps * told / max(speed, 1e-6):.0f}; mend its fps")


def _floor(pos: np.ndarray, quat: np.ndarray) -> float:
    """Height of the floor: the usual height of the lower sole while the person is up [m].

    These files put the lowest ankle of the whole recording at z = 0, which is some centimeters above the soles.
    """
    up = pos[:, 0, 2] >= 0.8 * np.quantile(pos[:, 0, 2], 0.9)
    pos, quat = pos[up], quat[up]
    body = unihsi_body()
    soles = [sole_points(body, pos[:, leg.end], quat[:, leg.end])[..., 2].min(-1) for leg in body.legs]
    return float(np.median(np.minimum(*soles)))
