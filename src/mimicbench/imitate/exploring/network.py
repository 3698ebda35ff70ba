"""The network of who learns by trying: what is seen, through layers, to joint targets; and a critic of the same make.

On a processor a ResNet takes most of the time (560 of 850 microseconds a sample, of the smallest that made sense), so
small networks read the map's cells by one linear layer, as is usual where robots walk over rough ground.
"""

from dataclasses import dataclass, field, replace
from typing import ClassVar

import torch
from torch import Tensor, nn
from torch.nn import functional

from mimicbench.core.settings import Positive, Sizes
from mimicbench.imitate.encoder import Encoder, EncoderConfig
from mimicbench.imitate.inputs import Learner, NetworkConfig
from mimicbench.track.network import Blueprint, MLPConfig

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


@dataclass(frozen=True)
class ExplorerConfig(NetworkConfig):
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
        channels = self.inputs.seen_channels if self.inputs.sees else 0
        encoder = replace(self.encoder, channels=channels, cells=self.encoder.cells // self.encoder.pool, pool=1)
        sight = SightConfig(encoder, self.convolves, self.features, self.hidden)
        return Blueprint(sight, self.inputs.seen_size + sight.cells)

    def build(self) -> "Explorer":
        """A new network, with weights from torch's random numbers."""
        return Explorer(self)

    @staticmethod
    def small() -> "ExplorerConfig":
        """For a CPU: the highest of 4 x 4 cells, by a linear layer; about 200 thousand parameters."""
        encoder = replace(EncoderConfig.small(), pool=4)
        return ExplorerConfig(encoder=encoder, convolves=False, features=64, hidden=(256, 128))


class Explorer(Learner):
    """What was learned: state and maps -> joint targets. What it sees is normalized inside of its layers."""

    kind = "explorer"

    def __init__(self, config: ExplorerConfig) -> None:
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
