"""How high the pelvis is carried: over legs as straight as people's, which bend a little as they take the weight."""

from dataclasses import dataclass

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.references.body.body import Body
from mimicbench.references.curves import minimum_jerk, smooth, smooth_above
from mimicbench.references.locomotion.feet import Feet, roll_of
from mimicbench.references.locomotion.gait import Footsteps, Gait

STANDING = np.deg2rad(6.0)
"""Flexion of the knees of who stands [rad]."""
BEARING = np.deg2rad(3.4)
"""And of the leg that has come straight under the body in a long stride, until the other foot lands."""
LOADING = np.deg2rad(10.8)
"""A knee bends by so much more as it takes the weight of a long stride [rad]..."""
LOADS, STRAIGHTENS = 0.125, 0.37
"""...most after the first share of the gait cycle; after the second it is straight again."""
STRAIGHT_BEFORE = 0.015
"""The leg that is about to land is straightest so much earlier, in gait cycles."""
SINKS, HIGHER = 0.47, 0.012
"""A foot in the air may be higher than it would be, by so much per second before it lands [m/s], and at most [m]."""
UPRIGHT, STRAIGHTEST = np.deg2rad(5.5), np.deg2rad(4.0)
"""No knee of a leg that bears is straighter after a step on the spot, and after a long one [rad]."""
LANDED = np.deg2rad(8.0)
"""And none of a leg that has just landed from a long one [rad]."""
EARLY, LATE = -0.015, 0.12
"""The pelvis goes over from one leg's arc to the next one's from and until so long before and after the foot lands, in
gait cycles."""
SOFT = 0.10
"""[s] The arcs meet in a cusp at each heel strike, which is smoothed over so long to either side."""


@dataclass(frozen=True)
class Hips:
    """Where the hips are, but for the height of the pelvis, and where their feet are; axis 1 is left, right."""

    xy: np.ndarray
    """(T, 2, 2) [m]."""
    above: np.ndarray
    """(T, 2) over the pelvis joint [m]."""
    ankle: np.ndarray
    """(T, 2, 3) [m]."""
    aloft: np.ndarray
    """(T, 2) [s] since the feet left the floor or until they land, whichever is less; 0 while they bear."""

    @staticmethod
    def of(body: Body, pelvis_xy: np.ndarray, turn: np.ndarray, feet: Feet, fps: float) -> "Hips":
        """Hips of a pelvis at (T, 2) [m] that is turned by (T, 4)."""
        frames = np.arange(len(turn))[:, None]
        left = np.maximum.accumulate(np.where(feet.contact, frames, -len(turn)))
        lands = np.minimum.accumulate(np.where(feet.contact, frames, 2 * len(turn))[::-1])[::-1]
        aloft = np.minimum(frames - left, lands - frames) / fps
        offsets = rot.rotate(turn[:, None], body.skeleton.offsets[[leg.root for leg in body.legs]])
        return Hips(pelvis_xy[:, None] + offsets[..., :2], offsets[..., 2], feet.pos_w, aloft)

    def height(self, body: Body, knee: np.ndarray | float) -> np.ndarray:
        """(T, 2) heights of the pelvis at which each leg's knee is bent by so much [rad]."""
        upper, lower = body.length(body.legs[0])
        squared = upper**2 + lower**2 + 2 * upper * lower * np.cos(knee)
        away = ((self.xy - self.ankle[..., :2]) ** 2).sum(-1)
        return self.ankle[..., 2] + np.sqrt(np.maximum(squared - away, 0.25 * squared)) - self.above

    def highest(self, body: Body, knee: np.ndarray | float = STRAIGHTEST) -> np.ndarray:
        """(T,) the height of the pelvis at which legs reach the floor if they bear, and nearly if they have just left
        it or will land, with knees that are bent by so much [rad].
        """
        return (self.height(body, knee) + np.minimum(SINKS * self.aloft, HIGHER)).min(-1)


def carried_height(body: Body, hips: Hips, steps: Footsteps, time: np.ndarray, gait: Gait) -> np.ndarray:
    """(T,) height of the pelvis [m] over the arcs of legs whose knees bend as people's do in stance."""
    knee, straightest, bears = _stances(steps, time, gait, body.leg_length)
    heights = hips.height(body, knee)
    fps = 1.0 / float(time[1] - time[0])
    height = smooth((bears * heights).sum(-1) / bears.sum(-1), round(SOFT * fps))
    return height - smooth_above(np.maximum(height - hips.highest(body, straightest), 0.0), round(0.13 * fps))


def _stances(steps: Footsteps, time: np.ndarray, gait: Gait, leg: float) -> tuple[np.ndarray, ...]:
    """(T, 2) how far each knee is to be bent while its leg bears and at least [rad], and how much its arc counts."""
    knee, bears = np.full((len(time), 2), STANDING), np.ones((len(time), 2))
    straightest = np.full((len(time), 2), UPRIGHT)
    places, yaws = steps.first_xy.copy(), steps.first_foot_yaw.copy()
    for side, xy, yaw, lift, land in zip(
        steps.side, steps.xy, steps.yaw, steps.lift_off, steps.touch_down, strict=True
    ):
        long = min(1.0, max(0.0, roll_of(xy - places[1 - side], yaw, leg)))
        cycle = 2.0 * (land - lift) / (1.0 - gait.overlap)
        before = EARLY * cycle
        since = (time - land) / cycle + STRAIGHT_BEFORE
        loaded = minimum_jerk(since / LOADS) * (1.0 - minimum_jerk((since - LOADS) / (STRAIGHTENS - LOADS)))
        coming = 0.31 * np.maximum(-since / 0.10, 0.0) ** 2
        stance = STANDING + long * (BEARING - STANDING + LOADING * loaded) + np.minimum(coming, LOADING)
        stands = time > 0.5 * (lift + land)
        knee[stands, side] = stance[stands]
        later = LANDED + minimum_jerk((time - land) / cycle / LOADS) * (STRAIGHTEST - LANDED)
        straightest[stands, side] = (UPRIGHT + long * (later - UPRIGHT))[stands]
        leaves = (time - lift + 0.5 * gait.overlap * cycle + before) / (before + LATE * cycle)
        lands = (time - land + before) / (before + LATE * cycle)
        bears[:, side] *= 1.0 - minimum_jerk(leaves) + minimum_jerk(lands)
        places[side], yaws[side] = xy, yaw
    return knee, straightest, np.maximum(bears, 1e-6)
