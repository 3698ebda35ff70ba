"""Policies as the evaluation runs them: many robots at once, from their senses alone."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol

import torch
from torch import Tensor

from mimicbench.core.errors import MimicbenchError
from mimicbench.imitate.inputs import Learner
from mimicbench.imitate.learners import load_learner
from mimicbench.imitate.perception import SEAT_SIZE, Perception, load_perception, seat_memory


@dataclass(frozen=True)
class Senses:
    """What N robots sense in one control frame. No pose, shape or height of any object is among it but through the map."""

    state: Tensor
    """(N, 300) S_current of the paper (see inputs.STATE_SIZE for its order)."""
    proprio: Tensor
    """(N, 48): gravity 3, root height 1, root linear velocity 3 and angular velocity 3 in the root frame, joint angles 19, velocities 19."""
    time: Tensor
    """(N,) since the robot's start [s]."""
    odometry_pos: Tensor
    """(N, 2) position relative to the start, in the heading frame of the start, by the robot's own reckoning [m]."""
    odometry_yaw: Tensor
    """(N,) heading relative to the start [rad]."""
    elevation: Callable[[], Tensor]
    """Makes the elevation maps (N, 128, 128) of this frame, relative to the root [m], row along +x, column along +y (sense.heightmap)."""

    @property
    def root_height(self) -> Tensor:
        """(N,) height of the root above the floor [m]."""
        return self.proprio[:, 3]


class Policy(Protocol):
    """Drives N robots. The same object serves them all; what it remembers of one is forgotten by `reset`."""

    gains: str
    """Which of the robot's gain presets its targets are meant for."""
    eyes: Literal["cameras", "rays"]
    """Which maker of elevation maps it looks through: `cameras` see what four cameras see, once at the start; `rays` are fast enough for every frame."""

    def reset(self, ids: Tensor, senses: Senses) -> None:
        """Robots `ids` (M,) begin anew; `senses` are those of all N robots in their first frame."""
        ...

    def act(self, senses: Senses) -> Tensor:
        """Joint position targets (N, 19) [rad] for all robots."""
        ...


class VisionPolicy:
    """A learner in its closed loop: sees, remembers the seat if it was taught to, and takes the first predicted action, every frame."""

    gains = "improved"  # those of the tracker whose demonstrations it cloned

    def __init__(self, learner: Learner, perception: Perception | None = None) -> None:
        if learner.inputs.memory and perception is None:
            raise MimicbenchError("this policy remembers the seat that it saw at the start; give it a perception checkpoint too")
        self.learner = learner.eval()
        self.perception = perception
        self.eyes: Literal["cameras", "rays"] = "rays" if learner.inputs.elevation else "cameras"
        self._seat = torch.zeros(0, SEAT_SIZE)

    @torch.no_grad()
    def reset(self, ids: Tensor, senses: Senses) -> None:
        """Look at the first map and remember the seat."""
        if self.perception is None or not self.learner.inputs.memory:
            return
        if len(self._seat) != len(senses.time):
            self._seat = torch.zeros(len(senses.time), SEAT_SIZE, device=senses.proprio.device)
        self._seat[ids] = self.perception.perceive(senses.elevation()[ids], senses.root_height[ids])

    @torch.no_grad()
    def act(self, senses: Senses) -> Tensor:
        """Joint position targets (N, 19) [rad]."""
        inputs = self.learner.inputs
        memory = seat_memory(self._seat, senses.odometry_pos, senses.odometry_yaw) if inputs.memory else None
        vector = inputs.vector(senses.state, senses.proprio, senses.time, memory)
        return self.learner.predict(vector, senses.elevation()[:, None] if inputs.elevation else None)


def load_policy(folder: Path, robot: str, perception: Path | None = None) -> VisionPolicy:
    """The policy of an ACT or BC checkpoint; `perception` is the folder of the seat's. Raises BadCheckpoint or UnknownName."""
    learner = load_learner(folder, robot)
    eyes = load_perception(perception, robot) if perception is not None and learner.inputs.memory else None
    return VisionPolicy(learner, eyes)
