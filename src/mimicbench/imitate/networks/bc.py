"""Behavior cloning with a convolutional network and a multilayer perceptron, the baseline CNNMLP of the ACT repository.

Features of the map pass three 5 x 5 convolutions without activation, are laid out beside the state, and an MLP of two
hidden layers gives the action; the loss is the mean squared error. The original's convolutions have no padding, which
needs a photograph's size; here they keep the 4 x 4 grid of a 128 x 128 map.
"""

from dataclasses import replace

import torch
from torch import Tensor, nn
from torch.nn import functional

from mimicbench.imitate.encoder import Encoder
from mimicbench.imitate.inputs import Batch, Learner
from mimicbench.imitate.learners.bc import BCConfig


class BC(Learner):
    """Map and state -> the action of the present frame."""

    kind = "bc"

    def __init__(self, config: BCConfig) -> None:
        super().__init__(config.inputs, (*([1] if config.relative else []), config.action_size))
        self.config = config
        size = config.inputs.seen_size
        if config.inputs.sees:
            self.map_encoder = Encoder(replace(config.encoder, channels=config.inputs.seen_channels))
            widths = (config.encoder.widths[-1], *config.reduce)
            self.reduce = nn.Sequential(
                *(nn.Conv2d(a, b, 5, padding=2) for a, b in zip(widths[:-1], widths[1:], strict=True))
            )
            size += config.reduce[-1] * config.encoder.side**2
            if config.goal_weight:
                self.finds = self.goal_head(config.encoder.widths[-1] * config.encoder.side**2)
        self.mlp = nn.Sequential(
            nn.Linear(size, config.hidden),
            nn.ReLU(),
            nn.Linear(config.hidden, config.hidden),
            nn.ReLU(),
            nn.Linear(config.hidden, config.action_size),
        )

    def loss(self, batch: Batch, generator: torch.Generator | None = None) -> dict[str, Tensor]:
        """Mean squared error of the normalized action."""
        features = self.features(batch.picture)
        said = self._forward(batch.vector, features)
        mse = functional.mse_loss(said, self.normalized_actions(batch.actions[:, 0]))
        return self.with_goal({"loss": mse}, features, batch)

    def plan(self, vector: Tensor, picture: Tensor | None) -> Tensor:
        """The action (N, 1, A) [rad]."""
        said = self._forward(vector, self.features(picture))
        return (said * self.action_std + self.action_mean)[:, None]

    def _forward(self, vector: Tensor, features: Tensor | None) -> Tensor:
        x = self.normalized_input(vector)
        return self.mlp(x if features is None else torch.cat([self.reduce(features).flatten(1), x], -1))
