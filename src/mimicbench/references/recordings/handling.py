"""Where in a recording hands touch, clasp and lift something, or reach out."""

from dataclasses import dataclass

import numpy as np

from mimicbench.references.recordings.segments import lean_of


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
    """Then a clip goes on until the pelvis rises no faster than this [m/s],"""
    straight: float = 20.0
    """the trunk leans less than this [degrees], since who is still bent cannot hold anything for long,"""
    stands: float = 0.04
    """and no ankle is farther above the floor than this beyond its usual height [m]: the last pose is to be held."""
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


def stood_up(
    pelvis: np.ndarray,
    head: np.ndarray,
    ankles: np.ndarray,
    lifted: int,
    fps: float,
    rules: HandlingRules | None = None,
) -> int:
    """One past the frame in which who lifts something has stood up.

    Args:
        pelvis: (T, 3) [m].
        head: (T, 3) [m].
        ankles: (T, 2, 3) [m].
        lifted: one past the frame in which it is lifted.
        fps: frames per second.
        rules: what counts.
    """
    rules = rules or HandlingRules()
    ahead, foot = max(1, round(0.1 * fps)), ankles[..., 2].max(-1)
    latest = min(len(pelvis) - ahead, lifted + round(rules.rises * fps))
    rises = (pelvis[ahead:, 2] - pelvis[:-ahead, 2]) * fps / ahead
    floor = float(np.median(ankles[: lifted + 1, :, 2]))
    for end in range(lifted, latest + 1):
        upright = rises[end - 1] < rules.rising and lean_of(pelvis[end - 1], head[end - 1]) < rules.straight
        if upright and foot[end - 1] < floor + rules.stands:
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
