"""A planner that practises: learned from people by DAgger first, then reinforced by what its own attempts come to.

Who has only been shown how it is done never learns what a mistake of his own leads to. So the planner goes on by PPO
(imitate.exploring): it tries the task beside objects of the training split, is rewarded for what K still lacks, and
pays for power, and for straying from what it did before, as language models do for straying from what they had read
(the divergence of two normal distributions of one deviation is the squared difference of their means). What it was
shown is how people do it; what it is rewarded for is to get it done, and to stay.

Planner and tracker are one network here, from what is sensed to joint targets, of which the tracker's part does not
learn. It tries targets around those that it would choose.
"""

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor, nn

from mimicbench.core.checkpoint import beside
from mimicbench.imitate.exploring.episodes import ExploreConfig
from mimicbench.imitate.exploring.practice import Practice, course_of, practise
from mimicbench.imitate.goals import KnownGoal, known_goal
from mimicbench.imitate.learners.planner import PlannerImitation
from mimicbench.imitate.learners.planner import learn as learn_planner
from mimicbench.imitate.plan import PlanLayout
from mimicbench.imitate.planner import PlannerNetwork, own_terms, planner_inputs, read_planner, save_planner
from mimicbench.imitate.policy import BODY
from mimicbench.imitate.spec import Given, LearnerSpec
from mimicbench.robots.description import Robot
from mimicbench.sensors.observations import Observations
from mimicbench.sim.rows import Rows
from mimicbench.tasks.task import Task
from mimicbench.track.checkpoint import load_tracker
from mimicbench.track.history import Follower
from mimicbench.track.network import Blueprint, MLPConfig
from mimicbench.track.ppo_config import PPOConfig
from mimicbench.track.spec import Tracker, flat, sizes

SHOWN = "shown"
"""The folder of the planner that was learned from people, beside that of what it became."""


def _ppo() -> PPOConfig:
    return PPOConfig(steps=24, epochs=3, gamma=0.99, entropy=0.0, learning_rate=1e-4, initial_std=0.15)


@dataclass(frozen=True)
class ReinforcedImitation(Practice, PlannerImitation):
    """A planner by DAgger, and practice."""

    learner: str = "reinforced"
    ppo: PPOConfig = field(default_factory=_ppo)
    """The reinforcement learning; its layers are the critic's."""
    explore: ExploreConfig = field(default_factory=lambda: ExploreConfig(num_envs=512, power=0.1, stray=0.01))


class PlannedTargets(nn.Module):
    """What a planner and its tracker see -> joint targets, as differences from the joints, in units of `scale`."""

    def __init__(self, robot: Robot, task: Task, planner: PlannerNetwork, tracker: Tracker) -> None:
        super().__init__()
        self.planner, self.follows = planner, tracker.network.requires_grad_(False)
        self.task, self._robot, self._tracker = task, robot, tracker
        self._layout = PlanLayout(tracker.spec, robot, task)
        own = (name for name in own_terms(tracker.spec, task) if name != "proprio")
        self.own = ("last_action", *own)
        past = (tracker.layout.frames - 1) * tracker.layout.size
        self._own_widths = sizes(self.own, robot, task)
        self._widths = [planner.sizes.inputs, *self._own_widths, past]
        self.inputs = sum(self._widths)
        scale = torch.tensor(robot.gains[tracker.spec.gains].action_scale, dtype=torch.float32)
        self.register_buffer("scale", scale, persistent=False)
        self.scale: Tensor

    def forward(self, seen: Tensor) -> Tensor:
        """(N, J) of (N, inputs)."""
        action, terms = self.action(seen)
        target = self._tracker.target(self._robot, terms, action)
        joints = len(self._robot.joints)
        return (target - terms["proprio"][:, -2 * joints : -joints]) / self.scale

    def action(self, seen: Tensor) -> tuple[Tensor, dict[str, Tensor]]:
        """(N, J) the tracker's action, and all that it was told."""
        inputs, *own, past = seen.split(self._widths, -1)
        plan = self._layout.split(self.planner.plan(inputs))
        body = {"proprio": inputs[:, : self.planner.sizes.body]}
        terms = {**dict(zip(self.own, own, strict=True)), **body, **plan}
        return self._tracker.action(terms, past), terms


@dataclass(frozen=True)
class _Known:
    """Layers of an actor that knows already what to do."""

    network: PlannedTargets

    normalizes: ClassVar[bool] = False
    widens: ClassVar[bool] = False

    @property
    def repeats(self) -> tuple[int, ...]:
        """Nothing is."""
        return ()

    def build(self, width: int, frames: int, outputs: int) -> nn.Module:
        """The layers themselves: what robots remember of their last action follows what is learned."""
        return self.network


class PlannerSenses:
    """What N robots with planners see, and carry from frame to frame (episodes.Sensing)."""

    def __init__(self, network: PlannedTargets, tracker: Tracker, goal: KnownGoal) -> None:
        self._network, self._tracker, self._goal = network, tracker, goal
        self.observations: tuple[str, ...] = tuple(
            dict.fromkeys((*BODY, *goal.observations, *own_terms(tracker.spec, network.task)))
        )
        self._start(0, "cpu")

    def _start(self, robots: int, device: str | torch.device) -> None:
        self._action = torch.zeros(robots, len(self._network.scale), device=device)
        self._style = torch.zeros(robots, self._network.planner.sizes.style, device=device)
        self._history = Follower(self._tracker, robots, device).history

    def to(self, device: str) -> None:
        """Move the networks to a device; nothing is remembered."""
        self._network.to(device)
        self._goal.to(device)
        self._start(0, device)

    def begin(self, ids: Tensor, obs: Observations) -> None:
        """Robots `ids` (M,) find out about the goal, and settle how to go about it."""
        if len(self._action) != obs.num_envs:
            self._start(obs.num_envs, obs["time"].device)
        self._goal.begin(ids, obs)
        self._action = self._action.index_fill(0, ids, 0.0)
        self._history.begin(Rows.of(ids, obs.num_envs, obs["time"].device))
        with torch.no_grad():
            self._style = self._style.index_copy(0, ids, self._network.planner.choose(self._goal.goal[ids]))

    @torch.no_grad()
    def see(self, obs: Observations) -> tuple[Tensor, None]:
        """What planner and tracker see (N, inputs), after which the tracker's action is the last one."""
        inputs = planner_inputs(obs["proprio"], obs["time"][:, 0], self._goal.recall(obs), self._style)
        own = {"last_action": self._action, **{name: obs[name] for name in self._network.own[1:]}}
        seen = torch.cat([inputs, flat(own, self._network.own), self._history.past], -1)
        self._action, terms = self._network.action(seen)
        self._history.add(self._tracker.layout.flat(terms))
        return seen, None

    def memory(self) -> dict[str, Tensor]:
        """(N, ...) what is carried from frame to frame, by name."""
        carried = {"action": self._action, "style": self._style, **self._history.state_tensors()}
        return {**carried, **{f"goal.{name}": value for name, value in self._goal.memory().items()}}

    def remember(self, memory: Mapping[str, Tensor]) -> None:
        """Go on from what `memory` gave."""
        self._action, self._style = memory["action"], memory["style"]
        self._history.load_state_tensors(dict(memory))
        self._goal.remember({n.removeprefix("goal."): v for n, v in memory.items() if n.startswith("goal.")})


class Planner:
    """A planner and its tracker, to practise (practice.Student)."""

    def __init__(
        self, robot: Robot, network: PlannedTargets, senses: PlannerSenses, config: ReinforcedImitation
    ) -> None:
        self.senses, self._robot, self._network, self._config = senses, robot, network, config
        self.blueprint: Blueprint = Blueprint(_Known(network), network.inputs)
        self.critic: Blueprint = Blueprint(MLPConfig(config.ppo.hidden), network.inputs)
        self.action_size = len(robot.joints)

    def flat(self, vector: Tensor, maps: Tensor | None) -> Tensor:
        """(N, inputs) as it is."""
        return vector

    def targets(self, action: Tensor, joint_pos: Tensor) -> Tensor:
        """(N, J) joint targets [rad] of actions (N, J)."""
        return joint_pos + self._network.scale * action

    def shown(self) -> nn.Module:
        """What it does before it practises."""
        return copy.deepcopy(self._network).requires_grad_(False)

    def save(self, folder: Path, tensors: Mapping[str, np.ndarray], notes: Mapping[str, Any]) -> None:
        """Write the planner, whose tracker is as it was."""
        planner = copy.deepcopy(self._network.planner)
        name = "layers.planner."
        own = {n.removeprefix(name): torch.from_numpy(np.array(v)) for n, v in tensors.items() if n.startswith(name)}
        planner.load_state_dict(own)
        save_planner(folder, self._robot, planner, self._config.planner, notes)


def learn(folder: Path, given: Given, config: ReinforcedImitation) -> dict[str, Any]:
    """Learn into a folder, or go on learning there, to the same bytes."""
    robot, task = given.clips.robot, given.clips.task
    shown = beside(folder, SHOWN)
    told = learn_planner(shown, given, config)
    tracker = load_tracker(beside(folder, "tracker"), robot)
    network = PlannedTargets(robot, task, read_planner(shown, robot, task, tracker.spec), tracker)
    senses = PlannerSenses(network, tracker, known_goal(beside(folder, "perception"), robot, task))
    return {**told, **practise(folder, given, config, Planner(robot, network, senses, config), course_of(config))}


LEARNER = LearnerSpec("reinforced", ReinforcedImitation, learn)
