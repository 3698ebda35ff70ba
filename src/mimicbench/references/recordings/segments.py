"""Finds the parts of a long recording in which somebody walks up to something and sits down, or lies down."""

from dataclasses import dataclass

import numpy as np

from mimicbench.core.motion import Skeleton
from mimicbench.references.body.body import Body, body_of
from mimicbench.references.checks.contacts import drop_short


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
    settles: float = 4.0
    """Time after the pelvis came below a standing one's in which its height is judged [s]; later it may do anything."""
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
    """All walk-to-seated parts of a motion, from the positions (T, J, 3) [m] of the skeleton's joints."""
    rules = rules or SittingRules()
    body = body_of(skeleton)
    pelvis, head = pos[:, body.pelvis], pos[:, body.head]
    height = pelvis[:, 2]
    standing = _standing(body, height)
    speed = _smooth(np.linalg.norm(np.gradient(pelvis[:, :2], 1 / fps, axis=0), axis=-1), round(0.5 * fps))
    lean = lean_of(pelvis, head)
    found = []
    down = np.concatenate([[False], height < 0.8 * standing, [False]])
    edges = np.flatnonzero(np.diff(down))
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        ahead = height[begin : min(end, begin + round(rules.settles * fps))]
        rest = float(np.median(ahead))
        if end - begin < rules.stays * fps or not rules.least_height <= rest / standing <= rules.most_height:
            continue
        landing = begin + int(np.argmax(ahead < rest + 0.02))
        last = min(end, landing + round(rules.after * fps))
        if (
            (last - landing) / fps < 0.5 * rules.stays
            or np.median(lean[landing:last]) > rules.lean
            or height[last - 1] > rest + 0.1
        ):
            continue
        start = _start(pelvis, speed, landing, last, fps, rules)
        if start is not None:
            found.append(Sitting(start, landing, last))
    return found


@dataclass(frozen=True)
class LyingRules(SittingRules):
    """What counts as lying down, and how much before and after it is kept. Heights and lean are of who lies."""

    least_height: float = 0.15
    most_height: float = 0.55
    lean: float = 60.0
    """Least that the line from pelvis to head leans [degrees]."""
    stays: float = 1.5
    before: float = 12.0
    after: float = 3.0
    stretched: float = 0.2
    """Least distance of the feet beyond the pelvis, seen from the head [m]; who squats has them below."""


def find_lyings(skeleton: Skeleton, pos: np.ndarray, fps: float, rules: LyingRules | None = None) -> list[Sitting]:
    """All parts of a motion in which somebody walks up and lies down.

    `landing` is the first frame in which head and pelvis are down.
    """
    rules = rules or LyingRules()
    body = body_of(skeleton)
    pelvis, head = pos[:, body.pelvis], pos[:, body.head]
    height = pelvis[:, 2]
    standing = _standing(body, height)
    speed = _smooth(np.linalg.norm(np.gradient(pelvis[:, :2], 1 / fps, axis=0), axis=-1), round(0.5 * fps))
    feet = pos[:, [leg.end for leg in body.legs]].mean(1)
    lies = (lean_of(pelvis, head) > rules.lean) & (height < rules.most_height * standing)
    lies &= _beyond(pelvis, head, feet) > rules.stretched
    lies = drop_short(lies, max(1, round(0.7 * fps)))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], lies, [False]])))
    found = []
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        low = float(np.median(head[begin:end, 2]))
        landing = begin + int(np.argmax(head[begin:end, 2] < low + 0.05))
        if end - landing < rules.stays * fps or np.median(height[landing:end]) < rules.least_height * standing:
            continue
        # the walk ends where the pelvis comes down
        up = np.flatnonzero(height[:begin] > 0.8 * standing)
        start = _start(pelvis, speed, int(up[-1]) + 1, landing, fps, rules) if len(up) else None
        if start is not None:
            found.append(Sitting(start, landing, min(end, landing + round(rules.after * fps))))
    return found


def _standing(body: Body, height: np.ndarray) -> float:
    """Height of the pelvis of who stands [m], who need not do so for long; a jump is higher."""
    return min(body.standing_height, float(height.max()))


def _beyond(pelvis: np.ndarray, head: np.ndarray, feet: np.ndarray) -> np.ndarray:
    """(T,) how far the feet are beyond the pelvis, seen from the head and from above [m]."""
    trunk, legs = (pelvis - head)[:, :2], (feet - pelvis)[:, :2]
    return (trunk * legs).sum(-1) / np.maximum(np.linalg.norm(trunk, axis=-1), 1e-9)


def lean_of(pelvis: np.ndarray, head: np.ndarray) -> np.ndarray:
    """(...) how far the line from pelvis to head (..., 3) leans [degrees]."""
    trunk = head - pelvis
    return np.degrees(np.arctan2(np.linalg.norm(trunk[..., :2], axis=-1), trunk[..., 2]))


def _start(
    pelvis: np.ndarray, speed: np.ndarray, landing: int, last: int, fps: float, rules: SittingRules
) -> int | None:
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
