"""Reads BVH files as they are: joints, offsets, channels and frames, whoever they belong to."""

import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion
from mimicbench.core.foreign.untrusted import read_bytes
from mimicbench.core.motion_file import MAX_FRAMES
from mimicbench.references.importers.joint_names import END

MAX_BYTES = 64 << 20
MAX_HIERARCHY = 1 << 20
"""Bytes before MOTION."""
MAX_JOINTS, MAX_POSES = 500, 8_000_000
"""In one frame, and in all: a quarter of an hour of 70 joints at 120 frames per second."""
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
    surplus: int = 0
    """Rows after the stated number of frames; they are left out."""


def read_bvh(path: Path) -> Bvh:
    """Read a file as it is. Raises BadFile or BadMotion with one sentence about what is wrong."""
    text = read_bytes(path, MAX_BYTES).decode("utf-8", "replace").replace("\r\n", "\n").replace("\r", "\n")
    # only blanks within the line: a run of blank lines must not be looked through from each of its lines
    match = re.search(r"^[ \t]*MOTION[ \t]*$", text, re.MULTILINE)
    if not text.lstrip("\ufeff \n\t").startswith("HIERARCHY") or match is None:
        raise BadMotion(f"{path} has no HIERARCHY with a MOTION after it; it is cut off or no BVH file")
    if match.start() > MAX_HIERARCHY:
        raise BadMotion(
            f"{path} has a HIERARCHY of {match.start() >> 10} KiB, more than any skeleton needs; it "
            "is damaged: get it again"
        )
    names, parents, offsets, channels = _hierarchy(path, text[: match.start()])
    frames, frame_time, start = _head(path, text, match.end())
    if frames * len(names) > MAX_POSES:
        raise BadMotion(
            f"{path} has {frames} frames of {len(names)} joints, more than fit into memory; cut it into parts"
        )
    values, surplus = _frames(path, text[start:], frames, sum(map(len, channels)))
    return Bvh(names, parents, offsets, channels, frame_time, values, surplus)


def _head(path: Path, text: str, start: int) -> tuple[int, float, int]:
    """Number of frames, frame time [s], and where the numbers begin."""
    head = re.compile(r"\s*Frames:\s*(\d{1,9})\s+Frame\s+Time:\s*(\S{1,40})[^\S\n]*\n?").match(text, start)
    try:
        frames, frame_time = (int(head[1]), float(head[2])) if head else (-1, 0.0)
    except ValueError:
        frames, frame_time = -1, 0.0
    if head is None or frames < 0 or not np.isfinite(frame_time):
        raise BadMotion(f"{path} does not say its number of frames and its frame time; it is damaged: get it again")
    return frames, frame_time, head.end()


def _frames(path: Path, text: str, frames: int, width: int) -> tuple[np.ndarray, int]:
    """The stated number of rows (T, C), and how many more follow them."""
    if not 2 <= frames <= MAX_FRAMES:
        raise BadMotion(
            f"{path} has {frames} frame{'s' * (frames != 1)} of {width} numbers; a motion needs "
            f"between 2 and {MAX_FRAMES} frames: leave it out"
        )
    values = numbers(text)
    surplus = len(values) - frames * width
    if surplus < 0 or surplus % max(width, 1):
        raise BadMotion(
            f"{path} has {len(values)} numbers, but {frames} frames of {width} need {frames * width}; "
            "it is cut off or damaged: get it again"
        )
    values = values[: frames * width]
    if not np.isfinite(values).all() or np.abs(values).max(initial=0.0) > 1e6:
        raise BadMotion(f"{path} holds NaN, infinity, or numbers beyond a million; mend or drop the clip")
    return values.reshape(frames, width), surplus // max(width, 1)


def numbers(text: str) -> np.ndarray:
    """The numbers of a text up to the first that is none."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        try:
            return np.fromstring(text, sep=" ")
        except ValueError:
            return np.array(list(_floats(text.split())), float)


def _floats(words: list[str]) -> Iterator[float]:
    """The words' values up to the first that has none."""
    for word in words:
        try:
            yield float(word)
        except ValueError:
            return


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
