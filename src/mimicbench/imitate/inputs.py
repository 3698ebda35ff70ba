"""What learners see and give, the same for all of them: a vector, a map, and a chunk of actions."""

from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

import torch
from torch import Tensor, nn

from mimicbench.imitate.clock import SIZE as CLOCK_SIZE
from mimicbench.imitate.clock import clock_features
from mimicbench.tasks.task import Task

STATE_SIZE = 300
"""S_current of the paper: joint angles 19, joint velocities 19, links' positions 60, orientations 60, velocities 60 and
angular velocities 60 in the root frame, last action 19, gravity 3, in this order."""
LAST_ACTION = slice(278, 297)
"""Where the last action is in S_current."""
PROPRIO_SIZE = 48
"""Gravity 3, root height 1, root velocity 3 and angular velocity 3 in the root frame, joint angles 19 and velocities
19."""


@dataclass(frozen=True)
class InputConfig:
    """Which of the senses a learner gets. The defaults are the paper's."""

    body: Literal["state", "proprio"] = "state"
    """`state`: S_current, 300 numbers; `proprio`: the 48 numbers that a robot can measure of itself."""
    clock: bool = False
    """Add the time since the start. The last action is then left out: copying one's own past is what fails without
    it."""
    memory: bool = False
    """Add the goal as it was known first, carried along by odometry, or told."""
    memory_size: int = 0
    """Numbers in that memory. The task decides."""
    elevation: bool = True
    """Show the elevation map of the present frame."""
    targets: bool = False
    """Beside it show a map of what the robot is told. The task decides."""

    @staticmethod
    def timed() -> "InputConfig":
        """The paper's inputs with a clock and a memory of the start."""
        return InputConfig(body="proprio", clock=True, memory=True)

    def of(self, task: Task) -> "InputConfig":
        """The same for a task."""
        memory_size = task.goal.memory_size if self.memory else 0
        return replace(self, memory_size=memory_size, targets=self.elevation and task.goal.given)

    @property
    def channels(self) -> int:
        """Of the maps."""
        return 2 if self.targets else 1

    @property
    def size(self) -> int:
        """Length of the input vector."""
        body = PROPRIO_SIZE
        if self.body == "state":
            body = STATE_SIZE - (LAST_ACTION.stop - LAST_ACTION.start if self.clock else 0)
        return body + (CLOCK_SIZE if self.clock else 0) + (self.memory_size if self.memory else 0)

    def vector(self, state: Tensor, proprio: Tensor, time: Tensor, memory: Tensor | None) -> Tensor:
        """The input vector (N, size).

        Args:
            state: (N, 300) S_current.
            proprio: (N, 48).
            time: (N,) since the start [s].
            memory: (N, memory_size) of goals.KnownGoal; needed if `memory` is on.
        """
        if self.body == "proprio":
            parts = [proprio]
        elif self.clock:
            parts = [state[:, : LAST_ACTION.start], state[:, LAST_ACTION.stop :]]
        else:
            parts = [state]
        if self.clock:
            parts.append(clock_features(time))
        if self.memory:
            if memory is None:
                raise ValueError("this learner has a memory of the start; give it one")
            parts.append(memory)
        return torch.cat(parts, -1)


@dataclass(frozen=True)
class Batch:
    """Frames of demonstrations to learn from."""

    vector: Tensor
    """(B, size) input vectors."""
    elevation: Tensor | None
    """(B, channels, 128, 128) maps of the same frames [m], or None if the learner sees none."""
    actions: Tensor
    """(B, chunk, A) joint position targets of this frame and the next ones [rad]."""
    pad: Tensor
    """(B, chunk) true after the end of the episode."""


class Learner(nn.Module):
    """A network that learns from demonstrations.

    Inputs and actions are normalized inside, by statistics that are part of it.
    """

    kind: ClassVar[str]
    """What its checkpoints are called."""
    config: Any
    """What it was built from."""

    def __init__(self, inputs: InputConfig, chunk: int, action_size: int) -> None:
        super().__init__()
        self.inputs = inputs
        self.chunk = chunk
        self.input_mean: Tensor
        self.input_std: Tensor
        self.action_mean: Tensor
        self.action_std: Tensor
        for name, size in (("input", inputs.size), ("action", action_size)):
            self.register_buffer(f"{name}_mean", torch.zeros(size))
            self.register_buffer(f"{name}_std", torch.ones(size))

    def normalize_by(self, vector: Tensor, actions: Tensor) -> None:
        """Take mean and deviation (at least 1e-2) from samples of input vectors (M, size) and actions (M, A)."""
        for name, values in (("input", vector), ("action", actions)):
            getattr(self, f"{name}_mean").copy_(values.mean(0))
            getattr(self, f"{name}_std").copy_(values.std(0).clamp(min=1e-2))

    def normalized_input(self, vector: Tensor) -> Tensor:
        """Input vectors (N, size) with mean 0 and deviation 1, limited to 10 deviations."""
        return ((vector - self.input_mean) / self.input_std).clamp(-10, 10)

    def normalized_actions(self, actions: Tensor) -> Tensor:
        """Actions (..., A) with mean 0 and deviation 1."""
        return (actions - self.action_mean) / self.action_std

    def normalized_map(self, elevation: Tensor) -> Tensor:
        """Maps with the floor near 0, as the padding of the convolutions."""
        return elevation + 1.0

    def loss(self, batch: Batch, generator: torch.Generator | None = None) -> dict[str, Tensor]:
        """The parts of the loss by name; `loss` is what to minimize."""
        raise NotImplementedError

    def predict(self, vector: Tensor, elevation: Tensor | None) -> Tensor:
        """The action (N, A) [rad] for the present frame, without randomness."""
        raise NotImplementedError
