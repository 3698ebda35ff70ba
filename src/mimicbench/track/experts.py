"""Who says what N robots should do, frame by frame: a tracker on its clips, or a policy by what it senses.

A tracker is told by its clip what comes next, and nobody who learns from it is. A policy is told nothing that its
learner could not see as well. Either goes on from what it did last. Where somebody else drives it has to go on from
what was done, or it answers what nobody has seen: its own past, which never was.
"""

import copy
from typing import Protocol, runtime_checkable

import torch
from torch import Tensor

from mimicbench.envs.policy import Policy
from mimicbench.envs.vec_env import VecEnv
from mimicbench.robots.description import Robot
from mimicbench.sensors.observations import Observations, Term
from mimicbench.track.history import Follower
from mimicbench.track.settings import EndConfig
from mimicbench.track.tracker import Tracker
from mimicbench.track.tracking import deviations


class Expert(Protocol):
    """Says what all robots of an environment should do, whoever drives them."""

    gains: str
    """Which of the robot's gains its targets are meant for."""
    observations: tuple[str | Term, ...]
    """What it observes."""
    late: float
    """[s] that it has known nothing any more before it is found to be lost."""
    follows: bool
    """Whether it follows the clips."""

    def begin(self, env: VecEnv) -> None:
        """All episodes of an environment begin. Its networks move to where the environment's tensors live."""
        ...

    def says(self, env: VecEnv, obs: Observations) -> tuple[Tensor, Tensor]:
        """Joint targets (N, J) [rad] of the present frame, and the actions (N, J) that they were made of."""
        ...

    def drove(self, env: VecEnv, target: Tensor) -> Tensor:
        """Joint targets (N, J) are given in this frame, by somebody else perhaps, and it goes on from there. Returns
        the actions (N, J) that they are made of.
        """
        ...

    def lost(self, env: VecEnv, ends: EndConfig) -> Tensor:
        """(N,) whether it no longer knows what to do."""
        ...


@runtime_checkable
class Corrigible(Protocol):
    """A policy that remembers what it did, and can be told that something else was done."""

    def drove(self, target: Tensor) -> None:
        """Joint targets (N, J) were given instead of what `act` said last."""
        ...


class ClipExpert:
    """A tracker by its mean action, each robot on its clip."""

    late = 0.0
    follows = True

    def __init__(self, tracker: Tracker, robot: Robot) -> None:
        self._tracker, self._robot = tracker, robot
        self.gains = tracker.spec.gains
        self.observations = tracker.spec.observations

    def begin(self, env: VecEnv) -> None:
        """All robots begin an episode."""
        self._tracker.network.to(env.device)
        self._follower = Follower(self._tracker, env.num_envs, env.device)

    def says(self, env: VecEnv, obs: Observations) -> tuple[Tensor, Tensor]:
        """Targets of its action and the one before it, which are those of the environment."""
        action = self._follower.action(obs)
        following, last = env.context.reference(1).joint_pos, env.context.last_action
        return self._tracker.spec.aim(self._robot, following, action, last, self._tracker.settings), action

    def drove(self, env: VecEnv, target: Tensor) -> Tensor:
        """The actions that these targets would have come from; the environment keeps them."""
        following, last = env.context.reference(1).joint_pos, env.context.last_action
        return self._tracker.spec.aimed(self._robot, following, target, last, self._tracker.settings)

    def lost(self, env: VecEnv, ends: EndConfig) -> Tensor:
        """Who has strayed from its clip."""
        return torch.stack(deviations(env.context, ends)).any(0)


class SensingExpert:
    """A policy, which follows no clip."""

    late = 0.8
    """A fall takes that long."""
    follows = False

    def __init__(self, policy: Policy) -> None:
        self._fresh = self._policy = policy
        self.gains = policy.gains
        self.observations: tuple[str | Term, ...] = policy.observations

    def begin(self, env: VecEnv) -> None:
        """It gets to know its goals in the first frame; of episodes before it knows nothing, not even how many there
        were, for who goes on after a kill has not seen them.
        """
        self._policy = copy.deepcopy(self._fresh)
        self._policy.to(str(env.device))
        self._policy.reset(torch.arange(env.num_envs, device=env.device), env.observe(self._policy.observations))

    def says(self, env: VecEnv, obs: Observations) -> tuple[Tensor, Tensor]:
        """Its targets, which are all that it says."""
        target = self._policy.act(obs)
        return target, target

    def drove(self, env: VecEnv, target: Tensor) -> Tensor:
        """Tells the policy, if that remembers."""
        if isinstance(self._policy, Corrigible):
            self._policy.drove(target)
        return target

    def lost(self, env: VecEnv, ends: EndConfig) -> Tensor:
        """Who has fallen: there is no clip to stray from."""
        assert env.metrics is not None
        return env.metrics.fell
