"""Diffusion Policy, as imitate.networks.diffusion has it: what can be set of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from mimicbench.core.settings import BadSetting, Positive, Sizes
from mimicbench.imitate.settings.cloning import TrainConfig
from mimicbench.imitate.settings.encoder import EncoderConfig
from mimicbench.imitate.settings.inputs import InputConfig, NetworkConfig, Window
from mimicbench.imitate.spec import CloneImitation, cloner

if TYPE_CHECKING:
    from mimicbench.imitate.networks.diffusion import Diffusion


@dataclass(frozen=True)
class DiffusionConfig(NetworkConfig):
    """The network. The defaults are the original's, for images."""

    inputs: InputConfig = InputConfig(history=2)
    """What it sees."""
    encoder: EncoderConfig = field(default_factory=EncoderConfig)
    """The network that reads the maps; the mean over its grid is what counts."""
    chunk: Positive = 16
    """Frames that are predicted at once; the first is the first one that is seen. Twice divisible by 2."""
    executes: Positive = 8
    """Frames that are carried out before the next prediction."""
    widths: Sizes = (512, 1024, 2048)
    """Channels of the U-Net, whose time is halved from each to the next."""
    kernel: Positive = 5
    """Frames that a convolution spans."""
    groups: Positive = 8
    """Of channels that are normalized together."""
    step_embedding: Positive = 128
    """Numbers that tell the amount of noise."""
    noise_steps: Positive = 100
    """T: amounts of noise that are learned."""
    sample_steps: Positive = 16
    """In how many of them noise is turned into actions."""

    def __post_init__(self) -> None:
        super().__post_init__()
        halves, shortest = 2 ** (len(self.widths) - 1), self.inputs.history - 1 + self.executes
        if self.chunk % halves or self.chunk < shortest:
            raise BadSetting(
                f"network.chunk is {self.chunk}; give a multiple of {halves} that is not below {shortest}, the frames "
                "that are seen before the present one and those that are carried out"
            )
        if self.kernel % 2 == 0:
            raise BadSetting(f"network.kernel is {self.kernel}; give an odd number, which has a middle")
        if any(width % self.groups for width in self.widths):
            raise BadSetting(f"network.widths are {self.widths}; give multiples of network.groups, {self.groups}")
        if self.step_embedding % 2 or self.step_embedding < 4:
            raise BadSetting(f"network.step-embedding is {self.step_embedding}; give an even number from 4 on")
        if self.noise_steps < self.sample_steps:
            raise BadSetting(
                f"network.sample-steps is {self.sample_steps}, and only {self.noise_steps} amounts of noise are learned"
            )

    @property
    def window(self) -> Window:
        """Which frames it is shown."""
        return Window(self.chunk, past=self.inputs.history - 1)

    @property
    def layers(self) -> tuple[int, ...]:
        """How many of everything that is repeated."""
        return len(self.widths), *self.encoder.layers

    def build(self) -> Diffusion:
        """A new network, with weights from torch's random numbers."""
        from mimicbench.imitate.networks.diffusion import Diffusion

        return Diffusion(self)

    @staticmethod
    def small(inputs: InputConfig | None = None) -> DiffusionConfig:
        """For a CPU: about 2.5 million parameters."""
        return DiffusionConfig(
            inputs=inputs or InputConfig(history=2),
            encoder=EncoderConfig.small(),
            widths=(32, 64, 128),
            step_embedding=64,
            sample_steps=8,
        )


@dataclass(frozen=True)
class DiffusionImitation(CloneImitation):
    """Diffusion Policy as the paper has it: S_current and the maps of the last two frames."""

    learner: str = "diffusion"
    network: DiffusionConfig = field(default_factory=DiffusionConfig.small)
    train: TrainConfig = field(
        default_factory=lambda: TrainConfig(steps=20_000, learning_rate=3e-4, betas=(0.95, 0.999), weight_decay=1e-6)
    )


LEARNER = cloner("diffusion", DiffusionImitation)
