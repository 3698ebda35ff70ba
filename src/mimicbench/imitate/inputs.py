"""What networks of learners have in common: vectors and maps in, a chunk of actions out, both normalized inside."""

from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from torch import Tensor, nn
from torch.nn import functional

from mimicbench.imitate.settings.inputs import InputConfig


@dataclass(frozen=True)
class Batch:
    """Frames of demonstrations to learn from."""

    vector: Tensor
    """(B, size) input vectors; (B, history, size) where more than one frame is seen."""
    picture: Tensor | None
    """(B, channels, 128, 128) what is seen in the same frames, maps [m] or color and depth, or (B, history, ...); None
    if the learner sees none."""
    actions: Tensor
    """(B, chunk, A) joint position targets of the window's frames [rad], or what else is learned."""
    pad: Tensor
    """(B, chunk) true after the end of the episode."""
    goal: Tensor | None = None
    """(B, G) where the goal is in the present frame, in the units of GoalSpec.middle_and_spread, for who finds it."""
    ahead: Tensor | None = None
    """(B, channels, 128, 128) what is seen in the frame after the chunk, or (B, history, ...), for who looks ahead."""


class Learner(nn.Module):
    """A network that learns from demonstrations.

    Inputs and actions are normalized inside, by statistics that are part of it.
    """

    kind: ClassVar[str]
    """What its checkpoints are called."""
    config: Any
    """What it was built from."""
    executes: int = 1
    """Frames for which one prediction is carried out before the next one."""
    ensembles: bool = False
    """Whether what is carried out is a mean of all predictions of a frame (policy.Ensemble)."""

    def __init__(self, inputs: InputConfig, action_shape: tuple[int, ...]) -> None:
        """`action_shape` is that of the statistics: (A,), or (chunk, A) where frames of a chunk differ."""
        super().__init__()
        self.inputs = inputs
        self.input_mean: Tensor
        self.input_std: Tensor
        self.action_mean: Tensor
        self.action_std: Tensor
        for name, shape in (("input", (inputs.size,)), ("action", action_shape)):
            self.register_buffer(f"{name}_mean", torch.zeros(shape))
            self.register_buffer(f"{name}_std", torch.ones(shape))

    def normalize_by(self, vector: Tensor, actions: Tensor, ends: Tensor) -> None:
        """Take mean and deviation (at least 1e-2) from samples of input vectors (M, size) and actions (M, *shape).

        `ends` (2, *shape) are the lowest and the highest action of all, for those who scale by them.
        """
        for name, values in (("input", vector), ("action", actions)):
            getattr(self, f"{name}_mean").copy_(values.mean(0))
            getattr(self, f"{name}_std").copy_(values.std(0).clamp(min=1e-2))

    def normalized_input(self, vector: Tensor) -> Tensor:
        """(N, history * size) input vectors (N, [history,] size), side by side, with mean 0 and deviation 1, limited to
        10 deviations.
        """
        return ((vector - self.input_mean) / self.input_std).clamp(-10, 10).flatten(1)

    def normalized_actions(self, actions: Tensor) -> Tensor:
        """Actions (..., *shape) with mean 0 and deviation 1."""
        return (actions - self.action_mean) / self.action_std

    def normalized_map(self, picture: Tensor) -> Tensor:
        """(N, history * channels, 128, 128) what is seen (N, [history,] channels, ...), maps with the floor near 0, as
        padding of the convolutions; color and depth as they are, from 0 to 1.
        """
        return picture.flatten(1, -3) + (0.0 if self.inputs.views else 1.0)

    def goal_head(self, features: int) -> nn.Module:
        """What says from so many features of a map where the goal is."""
        return nn.Sequential(nn.Linear(features, 128), nn.ReLU(), nn.Linear(128, self.config.goal_size))

    def features(self, picture: Tensor | None) -> Tensor | None:
        """(N, width, side, side) what its `map_encoder` makes of what is seen; None for who sees nothing."""
        if not self.inputs.sees:
            return None
        if picture is None:
            raise ValueError("this learner sees pictures; give it one")
        return self.map_encoder(self.normalized_map(picture))

    def with_goal(self, parts: dict[str, Tensor], features: Tensor | None, batch: Batch) -> dict[str, Tensor]:
        """Parts of a loss, and the error of where its head `finds` the goal by such features, if it has to say that."""
        if features is None or batch.goal is None:
            return parts
        goal = functional.smooth_l1_loss(self.finds(features.flatten(1)).float(), batch.goal)
        return {**parts, "loss": parts["loss"] + self.config.goal_weight * goal, "goal": goal}

    def loss(self, batch: Batch, generator: torch.Generator | None = None) -> dict[str, Tensor]:
        """The parts of the loss by name; `loss` is what to minimize."""
        raise NotImplementedError

    def predict(self, vector: Tensor, picture: Tensor | None) -> Tensor:
        """The action (N, A) [rad] for the present frame, without randomness."""
        return self.plan(vector, picture)[:, 0]

    def plan(self, vector: Tensor, picture: Tensor | None) -> Tensor:
        """(N, K, A) the actions of the present frame and of those after it, without randomness; K >= `executes`."""
        raise NotImplementedError
