"""Finds the parts of a long recording in which somebody walks up to something and sits down, lies down, reaches out,
or lifts it.
"""

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
    lean = _lean(pelvis, head)
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
    lies = (_lean(pelvis, head) > rules.lean) & (height < rules.most_height * standing)
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


def _lean(pelvis: np.ndarray, head: np.ndarray) -> np.ndarray:
    """(T,) how far the line from pelvis to head leans [degrees]."""
    trunk = head - pelvis
    return np.degrees(np.arctan2(np.linalg.norm(trunk[:, :2], axis=-1), trunk[:, 2]))


@dataclass(frozen=True)
class HandlingRules:
    """What counts as reaching for something and lifting it, and how much of it is kept: the paper's clipping rules
    for T and L.
    """

    before: float = 3.0
    """Most time kept before the hands touch [s]."""
    touching: float = 0.12
    """A wrist nearer to the object than this [m] touches it with its hand."""
    before_touch: float = 0.1
    """A clip of touching ends so long before the touch [s]."""
    lift: float = 0.25
    """Something is lifted when it, or what the hands clasp, is that much higher [m]."""
    rising: float = 0.15
    """Then a clip goes on until the pelvis rises no faster than this [m/s]: who is still bent cannot hold anything."""
    rises: float = 1.5
    """But no longer than this [s]."""
    grip: float = 0.05
    """Most that the distance between the wrists changes while they lift something [m]."""
    apart: float = 0.12
    """Most that one wrist is above the other when they clasp something [m]."""
    leap: float = 0.08
    """Who has both ankles so far above where they usually are [m] is in the air."""
    leaps: float = 0.5
    """So long before and after a lift, nobody is [s]."""
    reach: float = 0.42
    """Least distance of a hand from the pelvis, seen from above, when it reaches for something [m]; above the chest its
    height counts, too."""
    chest: float = 0.2
    """Above the pelvis [m]."""
    still: float = 0.2
    """And it is slower than this [m/s]."""
    shortest: float = 0.5
    """A clip is at least this long [s]."""


@dataclass(frozen=True)
class Handling:
    """A reach, and perhaps a lift, in frames."""

    start: int
    touch: int
    """The first frame in which the hands touch, or clasp."""
    end: int | None
    """One past the frame in which the height is reached; None if it never is."""


def find_handling(
    away: np.ndarray, height: np.ndarray, fps: float, rules: HandlingRules | None = None
) -> Handling | None:
    """The first touch of a tracked object with both hands, and its lift.

    Args:
        away: (T, 2) distance of each wrist from the object [m].
        height: (T,) of the object [m].
        fps: frames per second.
        rules: what counts.
    """
    rules = rules or HandlingRules()
    touches = np.flatnonzero((away < rules.touching).all(-1))
    if not len(touches):
        return None
    touch = int(touches[0])
    # what rests is where it was until the hands came
    lifted = np.flatnonzero(height[touch:] > np.median(height[: touch + 1]) + rules.lift)
    return Handling(
        max(0, touch - round(rules.before * fps)), touch, touch + int(lifted[0]) + 1 if len(lifted) else None
    )


def stood_up(pelvis: np.ndarray, lifted: int, fps: float, rules: HandlingRules | None = None) -> int:
    """One past the frame in which who lifts something has stood up, from heights (T,) of the pelvis [m] and one past
    the frame in which it is lifted.
    """
    rules = rules or HandlingRules()
    ahead = max(1, round(0.1 * fps))
    latest = min(len(pelvis) - ahead, lifted + round(rules.rises * fps))
    for end in range(lifted, latest + 1):
        if pelvis[end - 1 + ahead] - pelvis[end - 1] < rules.rising * ahead / fps:
            return end
    return max(lifted, latest)


def find_clasps(
    wrists: np.ndarray, ankles: np.ndarray, fps: float, rules: HandlingRules | None = None
) -> list[Handling]:
    """Lifts of something that was not recorded: both wrists (T, 2, 3) [m] rise together, as far apart as they were,
    from below the hips, while a foot stays on the floor: who leaps up right after lifts nothing. ankles: (T, 2, 3) [m].
    """
    rules = rules or HandlingRules()
    apart = np.linalg.norm(wrists[:, 0] - wrists[:, 1], axis=-1)
    low = wrists[..., 2].max(-1)
    foot = ankles[..., 2].min(-1)
    flies = foot > np.median(foot) + rules.leap
    found, frame = [], 0
    while frame < len(low) - 1:
        # from the lowest place on, as long as the grip lasts
        ahead = slice(frame, min(len(low), frame + round(3.0 * fps)))
        loose = np.flatnonzero(np.abs(apart[ahead] - apart[frame]) > rules.grip)
        span = low[ahead][: loose[0]] if len(loose) else low[ahead]
        up = np.flatnonzero(span > low[frame] + rules.lift)
        level = abs(wrists[frame, 0, 2] - wrists[frame, 1, 2]) < rules.apart
        after = frame + int(up[0]) + 1 + round(rules.leaps * fps) if len(up) else frame
        leaps = flies[max(0, frame - round(rules.leaps * fps)) : after].any()
        clasps = low[frame] < 0.75 and 0.2 < apart[frame] < 0.9 and level and not leaps
        if clasps and len(up) and low[frame] <= span.min() + 0.01:
            found.append(Handling(max(0, frame - round(rules.before * fps)), frame, frame + int(up[0]) + 1))
            frame += int(up[0]) + round(1.0 * fps)
        frame += 1
    return found


def find_reach(wrists: np.ndarray, pelvis: np.ndarray, fps: float, rules: HandlingRules | None = None) -> int | None:
    """The frame in which who stands first holds a hand out about as far as ever, from wrists (T, 2, 3) and pelvis
    (T, 3) [m]; None if nobody does.
    """
    rules = rules or HandlingRules()
    away = wrists - pelvis[:, None]
    out = np.hypot(np.linalg.norm(away[..., :2], axis=-1), np.maximum(away[..., 2] - rules.chest, 0.0))
    speed = np.linalg.norm(np.gradient(wrists, 1 / fps, axis=0), axis=-1)
    stands = pelvis[:, 2] > 0.85 * np.quantile(pelvis[:, 2], 0.9)
    held = np.where((speed < rules.still) & stands[:, None], out, 0.0).max(-1)
    return int(np.argmax(held > 0.95 * held.max())) if held.max() > rules.reach else None


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
