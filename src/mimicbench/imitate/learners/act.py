"""ACT, as imitate.networks.act has it: what can be set of it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, ClassVar

from mimicbench.core.settings import Positive, Share
from mimicbench.imitate.settings.cloning import TrainConfig
from mimicbench.imitate.settings.encoder import EncoderConfig
from mimicbench.imitate.settings.inputs import InputConfig, NetworkConfig, Window, check_heads
from mimicbench.imitate.spec import CloneImitation, cloner

if TYPE_CHECKING:
    from mimicbench.imitate.networks.act import ACT


@dataclass(frozen=True)
class ACTConfig(NetworkConfig):
    """The network. The defaults are the original's and the paper's."""

    may_be_relative: ClassVar[bool] = True
    may_find_goals: ClassVar[bool] = True

    encoder: EncoderConfig = field(default_factory=EncoderConfig)
    """The network that reads the map."""
    chunk: Positive = 100
    """Frames that are predicted at once."""
    hidden: Positive = 512
    """Width of all tokens."""
    feedforward: Positive = 3200
    """Width inside the feed-forward blocks."""
    heads: Positive = 8
    """Attention heads."""
    posterior_layers: Positive = 4
    """Of the variational encoder."""
    encoder_layers: Positive = 4
    """Of the policy's transformer encoder."""
    decoder_layers: Positive = 7
    """Of the policy's transformer decoder. All are used."""
    latent: Positive = 32
    """Numbers in z."""
    dropout: Share = 0.1
    """Share of activations that are dropped in training."""
    kl_weight: float = 10.0
    """Weight of the divergence in the loss."""
    ensembles: bool = False
    """Carry out the mean of what all chunks so far say of a frame, as the original can, instead of the first action of
    the newest."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_heads(self.hidden, self.heads)

    @property
    def window(self) -> Window:
        """Which frames it is shown."""
        return Window(self.chunk)

    @property
    def layers(self) -> tuple[int, ...]:
        """How many of everything that is repeated."""
        return self.posterior_layers, self.encoder_layers, self.decoder_layers, *self.encoder.layers

    def build(self) -> ACT:
        """A new network, with weights from torch's random numbers."""
        from mimicbench.imitate.networks.act import ACT

        return ACT(self)

    @staticmethod
    def small(inputs: InputConfig | None = None) -> ACTConfig:
        """For a CPU: about 1 million parameters, half a second ahead."""
        return ACTConfig(
            inputs=inputs or InputConfig(),
            encoder=EncoderConfig.quick(),
            chunk=25,
            hidden=128,
            feedforward=256,
            heads=4,
            posterior_layers=1,
            encoder_layers=2,
            decoder_layers=1,
            latent=16,
            dropout=0.05,
        )

    @staticmethod
    def quick(inputs: InputConfig | None = None) -> ACTConfig:
        """For minutes on a CPU: about 400 thousand parameters, a fifth of a second ahead.

        Many batches do more for it than a large network.
        """
        return replace(ACTConfig.small(inputs), chunk=10, hidden=96, feedforward=256)


@dataclass(frozen=True)
class ACTImitation(CloneImitation):
    """ACT as the paper has it: S_current and the map of every frame."""

    learner: str = "act"
    network: ACTConfig = field(default_factory=ACTConfig.small)
    train: TrainConfig = field(default_factory=lambda: TrainConfig(steps=1500))


LEARNER = cloner("act", ACTImitation)
