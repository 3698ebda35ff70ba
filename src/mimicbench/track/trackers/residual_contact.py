"""Our tracker, told what bears: it also knows on which of feet, hands and pelvis the reference rests, and is rewarded
for resting on the same.
"""

from dataclasses import dataclass, replace

from torch import Tensor

from mimicbench.sensors.contact import bears, told_to_bear
from mimicbench.sensors.context import StepContext, Transition
from mimicbench.track.trackers import residual


@dataclass(frozen=True)
class ResidualContactConfig(residual.ResidualConfig):
    """Weights of the reward: those of our tracker, and of what bears."""

    contact: float = 0.2
    """Of the share of feet, hands and pelvis that bear where the reference's do, and do not where they do not."""
    least_force: float = 1.0
    """What a part must bear to be counted [N]."""


def reward(context: StepContext, step: Transition, settings: ResidualContactConfig) -> Tensor:
    """(N,) that of our tracker, and agreement about what bears."""
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
