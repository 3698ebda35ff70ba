"""A planner over the tracker, learned by DAgger: HIT's two stages in closed loop.

The planner sees the robot's own body, a clock, and its goal: found in an elevation map and carried along by odometry,
or told. It says what the tracker needs to be told: its reference one and five frames ahead and, where an object is
moved, where that is and is to be, all relative to the body. The tracker turns that into joint targets. While learning,
the label is the clip's own next frames at the same time index, seen from wherever the robot has got to, and the true
place of the object, which the planner has to tell by the body that holds it; who drives changes from the tracker on
true references to the planner itself.

What a clip chose beyond its start and its object is told by its style, such as which way it turns its back to it.
Two choices have no middle: a planner that has to guess them from where it stands wavers, and falls. So the style is an
input, and a small network, the chooser, settles it once, by what is known of the goal first.

One network may learn several tasks, and is told which: what is known of each task's goal has columns of its own among
its inputs, and each task has a number that is 1 where it is meant.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import torch
from torch import nn

from mimicbench.core.building import built
from mimicbench.core.checkpoint import CONFIG, BadCheckpoint, beside, checkpoint_tasks, load_checkpoint, save_checkpoint
from mimicbench.core.motion import RobotMotion
from mimicbench.imitate.goals import KnownGoal, known_goal
from mimicbench.imitate.learners.planner import PlannerConfig
from mimicbench.imitate.networks.planner import (
    PlannerNetwork,
    PlannerSizes,
    TaskColumns,
    columns_of,
    planner_inputs,
)
from mimicbench.imitate.plan import PlanLayout
from mimicbench.imitate.policy import BODY
from mimicbench.robots.description import Robot
from mimicbench.sensors.observations import Observations, chosen_terms
from mimicbench.sim.rows import Rows
from mimicbench.tasks.registry import TASKS
from mimicbench.tasks.task import Task
from mimicbench.track.checkpoint import load_tracker
from mimicbench.track.history import Follower
from mimicbench.track.spec import TrackerSpec
from mimicbench.track.tracker import Tracker


def styles_of(motions: Sequence[RobotMotion]) -> tuple[tuple[str, ...], torch.Tensor]:
    """Names of what all clips say of their style, sorted, and the values (C, S)."""
    names = sorted(set.intersection(*(set(motion.style) for motion in motions)))
    return tuple(names), torch.tensor(
        [[motion.style[name] for name in names] for motion in motions], dtype=torch.float32
    ).reshape(len(motions), len(names))


def own_terms(spec: TrackerSpec, task: Task) -> tuple[str, ...]:
    """Names of what a tracker observes that a robot senses itself, all but the last action, which is the tracker's."""
    names = (term.name for term in chosen_terms(spec.observations, task) if not term.privileged)
    return tuple(name for name in names if name != "last_action")


class PlannerPolicy:
    """The planner in closed loop: knows its goal, settles its style, plans every frame for the tracker."""

    def __init__(
        self,
        robot: Robot,
        task: Task,
        network: PlannerNetwork,
        tracker: Tracker,
        goal: KnownGoal,
        columns: TaskColumns,
    ) -> None:
        self._robot, self._network, self._tracker, self._goal = robot, network, tracker, goal
        self._columns = columns
        self._layout, self._own = PlanLayout(tracker.spec, robot, task), own_terms(tracker.spec, task)
        self.gains = tracker.spec.gains
        self.observations: tuple[str, ...] = tuple(dict.fromkeys((*BODY, *goal.observations, *self._own)))
        self._last_action, self._follower = torch.zeros(0, len(robot.joints)), Follower(tracker, 0)
        self._style = torch.zeros(0, network.sizes.style)
        self._before: Mapping[str, torch.Tensor] = {}

    def to(self, device: str) -> None:
        """Move the networks to a device."""
        self._network.to(device)
        self._tracker.network.to(device)
        self._goal.to(device)
        self._last_action, self._style = self._last_action[:0].to(device), self._style[:0].to(device)

    @torch.no_grad()
    def reset(self, ids: torch.Tensor, obs: Observations) -> None:
        """Find out about the goal, and settle how to go about it."""
        robots, device = obs.num_envs, obs["time"].device
        if len(self._last_action) != robots:
            self._last_action = torch.zeros(robots, len(self._robot.joints), device=device)
            self._style = torch.zeros(robots, self._network.sizes.style, device=device)
            self._follower = Follower(self._tracker, robots, device)
        self._goal.begin(ids, obs)
        self._last_action = self._last_action.index_fill(0, ids, 0.0)
        self._follower.history.begin(Rows.of(ids, robots, device))
        self._style = self._style.index_copy(0, ids, self._network.choose(self._goal.goal[ids]))

    def networks(self) -> list[nn.Module]:
        """All that it runs on."""
        return [self._network, self._tracker.network, *self._goal.networks()]

    def memory(self) -> dict[str, torch.Tensor]:
        """(N, ...) what is carried from frame to frame, by name."""
        before = {"last_action": self._last_action, "style": self._style}
        return {**before, **self._follower.history.state_tensors(), **self._goal.memory()}

    def remember(self, memory: Mapping[str, torch.Tensor]) -> None:
        """Go on from what `memory` gave."""
        self._last_action, self._style = memory["last_action"], memory["style"]
        self._follower.history.load_state_tensors(memory)
        self._goal.remember(memory)

    @torch.no_grad()
    def act(self, obs: Observations) -> torch.Tensor:
        """Joint position targets (N, J) [rad]."""
        memory = self._columns.told(self._goal.recall(obs))
        seconds = obs["time"][:, 0] if self._network.sizes.clock else None
        inputs = planner_inputs(obs["proprio"], seconds, memory, self._style)
        plan = self._layout.split(self._columns.own(self._network.plan(inputs)))
        terms = {**{name: obs[name] for name in self._own}, "last_action": self._last_action, **plan}
        self._last_action, self._before = self._follower.action(terms), terms
        return self._tracker.target(self._robot, terms, self._last_action)

    def drove(self, target: torch.Tensor) -> None:
        """Joint targets (N, J) [rad] were given instead of what `act` said last: it goes on from there."""
        self._last_action = self._tracker.actions_of(self._robot, self._before, target)


def save_planner(
    folder: Path, robot: Robot, network: PlannerNetwork, config: PlannerConfig, notes: Mapping[str, object]
) -> None:
    """Write the planner's own network; its tracker and perception are in folders beside it."""
    save_checkpoint(
        folder,
        "planner",
        robot.name,
        config,
        {name: value.cpu().numpy() for name, value in network.state_dict().items()},
        notes,
    )


def load_network(folder: Path, robot: Robot) -> Mapping[str, torch.Tensor]:
    """Tensors of a planner's own network, by name, for who learns on from it. Raises BadCheckpoint."""
    found = load_checkpoint(folder, "planner", robot.name).tensors
    return {name: torch.from_numpy(values.astype(np.float32)) for name, values in found.items()}


def load_planner(folder: Path, robot: Robot, task: Task) -> PlannerPolicy:
    """Read a planner with the `tracker` and, if the task's goal has to be found, the `perception` in the folders beside
    it. Raises BadCheckpoint.
    """
    checkpoint = load_checkpoint(folder, "planner", robot.name)
    config = checkpoint.config_as(PlannerConfig)
    tracker = load_tracker(beside(folder, "tracker"), robot)
    goal = known_goal(eyes_for(folder, task), robot, task)
    style = checkpoint.tensors["style_mean"].size if "style_mean" in checkpoint.tensors else 0
    tasks = learned_at(folder, task)
    sizes = PlannerSizes.of(robot, tasks, tracker.spec, style, config.clock)
    network = built(checkpoint, lambda: PlannerNetwork(sizes, config.hidden), [len(config.hidden)])
    columns = columns_of(tracker.spec, robot, tasks)[tasks.index(task)]
    return PlannerPolicy(robot, task, network, tracker, goal, columns)


def eyes_for(folder: Path, task: Task) -> Path:
    """Folder of the perception that a planner finds a task's goal with: beside it, or, for one of several tasks, in a
    folder of the task's name there.
    """
    its = folder.parent / task.name / "perception"
    return its if (its / CONFIG).exists() else beside(folder, "perception")


def learned_at(folder: Path, task: Task) -> tuple[Task, ...]:
    """The tasks that the planner in a folder learned, in order of its columns; one that learned a single task is taken
    for one of `task`. Raises BadCheckpoint if it learned several others.
    """
    names = checkpoint_tasks(folder)
    if len(names) < 2:
        return (task,)
    if task.name not in names or any(name not in TASKS for name in names):
        raise BadCheckpoint(f"{folder} was learned at {', '.join(names)}; judge it at one of these tasks")
    return tuple(task if name == task.name else TASKS.get(name) for name in names)
