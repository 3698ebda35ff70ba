"""A pelvis in balance over its footsteps: a linear inverted pendulum whose support point goes from foot to foot."""

import numpy as np
from scipy.linalg import solve_banded

from mimicbench.references.body.body import Body
from mimicbench.references.curves import minimum_jerk
from mimicbench.references.locomotion.feet import roll_of
from mimicbench.references.locomotion.gait import Footsteps, Gait
from mimicbench.references.locomotion.route import left_of

GRAVITY = 9.81
HEIGHT = 0.9
"""Of the pendulum of a body of size 1 [m]."""
STANDING, HEEL, TOES = 0.005, 0.11, 0.17
"""The support point lies so far in front of the ankle of who stands [m], and in a long stride so far behind and in
front of that as the heel strikes and as the toes leave the floor."""
OUTWARD = 0.0
"""And so far outside of it while the foot bears the weight [m]."""
SHIFT = 0.84
"""It goes over to the other foot within this share of the step time."""


def balance(steps: Footsteps, time: np.ndarray, gait: Gait, body: Body, start: np.ndarray | None = None) -> np.ndarray:
    """Floor position (T, 2) [m] of a pendulum that is in balance over the feet.

    Solves c - (height / g) c'' = support(t), at rest over both feet at either end (Kajita et al. 2001; the two-point
    form, so nothing can run away), or from `start` (2,) [m] on. The support point goes from heel to toes of the foot
    that stands, and over to the other.
    """
    support = support_point(steps, time, gait, body)
    if start is not None:
        support[0] = start
    rate = HEIGHT * body.size / GRAVITY / float(time[1] - time[0]) ** 2
    bands = np.array([[-rate], [1 + 2 * rate], [-rate]]) * np.ones(len(time))
    bands[1, [0, -1]] = 1.0  # the ends are given, not solved for
    bands[0, 1] = bands[2, -2] = 0.0
    return solve_banded((1, 1), bands, support)


def support_point(steps: Footsteps, time: np.ndarray, gait: Gait, body: Body) -> np.ndarray:
    """Center of pressure (T, 2) [m] that the plan intends: from heel to toes of one foot, and over to the other."""
    under = _under_feet(steps, time, gait, body)
    # not quicker at higher speeds, for smoothness: it begins while the foot that is about to land is still in the air
    shift, both = SHIFT * gait.period, gait.overlap * gait.period
    left = np.full(len(time), 0.5)
    for side, lift in zip(steps.side, steps.lift_off, strict=True):
        left += minimum_jerk((time - lift + 0.5 * both) / shift + 0.5) * (side - left)
    if len(steps.side):
        left += minimum_jerk((time - steps.end) / shift) * (0.5 - left)
    return under[:, 1] + left[:, None] * (under[:, 0] - under[:, 1])


def _under_feet(steps: Footsteps, time: np.ndarray, gait: Gait, body: Body) -> np.ndarray:
    """(T, 2, 2) center of pressure of the left and of the right foot [m], had it all the weight."""
    under, leg = np.empty((len(time), 2, 2)), body.leg_length
    for side in (0, 1):
        mine = steps.side == side
        places = np.concatenate([steps.first_xy[side][None], steps.xy[mine]])
        yaws = np.concatenate([[steps.first_foot_yaw[side]], steps.yaw[mine]])
        lands, lifts = np.concatenate([[-np.inf], steps.touch_down[mine]]), np.append(steps.lift_off[mine], np.inf)
        for i, (xy, yaw) in enumerate(zip(places, yaws, strict=True)):
            stands = time >= (lands[i] + lifts[i - 1]) / 2 if i else slice(None)
            roll = max(0.0, roll_of(0.5 * (xy - places[i - 1]), yaw, leg)) if i else 0.0
            onward = max(0.0, roll_of(0.5 * (places[i + 1] - xy), yaw, leg)) if i + 1 < len(places) else 0.0
            moment = time[stands]
            # rolls off towards the next stride, and in from the last one
            along = STANDING - HEEL * roll * (1.0 - minimum_jerk((moment - lands[i]) / (0.5 * gait.period)))
            along = along + TOES * onward * minimum_jerk((moment - lifts[i]) / gait.period + 1.0)
            ahead, out = np.array([np.cos(yaw), np.sin(yaw)]), (1 - 2 * side) * OUTWARD * left_of(yaw)
            under[stands, side] = xy + body.size * (along[:, None] * ahead + out)
    return under
