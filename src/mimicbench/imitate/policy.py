"""Learners in their closed loop: what they look at, when they look again, and what they do."""

import torch
from torch import Tensor

from mimicbench.core.errors import MimicbenchError
from mimicbench.imitate.inputs import Learner
from mimicbench.imitate.perception import Perception, SeatMemory
from mimicbench.sensors.observations import Observations

BODY = ("proprio", "time", "odometry")
"""What every policy with a memory observes beside maps."""
LOOK_EVERY = 1.0
"""[s] between the looks of a robot that is not sure yet where the seat is."""


def look_first(memory: SeatMemory, ids: Tensor, obs: Observations) -> None:
    """Robots `ids` (M,) begin anew and remember the seat as they see it now."""
    memory.forget(ids)
    _look(memory, ids, obs)


def _look(memory: SeatMemory, ids: Tensor, obs: Observations) -> None:
    """Robots `ids` (M,) look at the map of this frame."""
    odometry = obs["odometry"][ids]
    memory.look(ids, obs.of("elevation", ids), obs["proprio"][ids, 3], odometry[:, :2], odometry[:, 2])


def look_again(memory: SeatMemory, obs: Observations) -> None:
    """Robots that are not sure look again, at every whole multiple of LOOK_EVERY since their start."""
    time, odometry = obs["time"][:, 0], obs["odometry"]
    looks = time / LOOK_EVERY
    due = (time > 0) & ((looks - looks.round()).abs() * LOOK_EVERY < 1e-3)
    if not due.any():
        return
    ids = memory.doubtful(odometry[:, :2], odometry[:, 2])
    ids = ids[due[ids]]
    if len(ids):
        _look(memory, ids, obs)


def recall(memory: SeatMemory, obs: Observations) -> Tensor:
    """(N, M) what robots remember by now."""
    odometry = obs["odometry"]
    return memory.recall(odometry[:, :2], odometry[:, 2])


class VisionPolicy:
    """A learner in its closed loop: sees, remembers the seat if it was taught to, and takes the first predicted
    action, every frame.
    """

    def __init__(self, learner: Learner, perception: Perception | None = None, gains: str = "improved") -> None:
        """`gains` are those of the tracker whose demonstrations it cloned."""
        self.gains = gains
        if learner.inputs.memory and perception is None:
            raise MimicbenchError(
                "this policy remembers the seat that it saw at the start; give it a perception checkpoint too"
            )
        self.learner = learner.eval()
        inputs = learner.inputs
        self.observations: tuple[str, ...] = (
            *(("state",) if inputs.body == "state" else ()),
            *BODY,
            *(("heightmap",) if inputs.elevation else ()),
            *(("elevation",) if inputs.memory else ()),
        )
        self._memory = None if perception is None or not learner.inputs.memory else SeatMemory(perception, 0)

    def to(self, device: str) -> None:
        """Move the networks to a device."""
        self.learner.to(device)
        if self._memory is not None:
            self._memory = SeatMemory(self._memory.perception.to(device), 0)

    @torch.no_grad()
    def reset(self, ids: Tensor, obs: Observations) -> None:
        """Look and remember the seat."""
        if self._memory is None:
            return
        if len(self._memory.doubt) != obs.num_envs:
            self._memory = SeatMemory(self._memory.perception, obs.num_envs, obs["time"].device)
        look_first(self._memory, ids, obs)

    @torch.no_grad()
    def act(self, obs: Observations) -> Tensor:
        """Joint position targets (N, 19) [rad]."""
        memory = None
        if self._memory is not None:
            look_again(self._memory, obs)
            memory = recall(self._memory, obs)
        inputs = self.learner.inputs
        state = obs["state"] if inputs.body == "state" else obs["proprio"]
        vector = inputs.vector(state, obs["proprio"], obs["time"][:, 0], memory)
        return self.learner.predict(vector, obs["heightmap"][:, None] if inputs.elevation else None)
