"""BC with a clock and a memory of the start instead of a map of every frame."""

from dataclasses import dataclass, field

from mimicbench.imitate.learners.bc import BCConfig
from mimicbench.imitate.settings.cloning import TrainConfig
from mimicbench.imitate.settings.inputs import REMEMBERING
from mimicbench.imitate.spec import CloneImitation, cloner


@dataclass(frozen=True)
class BCClockImitation(CloneImitation):
    """What it sees: its body, a clock, and what has to be found as it was seen first, carried along by odometry."""

    learner: str = "bc-clock"
    network: BCConfig = field(default_factory=lambda: BCConfig.small(REMEMBERING))
    train: TrainConfig = field(default_factory=lambda: TrainConfig(steps=40_000))


LEARNER = cloner("bc-clock", BCClockImitation)
