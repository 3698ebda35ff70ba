"""A tracker's network at inference: observations, normalized or not, through layers. Independent of what trained it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np
import torch
from torch import nn

from mimicbench.core.settings import Sizes


class NetworkConfig(Protocol):
    """A frozen dataclass that says how the networks of one kind are made: the actor's, and the critic's beside it."""

    normalizes: ClassVar[bool]
    """Whether they see observations less their mean, divided by their deviation."""
    widens: ClassVar[bool]
    """Whether they are a chain of linear layers, which can take over what a narrower one has learned."""

    @property
    def repeats(self) -> tuple[int, ...]:
        """How many of everything that is repeated."""
        ...

    def build(self, width: int, frames: int, outputs: int) -> nn.Module:
        """(N, outputs) of (N, frames * width) numbers, the oldest frame first; the last linear layer gives them.

        Weights are drawn from torch's random numbers.
        """
        ...


@dataclass(frozen=True)
class MLPConfig:
    """Linear layers with ELU between them."""

    hidden: Sizes
    """Widths of the hidden layers."""

    normalizes: ClassVar[bool] = True
    widens: ClassVar[bool] = True

    @property
    def repeats(self) -> tuple[int, ...]:
        """Hidden layers."""
        return (len(self.hidden),)

    def build(self, width: int, frames: int, outputs: int) -> nn.Module:
        """All frames side by side, through all layers."""
        layers: list[nn.Module] = []
        before = width * frames
        for size in self.hidden:
            layers += [nn.Linear(before, size), nn.ELU()]
            before = size
        return nn.Sequential(*layers, nn.Linear(before, outputs))


class TrackerNetwork(nn.Module):
    """mean action = layers((obs - mean) / std), or layers(obs)."""

    def __init__(self, layers: nn.Module, inputs: int, normalizes: bool = True) -> None:
        super().__init__()
        self.normalizes = normalizes
        if normalizes:
            self.obs_mean: torch.Tensor
            self.obs_std: torch.Tensor
            self.register_buffer("obs_mean", torch.zeros(inputs))
            self.register_buffer("obs_std", torch.ones(inputs))
        self.layers = layers

    def forward(self, obs: torch.Tensor) -> torch.Tensor:
        """(N, outputs) from (N, inputs)."""
        return self.layers((obs - self.obs_mean) / (self.obs_std + 1e-2) if self.normalizes else obs)

    def tensors(self) -> dict[str, np.ndarray]:
        """All weights and statistics by name, for a checkpoint."""
        return {name: value.detach().cpu().numpy() for name, value in self.state_dict().items()}

    def load_tensors(self, tensors: Mapping[str, np.ndarray]) -> None:
        """The inverse of `tensors`."""
        self.load_state_dict({name: torch.from_numpy(np.array(value)) for name, value in tensors.items()})


@dataclass(frozen=True)
class Blueprint:
    """What a tracker's networks are built by, however many numbers they give."""

    config: NetworkConfig
    width: int
    """Numbers in one frame of the observation."""
    frames: int = 1
    """Frames that are seen at once: the present one and those before it."""

    @property
    def inputs(self) -> int:
        """Numbers that a network takes."""
        return self.width * self.frames

    def layers(self, outputs: int) -> nn.Module:
        """New layers that give so many numbers."""
        return self.config.build(self.width, self.frames, outputs)

    def network(self, outputs: int) -> TrackerNetwork:
        """A new network that gives so many numbers."""
        return TrackerNetwork(self.layers(outputs), self.inputs, self.config.normalizes)
