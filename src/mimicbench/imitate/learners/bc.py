"""Behavior cloning with convolutions, as imitate.networks.bc has it: what can be set of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar

from mimicbench.core.settings import Positive, Sizes
from mimicbench.imitate.settings.cloning import TrainConfig
from mimicbench.imitate.settings.encoder import EncoderConfig
from mimicbench.imitate.settings.inputs import InputConfig, NetworkConfig
from mimicbench.imitate.spec import CloneImitation, cloner

if TYPE_CHECKING:
    from mimicbench.imitate.networks.bc import BC


@dataclass(frozen=True)
class BCConfig(NetworkConfig):
    """The network. The defaults are the original's."""

    may_be_relative: ClassVar[bool] = True
    may_find_goals: ClassVar[bool] = True

    encoder: EncoderConfig = field(default_factory=EncoderConfig)
    """The network that reads the map."""
    reduce: Sizes = (128, 64, 32)
    """Channels of the convolutions after the encoder."""
    hidden: Positive = 1024
    """Width of the MLP's two hidden layers."""

    @property
    def layers(self) -> tuple[int, ...]:
        """How many of everything that is repeated."""
        return len(self.reduce), *self.encoder.layers

    def build(self) -> BC:
        """A new network, with weights from torch's random numbers."""
        from mimicbench.imitate.networks.bc import BC

        return BC(self)

    @staticmethod
    def small(inputs: InputConfig | None = None) -> BCConfig:
        """For a CPU: about 800 thousand parameters."""
        return BCConfig(inputs=inputs or InputConfig(), encoder=EncoderConfig.quick(), reduce=(48, 32, 16), hidden=512)


@dataclass(frozen=True)
class BCImitation(CloneImitation):
    """BC as the paper has it: S_current and the map of every frame."""

    learner: str = "bc"
    network: BCConfig = field(default_factory=BCConfig.small)
    train: TrainConfig = field(default_factory=lambda: TrainConfig(steps=3000))


LEARNER = cloner("bc", BCImitation)
