"""Our tracker, told contacts: it also knows which of feet, hands and pelvis are in contact in the reference, and is
rewarded for the same contacts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from mimicbench.track.trackers import residual

if TYPE_CHECKING:
    from torch import Tensor

    from mimicbench.sensors.context import StepContext, Transition


@dataclass(frozen=True)
class ResidualContactConfig(residual.ResidualConfig):
    """Weights of the reward: those of our tracker, and of contacts."""

    contact: float = 0.2
    """Of the share of feet, hands and pelvis whose contact is that of the reference."""
    least_force: float = 1.0
    """Force on a part from which on it counts as in contact [N]."""


def reward(context: StepContext, step: Transition, settings: ResidualContactConfig) -> Tensor:
    """(N,) that of our tracker, and agreement about contacts."""
    from mimicbench.sensors.contact import bears, told_to_bear

    agrees = bears(context, settings.least_force) == (told_to_bear(context.reference(0)) > 0.5)
    return residual.reward(context, step, settings) + settings.contact * agrees.float().mean(-1)


TRACKER = replace(
    residual.TRACKER,
    name="residual-contact",
    observations=(*residual.TRACKER.observations, "bears+1"),
    reward=reward,
    settings=ResidualContactConfig,
    measures_contact=True,
)
