"""Finds the parts of a long recording in which somebody walks up to a seat and sits down on it."""

from dataclasses import dataclass

import numpy as np

from mimicbench.core.motion import Skeleton


@dataclass(frozen=True)
class SittingRules:
    """What counts as sitting down, and how much before and after it is kept."""

    least_height: float = 0.45
    """Height of a seated pelvis over that of a standing one; somebody lower is lying or squatting."""
    most_height: float = 0.72
    lean: float = 55.0
    """Most that the line from pelvis to head may lean while seated [degrees]."""
    stays: float = 1.0
    """Least time that the pelvis stays down [s]."""
    before: float = 8.0
    """Most time kept before the pelvis comes down [s]."""
    after: float = 1.5
    """Time kept after the pelvis came down [s]."""
    distance: float = 2.0
    """Most distance of the first frame from the seat [m]."""
    walking: float = 0.3
    """Speed of the pelvis that is surely walking [m/s]."""
    standing: float = 0.12
    """Speed of the pelvis that is surely standing [m/s]."""


@dataclass(frozen=True)
class Sitting:
    """One walk-to-seated part, in frames."""

    start: int
    landing: int
    """The first frame in which the pelvis is down."""
    end: int
    """One past the last frame."""


def find_sittings(skeleton: Skeleton, pos: np.ndarray, fps: float, rules: SittingRules | None = None) -> list[Sitting]:
    """All walk-to-seated parts of a motion, from the positions (T, J, 3) [m] of the UniHSI skeleton's joints."""
    rules = rules or SittingRules()
    pelvis, head = pos[:, skeleton.index("pelvis")], pos[:, skeleton.index("head")]
    height = pelvis[:, 2]
    standing = float(np.quantile(height, 0.9))
    speed = _smooth(np.linalg.norm(np.gradient(pelvis[:, :2], 1 / fps, axis=0), axis=-1), round(0.5 * fps))
    trunk = head - pelvis
    lean = np.degrees(np.arctan2(np.linalg.norm(trunk[:, :2], axis=-1), trunk[:, 2]))
    found = []
    down = np.concatenate([[False], height < 0.8 * standing, [False]])
    edges = np.flatnonzero(np.diff(down))
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        rest = float(np.median(height[begin:end]))
        if end - begin < rules.stays * fps or not rules.least_height <= rest / standing <= rules.most_height:
            continue
        landing = begin + int(np.argmax(height[begin:end] < rest + 0.02))
        last = min(end, landing + round(rules.after * fps))
        if (last - landing) / fps < 0.5 * rules.stays or np.median(lean[landing:last]) > rules.lean or height[last - 1] > rest + 0.1:
            continue
        start = _start(pelvis, speed, landing, last, fps, rules)
        if start is not None:
            found.append(Sitting(start, landing, last))
    return found


def _start(pelvis: np.ndarray, speed: np.ndarray, landing: int, last: int, fps: float, rules: SittingRules) -> int | None:
    """Where the last walk before the landing begins, near enough to the seat; None if nobody walks."""
    earliest = max(0, landing - round(rules.before * fps))
    walks = np.flatnonzero(speed[earliest:landing] > rules.walking) + earliest
    if not len(walks):
        return None
    still = np.flatnonzero(speed[earliest : walks[-1]] < rules.standing) + earliest
    # a moment of standing belongs to the clip
    begin = max(earliest, still[-1] - round(0.2 * fps)) if len(still) else earliest
    seat = pelvis[landing:last, :2].mean(0)
    far = np.flatnonzero(np.linalg.norm(pelvis[begin:landing, :2] - seat, axis=-1) > rules.distance)
    return int(begin + far[-1] + 1) if len(far) else int(begin)


def _smooth(values: np.ndarray, width: int) -> np.ndarray:
    """Running mean (T,) over `width` frames; the ends repeat."""
    width = max(1, width)
    padded = np.pad(values, (width // 2, width - 1 - width // 2), mode="edge")
    return np.convolve(padded, np.full(width, 1 / width), mode="valid")
