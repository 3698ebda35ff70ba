"""A tracker that learns what other trackers would do where it gets to: of several, each the teacher of its task, one.

    argmin E ||a(s) - a_task(s)||,   s where a leads to   (DAgger, Ross et al. 2011)

Nothing is explored, and no reward is needed: each state comes with the mean action of the teacher whose task it is of.
What differs from Ross et al.: the learner drives from the beginning, since episodes start in the middle of clips, in
states that the teacher knows, and end where the robot has strayed; and frames are learned from once, for the next ones
cost no more than to keep these.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from mimicbench.core.errors import MimicbenchError
from mimicbench.core.settings import BadSetting
from mimicbench.core.training import MovingAverage, NetworkState, OptimizerState
from mimicbench.robots.description import Robot
from mimicbench.track.checkpoint import load_tracker
from mimicbench.track.network import Blueprint
from mimicbench.track.settings import DistillConfig
from mimicbench.track.spec import TrackerSpec
from mimicbench.track.tracker import Layout, Tracker


@dataclass(frozen=True)
class Teacher:
    """A trained tracker, and whom it teaches."""

    tracker: Tracker
    robots: tuple[slice, ...]
    """Places of the robots at its task, among all."""
    columns: tuple[tuple[slice, slice], ...]
    """Which of its inputs are which of the learner's."""

    def action(self, obs: Tensor) -> Tensor:
        """(N, J) its mean action on what learners observe (N, inputs)."""
        own = obs.new_zeros(len(obs), self.tracker.layout.size * self.tracker.layout.frames)
        for theirs, ours in self.columns:
            own[:, theirs] = obs[:, ours]
        return self.tracker.network(own)


def teachers_of(
    folders: Mapping[str, str],
    robots: Sequence[tuple[str, slice]],
    robot: Robot,
    spec: TrackerSpec,
    settings: object,
    layout: Layout,
) -> tuple[Teacher, ...]:
    """The trackers in folders, by task, for robots that are each at a task.

    Raises BadCheckpoint for what is no tracker of this robot, and BadSetting for one whose actions the learner's could
    not be: of another design or smoothing, or one that sees more.
    """
    found = []
    for task, folder in folders.items():
        tracker = suitable(folder, robot, spec, settings, layout)
        its = tuple(place for name, place in robots if name == task)
        found.append(Teacher(tracker, its, tuple(layout.columns_of(tracker.layout))))
    return tuple(found)


def suitable(folder: str, robot: Robot, spec: TrackerSpec, settings: object, layout: Layout) -> Tracker:
    """The tracker in a folder, as a teacher of one of this design and layout. Raises as `teachers_of` does."""
    tracker = load_tracker(Path(folder), robot)
    if tracker.spec.name != spec.name:
        raise BadSetting(f"the teacher {folder} is a {tracker.spec.name}; give --track.tracker {tracker.spec.name}")
    smoothing = spec.smoothing(tracker.settings)
    if smoothing != spec.smoothing(settings):
        raise BadSetting(
            f"the teacher {folder} smoothes its actions by {smoothing:g}, and the learner by "
            f"{spec.smoothing(settings):g}; give --track.settings.smoothing {smoothing:g}, and teachers that agree"
        )
    if tracker.layout.frames > layout.frames or not set(tracker.observed) <= set(layout.names):
        raise BadSetting(f"the teacher {folder} sees more than the learner; give --track.frames or other teachers")
    return tracker


class Distiller:
    """The learner, and its updates. It learns as `ppo.PPOLearner` does, but from teachers."""

    def __init__(
        self,
        blueprint: Blueprint,
        actions: int,
        teachers: Sequence[Teacher],
        config: DistillConfig,
        device: str = "cpu",
    ) -> None:
        self.teachers, self.config = tuple(teachers), config
        self.network = blueprint.network(actions).to(device)
        if self.network.normalizes:
            mean, std = pooled_statistics(self.teachers, blueprint.inputs)
            self.network.obs_mean.copy_(mean)
            self.network.obs_std.copy_(std)
        for teacher in self.teachers:
            teacher.tracker.network.to(device)
        self.optimizer = torch.optim.Adam(self.network.parameters(), lr=config.learning_rate)
        self.average = MovingAverage(self.network, config.average)
        self.batches = torch.zeros((), dtype=torch.long)
        self._seen: list[Tensor] = []
        self._taught: list[Tensor] = []

    def begin_from(self, tensors: Mapping[str, np.ndarray]) -> None:
        """Take over the weights and statistics of a network of the same sizes. Raises MimicbenchError for another."""
        own = self.network.tensors()
        if {name: value.shape for name, value in own.items()} != {n: value.shape for n, value in tensors.items()}:
            raise MimicbenchError(
                "the tracker to begin from has other sizes or inputs; who learns from teachers goes on from one that "
                "was trained for the same tasks, with the same track.ppo.hidden"
            )
        self.network.load_tensors(tensors)
        self.average = MovingAverage(self.network, self.config.average)

    @property
    def deviation(self) -> tuple[float, ...]:
        """Of no use to who goes on by PPO: the noise was no exploration."""
        return ()

    @torch.no_grad()
    def act(self, obs: Tensor) -> Tensor:
        """Actions (N, J) of the learner with noise; what the teachers would do is remembered for the update."""
        action = self.network(obs)
        taught = torch.empty_like(action)
        for teacher in self.teachers:
            for place in teacher.robots:
                taught[place] = teacher.action(obs[place])
        self._seen.append(obs)
        self._taught.append(taught)
        return action + self.config.noise * torch.randn_like(action)

    def record(self, obs: Tensor, reward: Tensor, done: Tensor, time_out: Tensor) -> None:
        """What the last actions led to says nothing about what should have been done."""

    def update(self, obs: Tensor, critic_alone: bool = False) -> dict[str, float]:
        """Learn from what was seen since the last update. Returns losses by name."""
        seen, taught = torch.cat(self._seen), torch.cat(self._taught)
        self._seen, self._taught = [], []
        losses = []
        for part in torch.randperm(len(seen), device=seen.device).split(self.config.batch):
            loss = nn.functional.smooth_l1_loss(self.network(seen[part]), taught[part])
            self.optimizer.zero_grad(set_to_none=True)
            loss.backward()
            nn.utils.clip_grad_norm_(self.network.parameters(), self.config.max_grad_norm)
            self.optimizer.step()
            self.batches += 1
            self.average.follow(self.network, int(self.batches))
            losses.append(loss.detach())
        with torch.no_grad():
            few = slice(None, None, max(1, len(seen) // 4096))
            error = (self.network(seen[few]) - taught[few]).abs()
        return {"imitation": float(torch.stack(losses).mean()), "action_error": float(error.mean())}

    def network_tensors(self) -> dict[str, np.ndarray]:
        """The moving average, as tensors of a TrackerNetwork."""
        return {**self.network.tensors(), **{n: v.cpu().numpy() for n, v in self.average.values.items()}}

    def critic_tensors(self) -> dict[str, np.ndarray]:
        """None: it knows of no values."""
        return {}

    def state_tensors(self) -> dict[str, Tensor]:
        """A copy of everything needed to go on learning; torch's own random numbers are the caller's."""
        found = {
            f"{name}/{key}": value.detach().clone()
            for name, part in self._parts.items()
            for key, value in part.state_tensors().items()
        }
        return found | {"batches": self.batches.clone()}

    def load_state_tensors(self, tensors: Mapping[str, Tensor]) -> None:
        """The inverse of `state_tensors`."""
        self.batches.copy_(tensors["batches"])
        for name, part in self._parts.items():
            chosen = {n.removeprefix(f"{name}/"): v for n, v in tensors.items() if n.startswith(f"{name}/")}
            part.load_state_tensors(chosen)

    @property
    def _parts(self) -> dict[str, Any]:
        return {
            "network": NetworkState(self.network),
            "optimizer": OptimizerState(self.optimizer),
            "average": self.average,
        }


def pooled_statistics(teachers: Sequence[Teacher], inputs: int) -> tuple[Tensor, Tensor]:
    """Mean and deviation (inputs,) of what all robots observe, by what their teachers saw; what a teacher does not see
    is 0 at its task.
    """
    robots = [float(sum(place.stop - place.start for place in teacher.robots)) for teacher in teachers]
    first, second = torch.zeros(inputs), torch.zeros(inputs)
    for teacher, share in zip(teachers, robots, strict=True):
        network = teacher.tracker.network
        for theirs, ours in teacher.columns:
            mean, std = network.obs_mean[theirs].cpu(), network.obs_std[theirs].cpu()
            first[ours] += share * mean / sum(robots)
            second[ours] += share * (std**2 + mean**2) / sum(robots)
    return first, (second - first**2).clamp(min=0.0).sqrt()
