"""PPO from nothing: what can be set of it. Its network is imitate.networks.ppo; ppo_training is how it learns."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

from mimicbench.core.settings import Amount, Positive, Sizes
from mimicbench.imitate.settings.encoder import EncoderConfig
from mimicbench.imitate.settings.inputs import NetworkConfig
from mimicbench.imitate.spec import Given, ImitateConfig, LearnerSpec
from mimicbench.track.learning.ppo_config import PPOConfig

if TYPE_CHECKING:
    from mimicbench.imitate.networks.ppo import Explorer
    from mimicbench.track.network import Blueprint


@dataclass(frozen=True)
class ExploreConfig:
    """How episodes of training start, and what a step is worth."""

    num_envs: Positive = 256
    """Robots side by side."""
    starts: Positive = 2048
    """Starts that are drawn in advance; each episode takes one of them."""
    approach: float = 10.0
    """Reward for each metre that a step came nearer [1/m]; with 0 the reward is nearness alone."""
    change: float = 0.002
    """Price of each squared unit by which the action changes."""


@dataclass(frozen=True)
class PPONetworkConfig(NetworkConfig):
    """The network. The defaults are ResNet-18 and the layers of HumanPlus' tracker."""

    encoder: EncoderConfig = field(default_factory=EncoderConfig)
    """The network that reads the map; what it pools is pooled before anything is remembered for an update."""
    convolves: bool = True
    """Whether it reads the map; without, a linear layer reads the cells that it would be given."""
    features: Positive = 256
    """Numbers that the map's features, or its cells, are brought down to."""
    hidden: Sizes = (512, 512, 512)
    """Widths of the hidden layers."""
    scale: float = 0.5
    """[rad] by which an action of 1 is off the rest pose."""

    @property
    def layers(self) -> tuple[int, ...]:
        """How many of everything that is repeated."""
        return len(self.hidden), *self.encoder.layers

    @property
    def blueprint(self) -> Blueprint:
        """What actor and critic are built by."""
        from mimicbench.imitate.networks.ppo import SightConfig
        from mimicbench.track.network import Blueprint

        channels = self.inputs.seen_channels if self.inputs.sees else 0
        encoder = replace(self.encoder, channels=channels, cells=self.encoder.cells // self.encoder.pool, pool=1)
        sight = SightConfig(encoder, self.convolves, self.features, self.hidden)
        return Blueprint(sight, self.inputs.seen_size + sight.cells)

    def build(self) -> Explorer:
        """A new network, with weights from torch's random numbers."""
        from mimicbench.imitate.networks.ppo import Explorer

        return Explorer(self)

    @staticmethod
    def small() -> PPONetworkConfig:
        """For a CPU: the highest of 4 x 4 cells, by a linear layer; about 200 thousand parameters."""
        encoder = replace(EncoderConfig.small(), pool=4)
        return PPONetworkConfig(encoder=encoder, convolves=False, features=64, hidden=(256, 128))


def _ppo() -> PPOConfig:
    """At a fixed rate: what is seen widens while learning goes on, which the divergence alone would put the rate down
    for.
    """
    return PPOConfig(steps=24, epochs=5, gamma=0.99, entropy=0.0, learning_rate=3e-4, schedule="fixed", initial_std=0.4)


@dataclass(frozen=True)
class PPOImitation(ImitateConfig):
    """Vision-based PPO without references."""

    learner: str = "ppo"
    gains: str | None = "improved"
    """Gains of the robot that the policy drives."""
    network: PPONetworkConfig = field(default_factory=PPONetworkConfig.small)
    ppo: PPOConfig = field(default_factory=_ppo)
    """The reinforcement learning; layers are those of the network."""
    explore: ExploreConfig = field(default_factory=ExploreConfig)
    samples: Annotated[int, Amount()] = 20_000_000
    """Control steps to learn from, over all robots."""
    threads: Positive = 2
    """Threads of the network's arithmetic. Sums round differently with another number, so it is part of the result."""
    save_every: float = 120.0
    """Seconds between saves of the training state: what a kill can lose at most."""

    references: ClassVar[bool] = False

    @property
    def remembers(self) -> bool:
        """Whether it remembers its goal."""
        return self.network.inputs.memory


def learn(folder: Path, given: Given, config: PPOImitation) -> dict[str, Any]:
    """Learn into a folder, or go on learning there."""
    from mimicbench.imitate.learners.ppo_training import explore

    return explore(folder, given, config)


LEARNER = LearnerSpec("ppo", PPOImitation, learn)
