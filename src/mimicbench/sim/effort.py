"""The mechanical effort of a control step, which P limits, from what was recorded in its substeps."""

import numpy as np


def effort_of(torque: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """(N,) e = sum_j (tau_j v_j)^2 [W^2], tau and v being means over S substeps, two at least (appendix D.2).

    Args:
        torque: (N, S, J) of the joints in each substep [N m].
        velocity: (N, S, J) [rad/s].
    """
    power = _sum_of_substeps(torque)
    power *= _sum_of_substeps(velocity)
    power *= power
    return power.sum(-1) / torque.shape[1] ** 4  # of means: with four substeps, to the last bit


def _sum_of_substeps(values: np.ndarray) -> np.ndarray:
    """(N, J) sum of (N, S, J), several times as fast as `sum` over so short an axis."""
    total = values[:, 0] + values[:, 1]
    for substep in range(2, values.shape[1]):
        total += values[:, substep]
    return total
