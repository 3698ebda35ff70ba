"""Learners in their closed loop."""

import torch
from torch import Tensor

from mimicbench.core.errors import MimicbenchError
from mimicbench.imitate.goals import KnownGoal
from mimicbench.imitate.inputs import Learner
from mimicbench.sensors.observations import Observations

BODY = ("proprio", "time", "odometry")
"""What every policy observes beside maps and goals."""


class VisionPolicy:
    """A learner in its closed loop: sees, knows its goal if it was taught to, and takes the first predicted action,
    every frame.
    """

    def __init__(self, learner: Learner, goal: KnownGoal | None = None, gains: str = "improved") -> None:
        """`gains` are those of the tracker whose demonstrations it cloned."""
        self.gains = gains
        if learner.inputs.memory and goal is None:
            raise MimicbenchError("this policy remembers its goal; give it what it knows of that, too")
        self.learner = learner.eval()
        self._goal = goal if learner.inputs.memory else None
        inputs = learner.inputs
        self._maps = (
            *(("heightmap",) if inputs.elevation else ()),
            *(("target_elevation",) if inputs.targets else ()),
        )
        wanted = (
            *(("state",) if inputs.body == "state" else ()),
            *BODY,
            *self._maps,
            *(self._goal.observations if self._goal else ()),
        )
        self.observations: tuple[str, ...] = tuple(dict.fromkeys(wanted))

    def to(self, device: str) -> None:
        """Move the networks to a device."""
        self.learner.to(device)
        if self._goal is not None:
            self._goal.to(device)

    @torch.no_grad()
    def reset(self, ids: Tensor, obs: Observations) -> None:
        """Find out about the goal, and remember it."""
        if self._goal is not None:
            self._goal.begin(ids, obs)

    @torch.no_grad()
    def act(self, obs: Observations) -> Tensor:
        """Joint position targets (N, J) [rad]."""
        inputs = self.learner.inputs
        memory = None if self._goal is None else self._goal.recall(obs)
        state = obs["state"] if inputs.body == "state" else obs["proprio"]
        vector = inputs.vector(state, obs["proprio"], obs["time"][:, 0], memory)
        maps = torch.stack([obs[name] for name in self._maps], 1) if self._maps else None
        return self.learner.predict(vector, maps)
