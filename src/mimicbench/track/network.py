"""The tracker's network at inference: normalized observation through an MLP. Independent of what trained it."""

from collections.abc import Mapping

import numpy as np
import torch
from torch import nn


class TrackerNetwork(nn.Module):
    """mean action = MLP((obs - mean) / std), ELU between the layers."""

    def __init__(self, observations: int, actions: int, hidden: tuple[int, ...]) -> None:
        super().__init__()
        self.obs_mean: torch.Tensor
        self.obs_std: torch.Tensor
        self.register_buffer("obs_mean", torch.zeros(observations))
        self.register_buffer("obs_std", torch.ones(observations))
        layers: list[nn.Module] = []
        width = observations
        for size in hidden:
            layers += [nn.Linear(width, size), nn.ELU()]
            width = size
        self.layers = nn.Sequential(*layers, nn.Linear(width, actions))

    def forward(self, obs: torch.Tensor) -> torch.Tensor:
        """(N, actions) from (N, observations)."""
        return self.layers((obs - self.obs_mean) / (self.obs_std + 1e-2))

    @staticmethod
    def shapes(observations: int, actions: int, hidden: tuple[int, ...]) -> dict[str, tuple[int, ...]]:
        """Shapes of all tensors by name, known without making any of them."""
        found: dict[str, tuple[int, ...]] = {"obs_mean": (observations,), "obs_std": (observations,)}
        widths = (observations, *hidden, actions)
        for layer, (width, size) in enumerate(zip(widths[:-1], widths[1:], strict=True)):
            found |= {f"layers.{2 * layer}.weight": (size, width), f"layers.{2 * layer}.bias": (size,)}
        return found

    def tensors(self) -> dict[str, np.ndarray]:
        """All weights and statistics by name, for a checkpoint."""
        return {name: value.detach().cpu().numpy() for name, value in self.state_dict().items()}

    def load_tensors(self, tensors: Mapping[str, np.ndarray]) -> None:
        """The inverse of `tensors`."""
        self.load_state_dict({name: torch.from_numpy(np.array(value)) for name, value in tensors.items()})
