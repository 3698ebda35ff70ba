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
from mimicbench.imitate.perception import Perception, SeatMemory, load_perception


@dataclass(frozen=True)
class Senses:
    """What N robots sense in one control frame.

    No pose, shape or height of any object is among it but through the map.
    """

    state: Tensor
    """(N, 300) S_current of the paper (see inputs.STATE_SIZE for its order)."""
    proprio: Tensor
    """(N, 48): gravity 3, root height 1, root linear velocity 3 and angular velocity 3 in the root frame, joint angles
    19, velocities 19."""
    time: Tensor
    """(N,) since the robot's start [s]."""
    odometry_pos: Tensor
    """(N, 2) position relative to the start, in the heading frame of the start, by the robot's own reckoning [m]."""
    odometry_yaw: Tensor
    """(N,) heading relative to the start [rad]."""
    elevation: Callable[[Tensor], Tensor]
    """Makes the elevation maps (M, 128, 128) of robots (M,) in this frame, relative to the root [m], row along +x,
    column along +y (sense.heightmap)."""

    @property
    def root_height(self) -> Tensor:
        """(N,) height of the root above the floor [m]."""
        return self.proprio[:, 3]


class Policy(Protocol):
    """Drives N robots. The same object serves them all; what it remembers of one is forgotten by `reset`."""

    gains: str
    """Which of the robot's gain presets its targets are meant for."""
    eyes: Literal["cameras", "rays"]
    """Which maker of elevation maps it looks through: `cameras` see what four cameras see, now and then; `rays` are
    fast enough for every frame."""

    def to(self, device: str) -> None:
        """Move its networks to where the tensors of `device` live, as torch calls it; senses will come from there."""
        ...

    def reset(self, ids: Tensor, senses: Senses) -> None:
        """Robots `ids` (M,) begin anew; `senses` are those of all N robots in their first frame."""
        ...

    def act(self, senses: Senses) -> Tensor:
        """Joint position targets (N, 19) [rad] for all robots."""
        ...


LOOK_EVERY = 1.0
"""[s] between the looks of a robot that is not sure yet where the seat is."""


def look_first(memory: SeatMemory, ids: Tensor, senses: Senses) -> None:
    """Robots `ids` (M,) begin anew and remember the seat as they see it now."""
    memory.forget(ids)
    memory.look(ids, senses.elevation(ids), senses.root_height[ids], senses.odometry_pos[ids], senses.odometry_yaw[ids])


def look_again(memory: SeatMemory, senses: Senses) -> None:
    """Robots that are not sure look again, at every whole multiple of LOOK_EVERY since their start."""
    looks = senses.time / LOOK_EVERY
    due = (senses.time > 0) & ((looks - looks.round()).abs() * LOOK_EVERY < 1e-3)
    if not due.any():
        return
    ids = memory.doubtful(senses.odometry_pos, senses.odometry_yaw)
    ids = ids[due[ids]]
    if len(ids):
        memory.look(
            ids, senses.elevation(ids), senses.root_height[ids], senses.odometry_pos[ids], senses.odometry_yaw[ids]
        )


class VisionPolicy:
    """A learner in its closed loop: sees, remembers the seat if it was taught to, and takes the first predicted
    action, every frame.
    """

    gains = "improved"  # those of the tracker whose demonstrations it cloned

    def __init__(self, learner: Learner, perception: Perception | None = None) -> None:
        if learner.inputs.memory and perception is None:
            raise MimicbenchError(
                "this policy remembers the seat that it saw at the start; give it a perception checkpoint too"
            )
        self.learner = learner.eval()
        self.eyes: Literal["cameras", "rays"] = "rays" if learner.inputs.elevation else "cameras"
        self._memory = None if perception is None or not learner.inputs.memory else SeatMemory(perception, 0)

    def to(self, device: str) -> None:
        """Move the networks to a device."""
        self.learner.to(device)
        if self._memory is not None:
            self._memory = SeatMemory(self._memory.perception.to(device), 0)

    @torch.no_grad()
    def reset(self, ids: Tensor, senses: Senses) -> None:
        """Look and remember the seat."""
        if self._memory is None:
            return
        if len(self._memory.doubt) != len(senses.time):
            self._memory = SeatMemory(self._memory.perception, len(senses.time), senses.time.device)
        look_first(self._memory, ids, senses)

    @torch.no_grad()
    def act(self, senses: Senses) -> Tensor:
        """Joint position targets (N, 19) [rad]."""
        memory = None
        if self._memory is not None:
            look_again(self._memory, senses)
            memory = self._memory.recall(senses.odometry_pos, senses.odometry_yaw)
        inputs = self.learner.inputs
        vector = inputs.vector(senses.state, senses.proprio, senses.time, memory)
        everyone = torch.arange(len(senses.time), device=senses.time.device)
        return self.learner.predict(vector, senses.elevation(everyone)[:, None] if inputs.elevation else None)


def load_policy(folder: Path, robot: str, perception: Path | None = None) -> VisionPolicy:
    """The policy of an ACT or BC checkpoint; `perception` is the folder of the seat's.

    Raises BadCheckpoint or UnknownName.
    """
    learner = load_learner(folder, robot)
    eyes = load_perception(perception, robot) if perception is not None and learner.inputs.memory else None
    return VisionPolicy(learner, eyes)
