"""A pelvis in balance over its footsteps: a linear inverted pendulum whose support point goes from foot to foot."""

import numpy as np
from scipy.linalg import solve_banded

from mimicbench.core.curves import minimum_jerk
from mimicbench.references.locomotion.gait import Footsteps, Gait, left_of

GRAVITY = 9.81


def balance(
    steps: Footsteps, time: np.ndarray, gait: Gait, scale: float, height: float, start: np.ndarray | None = None
) -> np.ndarray:
    """Floor position (T, 2) [m] of a pendulum of some height [m] that is in balance over the feet.

    Solves c - (height / g) c'' = support(t), at rest over both feet at either end (Kajita et al. 2001; the two-point
    form, so
    nothing can run away), or from `start` (2,) [m] on. The support point is the stance foot during a swing and moves
    over during
    double support.
    """
    support = support_point(steps, time, gait, scale)
    if start is not None:
        support[0] = start
    rate = height / GRAVITY / float(time[1] - time[0]) ** 2
    bands = np.array([[-rate], [1 + 2 * rate], [-rate]]) * np.ones(len(time))
    bands[1, [0, -1]] = 1.0  # the ends are given, not solved for
    bands[0, 1] = bands[2, -2] = 0.0
    return solve_banded((1, 1), bands, support)


def support_point(steps: Footsteps, time: np.ndarray, gait: Gait, scale: float) -> np.ndarray:
    """Center of pressure (T, 2) [m] that the plan intends."""

    def under(xy: np.ndarray, yaw: float, side: int) -> np.ndarray:
        return xy + scale * (
            gait.forefoot * np.array([np.cos(yaw), np.sin(yaw)]) + (1 - 2 * side) * gait.outward * left_of(yaw)
        )

    feet = [
        under(xy, yaw, side) for side, (xy, yaw) in enumerate(zip(steps.first_xy, steps.first_foot_yaw, strict=True))
    ]
    support = np.broadcast_to(0.5 * (feet[0] + feet[1]), (len(time), 2)).copy()
    # not quicker at higher speeds, for smoothness: it begins while the foot that is about to land is still in the air
    shift = gait.double_support * gait.period
    begin = steps.lift_off - shift
    for i, (side, xy, yaw) in enumerate(zip(steps.side, steps.xy, steps.yaw, strict=True)):
        share = minimum_jerk((time - begin[i]) / shift)[:, None]
        support = support + share * (feet[1 - side] - support)
        feet[side] = under(xy, yaw, side)
    if len(steps.side):
        share = minimum_jerk((time - steps.end) / (2 * shift))[:, None]
        support = support + share * (0.5 * (feet[0] + feet[1]) - support)
    return support
