"""A clock as an input: what a policy needs to know how far it has come, without looking at its own past actions."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from torch import Tensor

PERIODS = tuple(0.45 * 2.0**i for i in range(6))
"""[s] geometric from about one step to the longest approach: 0.45, 0.9, 1.8, 3.6, 7.2, 14.4."""
SIZE = 1 + 2 * len(PERIODS)


def clock_features(time: Tensor) -> Tensor:
    """The clock (N, 13) at times (N,) [s] since the start: the time in units of the longest period, six sines, six
    cosines.
    """
    import torch  # who only asks what can be set of a network with a clock does without

    periods = torch.tensor(PERIODS, dtype=torch.float64, device=time.device)
    phase = (2 * math.pi) * time.double()[:, None] / periods
    return torch.cat([time.double()[:, None] / PERIODS[-1], phase.sin(), phase.cos()], -1).float()
