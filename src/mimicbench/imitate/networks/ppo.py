"""PPO on what the robot senses, from nothing: the paper's baseline that learns from nobody (Schulman et al. 2017).

Actor and critic are a ResNet that reads the map and an MLP that reads its features beside the state. Actions are joint
position targets around the robot's rest pose, `rest + scale * a`. Reward and ends are those of
imitate.exploring.episodes, updates those of track.ppo. The paper says no more of it than that it is vision-based PPO.

On a processor the ResNet takes most of the time (560 of 850 microseconds a sample, of the smallest that made sense), so
small networks read the map's cells by one linear layer, as is usual where robots walk over rough ground.
"""

from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor, nn
from torch.nn import functional

from mimicbench.imitate.encoder import Encoder
from mimicbench.imitate.inputs import Learner
from mimicbench.imitate.learners.ppo import PPONetworkConfig
from mimicbench.imitate.settings.encoder import EncoderConfig
from mimicbench.track.network import MLPConfig

HEIGHT_UNIT = 0.03
"""What heights [m] of maps are multiplied by. All that is seen is divided by its deviation and 0.01 more, so cells are
by a third of a metre at least: those that seldom hold anything would else be the largest numbers of all."""


@dataclass(frozen=True)
class SightConfig:
    """Layers that take a state and, laid out behind it, maps: how actor and critic are made."""

    encoder: EncoderConfig
    """What reads the maps, whose channels and cells are those that it is given; 0 channels where there are none."""
    convolves: bool
    """Whether it is used: without, what follows it is given the cells themselves."""
    features: int
    """Numbers that its grid of features, or the cells, are brought down to."""
    hidden: tuple[int, ...]
    """Widths of the hidden layers."""

    normalizes: ClassVar[bool] = True
    widens: ClassVar[bool] = False

    @property
    def repeats(self) -> tuple[int, ...]:
        """How many of everything that is repeated."""
        return len(self.hidden), *self.encoder.layers

    @property
    def cells(self) -> int:
        """Numbers of the maps."""
        return self.encoder.channels * self.encoder.cells**2

    def build(self, width: int, frames: int, outputs: int) -> nn.Module:
        """(N, outputs) of (N, width) numbers, the maps last."""
        return Sight(self, width * frames, outputs)


class Sight(nn.Module):
    """MLP(state, linear(ResNet(maps))), or MLP(state, linear(maps))."""

    def __init__(self, config: SightConfig, inputs: int, outputs: int) -> None:
        super().__init__()
        self.config, size = config, inputs - config.cells
        if config.cells:
            grid = config.encoder.widths[-1] * config.encoder.side**2
            self.encoder = Encoder(config.encoder) if config.convolves else nn.Identity()
            self.squeeze = nn.Linear(grid if config.convolves else config.cells, config.features)
            size += config.features
        self.mlp = MLPConfig(config.hidden).build(size, 1, outputs)

    def forward(self, seen: Tensor) -> Tensor:
        """(N, outputs) from (N, inputs)."""
        if not self.config.cells:
            return self.mlp(seen)
        state, cells = seen.split([seen.shape[1] - self.config.cells, self.config.cells], -1)
        encoder = self.config.encoder
        maps = cells.unflatten(1, (encoder.channels, encoder.cells, encoder.cells))
        found = functional.elu(self.squeeze(self.encoder(maps).flatten(1)))
        return self.mlp(torch.cat([state, found], -1))


class Explorer(Learner):
    """What was learned: state and maps -> joint targets. What it sees is normalized inside of its layers."""

    kind = "ppo"

    def __init__(self, config: PPONetworkConfig) -> None:
        super().__init__(config.inputs, (config.action_size,))
        self.config = config
        self.network = config.blueprint.network(config.action_size)

    def begin_at(self, pose: Tensor) -> None:
        """Actions are around joint angles (A,) [rad]."""
        self.action_mean.copy_(pose)
        self.action_std.fill_(self.config.scale)

    def flat(self, vector: Tensor, picture: Tensor | None) -> Tensor:
        """(N, inputs) what the layers take, of vectors (N, ...) and maps (N, ..., 128, 128) as Senses gives them."""
        if picture is None:
            return vector.flatten(1)
        maps = HEIGHT_UNIT * functional.max_pool2d(picture.flatten(1, -3), self.config.encoder.pool)
        return torch.cat([vector.flatten(1), maps.flatten(1)], -1)

    def targets(self, action: Tensor) -> Tensor:
        """Joint targets (N, A) [rad] of actions (N, A)."""
        return self.action_mean + self.action_std * action

    def plan(self, vector: Tensor, picture: Tensor | None) -> Tensor:
        """The targets (N, 1, A) [rad] of the mean action."""
        return self.targets(self.network(self.flat(vector, picture)))[:, None]
