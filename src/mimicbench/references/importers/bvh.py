"""Imports BVH files of any skeleton of a person onto ROAM's 27 joints.

ROAM's own files (millimeters, 67 joints) are one case of it.

Units and axes are guessed from how long the legs are and where heads are above feet; limbs are found by their names
(joint_names.py), spine and neck as what lies between them.
"""

import re
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion
from mimicbench.core.motion import MAX_FRAMES
from mimicbench.core.untrusted import read_bytes
from mimicbench.references.body.body import Body, roam_body
from mimicbench.references.body.skeletons import ROAM
from mimicbench.references.importers.joint_names import END, Limbs, find_limbs, onto_roam
from mimicbench.references.importers.recording import LEG, UNITS, Recording, Wishes, check_rate, check_stride, finish
from mimicbench.references.importers.rest_pose import Adopted, adopt, axis_up, guess_up, hanging_turns, into_our_rest

MAX_BYTES = 64 << 20
MAX_HIERARCHY = 1 << 20
"""Bytes before MOTION."""
MAX_JOINTS, MAX_POSES = 500, 8_000_000
"""In one frame, and in all: a quarter of an hour of 70 joints at 120 frames per second."""
LEG_LENGTH = 0.83
"""Thigh and shin of a usual person [m]."""
SLACK = 0.05
"""[m] by which a joint may be off because joints between it and its parent, which our skeleton does not have, turn."""
AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


@dataclass(frozen=True)
class Bvh:
    """A BVH file as it is."""

    names: tuple[str, ...]
    """Of the joints; ends without a name are called after their parent, with END behind it."""
    parents: tuple[int, ...]
    offsets: np.ndarray
    """(N, 3) in the file's unit."""
    channels: tuple[tuple[str, ...], ...]
    """Of every joint, such as Xposition and Zrotation."""
    frame_time: float
    """[s]"""
    values: np.ndarray
    """(T, C) all channels in the order of the joints; degrees and the file's unit."""


def import_bvh(path: Path, wishes: Wishes) -> Recording:
    """Read one take. Raises BadFile or BadMotion."""
    bvh = read_bvh(path)
    limbs = find_limbs(path, bvh.names, bvh.parents)
    body, (sources, skipped) = roam_body(), onto_roam(bvh.names, bvh.parents, limbs)
    fps = check_rate(path, None if bvh.frame_time <= 0 else 1 / bvh.frame_time, wishes)
    unit, said = _unit(path, bvh, limbs, wishes)
    pos, quat = world(bvh)
    pos *= UNITS[unit]
    up, why = _up(pos, limbs, wishes)
    assumed = [said, why, f"{fps:.4g} frames per second, as {'told' if wishes.fps else 'the file says'}"]
    assumed += [
        f"{ROAM.joint_names[j]} is missing and lies on the bone between its neighbors" for j in _between(sources)
    ]
    _, turn = axis_up(up)
    pos, quat = rot.rotate(turn, pos), rot.multiply(turn, quat)
    adopted = adopt(ROAM, sources, pos, quat)
    if skipped:
        assumed.append(
            f"{', '.join(skipped)}: our skeleton has no such joints; what is above them is up to "
            f"{adopted.residual:.3f} m off"
        )
    if adopted.residual > SLACK:
        raise BadMotion(
            f"{path}: {', '.join(skipped) or 'its joints'} move the joints below by "
            f"{adopted.residual:.2g} m, which our skeleton cannot do"
        )
    turns, how = _turns(path, body, adopted)
    skeleton, local = into_our_rest(body, adopted, turns)
    recording = finish(path, Recording(path.stem, skeleton, fps, adopted.pos, local, (*assumed, *how), wishes=wishes))
    check_stride(path, skeleton, recording.forward_kinematics()[0], fps)
    return recording


def read_bvh(path: Path) -> Bvh:
    """Read a file as it is. Raises BadFile or BadMotion with one sentence about what is wrong."""
    text = read_bytes(path, MAX_BYTES).decode("utf-8", "replace")
    match = re.search(r"^\s*MOTION\s*$", text, re.MULTILINE)
    if not text.lstrip("\ufeff \r\n\t").startswith("HIERARCHY") or match is None:
        raise BadMotion(f"{path} has no HIERARCHY with a MOTION after it; it is cut off or no BVH file")
    if match.start() > MAX_HIERARCHY:
        raise BadMotion(
            f"{path} has a HIERARCHY of {match.start() >> 10} KiB, more than any skeleton needs; it "
            "is damaged: get it again"
        )
    names, parents, offsets, channels = _hierarchy(path, text[: match.start()])
    head = re.match(r"\s*Frames:\s*(\d{1,9})\s+Frame\s+Time:\s*(\S{1,40})[^\S\n]*\n?", text[match.end() :])
    try:
        frames, frame_time = (int(head[1]), float(head[2])) if head else (-1, 0.0)
    except ValueError:
        frames, frame_time = -1, 0.0
    if head is None or frames < 0 or not np.isfinite(frame_time):
        raise BadMotion(f"{path} does not say its number of frames and its frame time; it is damaged: get it again")
    width = sum(map(len, channels))
    if frames * len(names) > MAX_POSES:
        raise BadMotion(
            f"{path} has {frames} frames of {len(names)} joints, more than fit into memory; cut it into parts"
        )
    if not 2 <= frames <= MAX_FRAMES:
        raise BadMotion(
            f"{path} has {frames} frame{'s' * (frames != 1)} of {width} numbers; a motion needs "
            f"between 2 and {MAX_FRAMES} frames: leave it out"
        )
    values = numbers(text[match.end() + head.end() :])
    if len(values) != frames * width:
        raise BadMotion(
            f"{path} has {len(values)} numbers, but {frames} frames of {width} need {frames * width}; "
            "it is cut off or damaged: get it again"
        )
    if not np.isfinite(values).all() or np.abs(values).max() > 1e6:
        raise BadMotion(f"{path} holds NaN, infinity, or numbers beyond a million; mend or drop the clip")
    return Bvh(names, parents, offsets, channels, frame_time, values.reshape(frames, width))


def numbers(text: str) -> np.ndarray:
    """The numbers of a text up to the first that is none."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        try:
            return np.fromstring(text, sep=" ")
        except ValueError:
            return np.zeros(0)


def world(bvh: Bvh) -> tuple[np.ndarray, np.ndarray]:
    """Positions (T, N, 3) in the file's unit and orientations (T, N, 4) of all joints, in the file's world.

    Rotations follow each other in the order of the channels, the first one outermost: R = R_1 R_2 R_3.
    """
    frames = len(bvh.values)
    pos, quat = np.empty((frames, len(bvh.names), 3)), np.empty((frames, len(bvh.names), 4))
    column = 0
    for j, parent in enumerate(bvh.parents):
        local, moved = np.tile(rot.IDENTITY, (frames, 1)), np.tile(bvh.offsets[j], (frames, 1))
        for channel in bvh.channels[j]:
            value, axis = bvh.values[:, column], channel[0].lower()
            if channel.endswith("rotation"):
                local = rot.multiply(local, rot.from_rotvec(np.radians(value)[:, None] * np.array(AXES[axis])))
            else:  # positions replace the offset
                moved[:, "xyz".index(axis)] = value
            column += 1
        if parent < 0:
            pos[:, j], quat[:, j] = moved, local
        else:
            pos[:, j] = pos[:, parent] + rot.rotate(quat[:, parent], moved)
            quat[:, j] = rot.multiply(quat[:, parent], local)
    return pos, quat


def _hierarchy(
    path: Path, text: str
) -> tuple[tuple[str, ...], tuple[int, ...], np.ndarray, tuple[tuple[str, ...], ...]]:
    """Names, parents, offsets and channels of all joints and ends."""
    wrong = BadMotion(f"{path}: its HIERARCHY is not as BVH has it; it is damaged: get it again")
    tokens = text.split()
    names: list[str] = []
    parents: list[int] = []
    offsets: list[list[float]] = []
    channels: list[tuple[str, ...]] = []
    open_joints: list[int] = []
    i = 1
    try:
        while i < len(tokens):
            word = tokens[i]
            if word in ("ROOT", "JOINT", "End"):
                if len(names) >= MAX_JOINTS or (word == "ROOT") == bool(names) or (word != "ROOT" and not open_joints):
                    raise wrong
                brace = tokens.index("{", i)
                name = " ".join(tokens[i + 1 : brace])[:100]
                names.append(f"{names[open_joints[-1]]}{END}" if word == "End" else name)
                parents.append(open_joints[-1] if open_joints else -1)
                offsets.append([0.0, 0.0, 0.0])
                channels.append(())
                open_joints.append(len(names) - 1)
                i = brace + 1
            elif word == "OFFSET":
                offsets[open_joints[-1]] = [float(token) for token in tokens[i + 1 : i + 4]]
                i += 4
            elif word == "CHANNELS":
                count = int(tokens[i + 1])
                found = tuple(tokens[i + 2 : i + 2 + count])
                if (
                    not 0 <= count <= 6
                    or len(found) != count
                    or not all(re.fullmatch("[XYZ](position|rotation)", channel) for channel in found)
                ):
                    raise wrong
                channels[open_joints[-1]] = found
                i += 2 + count
            elif word == "}":
                open_joints.pop()
                i += 1
            else:
                raise wrong
    except (ValueError, IndexError):
        raise wrong from None
    array = np.array(offsets) if all(len(offset) == 3 for offset in offsets) else np.full((1, 3), np.nan)
    if not names or open_joints or not np.isfinite(array).all() or np.abs(array).max() > 1e5:
        raise wrong
    return tuple(names), tuple(parents), array, tuple(channels)


def _unit(path: Path, bvh: Bvh, limbs: Limbs, wishes: Wishes) -> tuple[str, str]:
    """The file's unit of length, and why."""
    if wishes.unit is not None:
        return wishes.unit, f"the unit is {wishes.unit}, as told"
    legs = [np.linalg.norm(bvh.offsets[leg[1]]) + np.linalg.norm(bvh.offsets[leg[2]]) for leg in limbs.legs]
    length = float(np.mean(legs))
    unit = min(UNITS, key=lambda name: abs(np.log(max(length * UNITS[name], 1e-9) / LEG_LENGTH)))
    if not LEG[0] <= length * UNITS[unit] <= LEG[1]:
        raise BadMotion(
            f"{path}: its legs are {length:.3g} long, no person's in any of {', '.join(UNITS)}; scale "
            "it first, or say the unit (--unit)"
        )
    return unit, f"the unit is {unit}: so the legs are {length * UNITS[unit]:.2f} m long"


def _up(pos: np.ndarray, limbs: Limbs, wishes: Wishes) -> tuple[str, str]:
    """The file's axis that points up, and why."""
    if wishes.up is not None:
        return wishes.up, f"{wishes.up} is up, as told"
    return guess_up(pos[:, limbs.head] - pos[:, [leg[2] for leg in limbs.legs]].mean(1), "y+")


def _between(sources: list[int | None]) -> list[int]:
    """Joints of ours that are missing between others."""
    below = {ROAM.parents[j] for j, source in enumerate(sources) if source is not None}
    missing = [j for j, source in enumerate(sources) if source is None]
    for j in reversed(missing):
        if j in below:
            below.add(ROAM.parents[j])
    return [j for j in missing if j in below]


def _turns(path: Path, body: Body, adopted: Adopted) -> tuple[np.ndarray, list[str]]:
    """The constant rotations into our rest pose (27, 4), and what to say about them.

    Most files rest standing, with all rotations zero. In some the zero pose is of no use, as all bones lie along one
    axis; then the
    person's most upright frame serves.
    """
    offsets, legs, arms = np.nan_to_num(adopted.offsets), body.legs, body.arms
    # the rest pose may have another axis up than the motion
    rise = -offsets[[joint for leg in legs for joint in leg[1:]]].sum(0)
    axis = np.sign(rise) * (np.abs(rise) == np.abs(rise).max())
    try:
        return hanging_turns(body, offsets, np.tile(rot.IDENTITY, (len(offsets), 1)), axis), []
    except BadMotion:
        pass

    def along(limb: tuple[int, int, int]) -> np.ndarray:
        steps = [
            rot.rotate(adopted.quat[:, joint], offsets[child]) for joint, child in zip(limb[:2], limb[1:], strict=True)
        ]
        return np.min([step[:, 2] / max(float(np.linalg.norm(step[0])), 1e-9) * -1 for step in steps], 0)

    hanging = np.min([along(leg) for leg in legs], 0) + 0.2 * np.min([along(arm) for arm in arms], 0)
    best = int(hanging.argmax())
    try:
        turns = hanging_turns(body, offsets, adopted.quat[best], np.array([0.0, 0.0, 1.0]))
    except BadMotion:
        raise BadMotion(
            f"{path}: nobody stands in its rest pose, and nobody stands with straight legs in any "
            "frame; convert it to a T-pose first"
        ) from None
    return turns, [
        f"nobody stands in the rest pose; twists of the joints count from frame {best}, in which the "
        "person stands most upright"
    ]
