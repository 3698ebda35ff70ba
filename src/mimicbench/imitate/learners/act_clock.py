"""ACT with a clock and a memory of the start instead of a map of every frame."""

from dataclasses import dataclass, field

from mimicbench.imitate.learners.act import ACTConfig
from mimicbench.imitate.settings.cloning import TrainConfig
from mimicbench.imitate.settings.inputs import REMEMBERING
from mimicbench.imitate.spec import CloneImitation, cloner


@dataclass(frozen=True)
class ACTClockImitation(CloneImitation):
    """What it sees: its body, a clock, and what has to be found as it was seen first, carried along by odometry."""

    learner: str = "act-clock"
    network: ACTConfig = field(default_factory=lambda: ACTConfig.quick(REMEMBERING))
    train: TrainConfig = field(default_factory=lambda: TrainConfig(steps=12_000))


LEARNER = cloner("act-clock", ACTClockImitation)
