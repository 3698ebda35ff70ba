"""What robots know of their goal while they run: what was seen, carried along by odometry, or what they are told.

Either way it is the goal as it was at the start, and as it is by now. A goal that has to be found is looked for in
elevation maps until a robot is sure of it, or near. That is where the object was when it was seen. Who has moved it
since has it in the hands, where the cameras see it badly; but then the body says where it is, and a planner learns to
say so in its plan (imitate.planner).
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Protocol

import torch
from torch import Tensor, nn

from mimicbench.core import rotations as rot
from mimicbench.envs.clips import ClipSet
from mimicbench.imitate.perception import Perception, load_perception
from mimicbench.robots.description import Robot
from mimicbench.sensors.observations import Observations
from mimicbench.tasks.goal import GoalSpec
from mimicbench.tasks.task import Task

LOOK_EVERY = 1.0
"""[s] between the looks of a robot that is not sure yet where its goal is."""
BESIDE = 0.3
"""[m] between the hands of who is told a place for one of them: both reach, as people of `touch-points` do."""
SURE = 0.02
"""[m], [rad] Who expects to be off by less than this does not look again."""


class KnownGoal(Protocol):
    """What N robots know of their goals; `begin` all of them before anything else."""

    observations: tuple[str, ...]
    """Names of the terms that it needs."""

    @property
    def goal(self) -> Tensor:
        """(N, G) as it was first known, in the heading frame of each robot's start."""
        ...

    def to(self, device: str) -> None:
        """Move its networks to a device. All robots have to begin anew."""
        ...

    def begin(self, ids: Tensor, obs: Observations) -> None:
        """Robots `ids` (M,) begin anew; `obs` are those of all N in their first frame."""
        ...

    def recall(self, obs: Observations) -> Tensor:
        """(N, memory_size) what robots know by now: `GoalSpec.joined` of the start and of now."""
        ...

    def networks(self) -> list[nn.Module]:
        """Those that see."""
        ...

    def memory(self) -> dict[str, Tensor]:
        """(N, ...) what it carries from frame to frame, by name."""
        ...

    def remember(self, memory: Mapping[str, Tensor]) -> None:
        """Go on from what `memory` gave."""
        ...


def known_goal(folder: Path, robot: Robot, task: Task) -> KnownGoal:
    """What policies of a task know of its goal, seen by the perception in a folder unless it is told.

    Raises BadCheckpoint.
    """
    return GivenGoal(task.goal) if task.goal.given else SeenGoal(load_perception(folder, robot.name))


class GoalMemory:
    """What N robots remember of their goal: the surest look at it so far, carried along by odometry."""

    def __init__(self, perception: Perception, robots: int, device: torch.device | str = "cpu") -> None:
        """Nothing is remembered before the first `look` of each robot. `device` is where perception and senses are."""
        self.perception = perception
        self.spec = perception.goal
        self.goal = torch.zeros(robots, self.spec.size, device=device)
        """(N, G) in the heading frame of each robot's start."""
        self.uncertainty = torch.full((robots,), torch.inf, device=device)
        """(N,) how far off it may be [m], [rad]; see Perception.look."""

    def forget(self, ids: Tensor) -> None:
        """Robots `ids` (M,) begin anew."""
        self.uncertainty = self.uncertainty.index_fill(0, ids, torch.inf)

    def look(
        self, ids: Tensor, elevation: Tensor, root_height: Tensor, odometry_pos: Tensor, odometry_yaw: Tensor
    ) -> None:
        """Robots `ids` (M,) look; who is surer than before remembers what is seen now.

        Args:
            ids: (M,) who looks.
            elevation: (M, 128, 128) their maps [m].
            root_height: (M,) [m].
            odometry_pos: (M, 2) their positions in the heading frame of their start [m].
            odometry_yaw: (M,) their headings since then [rad].
        """
        found, uncertainty = self.perception.look(elevation, root_height)
        found = self.spec.taken(found) if self.spec.taken else found
        found = self.spec.from_root(found, odometry_pos, odometry_yaw)
        # a little surer is not enough: what is remembered should not jump about
        surer = uncertainty < 0.7 * self.uncertainty[ids]
        seen = torch.where(surer[:, None], found, self.goal[ids])
        self.goal = self.goal.index_copy(0, ids, seen.to(self.goal.dtype))
        kept = torch.where(surer, uncertainty, self.uncertainty[ids])
        self.uncertainty = self.uncertainty.index_copy(0, ids, kept.to(self.uncertainty.dtype))

    def unsure(self, odometry_pos: Tensor, odometry_yaw: Tensor) -> Tensor:
        """(N,) who should look again: unsure, and not so near yet that the map shows less than before."""
        now = self.spec.to_root(self.goal, odometry_pos, odometry_yaw)[:, self.spec.where]
        near = max(self.perception.config.distance[0] + 0.1, self.spec.near)
        return (self.uncertainty > SURE) & (now.norm(dim=-1) > near)

    def recall(self, odometry_pos: Tensor, odometry_yaw: Tensor) -> Tensor:
        """The memory (N, memory_size) of all robots, as `GoalSpec.carried`."""
        return self.spec.carried(self.goal, odometry_pos, odometry_yaw)


class SeenGoal:
    """A goal that robots look for: at first, and every LOOK_EVERY seconds while they are unsure."""

    observations: tuple[str, ...] = ("proprio", "time", "odometry", "elevation")

    def __init__(self, perception: Perception) -> None:
        self._memory = GoalMemory(perception, 0)

    @property
    def goal(self) -> Tensor:
        """(N, G) as it was seen."""
        return self._memory.goal

    def to(self, device: str) -> None:
        """Move the network; nothing is remembered."""
        self._memory = GoalMemory(self._memory.perception.to(device), 0, device)

    def begin(self, ids: Tensor, obs: Observations) -> None:
        """Look at the first map."""
        if len(self.goal) != obs.num_envs:
            self._memory = GoalMemory(self._memory.perception, obs.num_envs, obs["time"].device)
        self._memory.forget(ids)
        self._look(ids, obs)

    def recall(self, obs: Observations) -> Tensor:
        """(N, memory_size) after another look of those that are due for one."""
        time, odometry = obs["time"][:, 0], obs["odometry"]
        looks = time / LOOK_EVERY
        due = (time > 0) & ((looks - looks.round()).abs() * LOOK_EVERY < 1e-3)
        if torch.compiler.is_compiling():
            self._look_where(due & self._memory.unsure(odometry[:, :2], odometry[:, 2]), obs)
        elif due.any():
            ids = (due & self._memory.unsure(odometry[:, :2], odometry[:, 2])).nonzero()[:, 0]
            if len(ids):
                self._look(ids, obs)
        return self._memory.recall(odometry[:, :2], odometry[:, 2])

    def networks(self) -> list[nn.Module]:
        """The perception."""
        return [self._memory.perception]

    def memory(self) -> dict[str, Tensor]:
        """The goal, and how far off it may be."""
        return {"goal": self._memory.goal, "uncertainty": self._memory.uncertainty}

    def remember(self, memory: Mapping[str, Tensor]) -> None:
        """Go on from what `memory` gave."""
        self._memory.goal, self._memory.uncertainty = memory["goal"], memory["uncertainty"]

    def _look_where(self, due: Tensor, obs: Observations) -> None:
        """Robots that are `due` (N,) look. In a graph, which cannot choose among them, all look and some remember."""
        before = self.memory()
        self._look(torch.arange(len(due)), obs)
        self._memory.goal = torch.where(due[:, None], self._memory.goal, before["goal"])
        self._memory.uncertainty = torch.where(due, self._memory.uncertainty, before["uncertainty"])

    def _look(self, ids: Tensor, obs: Observations) -> None:
        odometry = obs["odometry"][ids]
        self._memory.look(ids, obs.of("elevation", ids), obs["proprio"][ids, 3], odometry[:, :2], odometry[:, 2])


class GivenGoal:
    """A goal that robots are told in every frame: where their wrists are to go."""

    observations: tuple[str, ...] = ("proprio", "odometry", "targets", "hands")

    def __init__(self, spec: GoalSpec) -> None:
        self._spec = spec
        self.goal = torch.zeros(0, spec.size)

    def to(self, device: str) -> None:
        """Nothing is remembered."""
        self.goal = self.goal[:0].to(device)

    def begin(self, ids: Tensor, obs: Observations) -> None:
        """Remember what is told first."""
        if len(self.goal) != obs.num_envs:
            self.goal = torch.zeros(obs.num_envs, self._spec.size, device=obs["proprio"].device)
        odometry = obs["odometry"][ids]
        told = given_goal(self._spec, obs["targets"][ids], obs["hands"][ids], obs["proprio"][ids])
        found = self._spec.from_root(told, odometry[:, :2], odometry[:, 2])
        self.goal = self.goal.index_copy(0, ids, found.to(self.goal.dtype))

    def networks(self) -> list[nn.Module]:
        """None."""
        return []

    def memory(self) -> dict[str, Tensor]:
        """The goal."""
        return {"goal": self.goal}

    def remember(self, memory: Mapping[str, Tensor]) -> None:
        """Go on from what `memory` gave."""
        self.goal = memory["goal"]

    def recall(self, obs: Observations) -> Tensor:
        """(N, memory_size) of the start, and what is told now."""
        return self._spec.joined(self.goal, given_goal(self._spec, obs["targets"], obs["hands"], obs["proprio"]))


def given_goal(spec: GoalSpec, targets: Tensor, hands: Tensor, proprio: Tensor) -> Tensor:
    """(N, G) given goals in the heading frames of roots, with heights above the floor.

    Args:
        spec: What goals consist of.
        targets: (N, 2, 3) where the wrists are to go in the root frames [m].
        hands: (N, 2) which of them are to go anywhere, 1 or 0.
        proprio: (N, P) what the robots measure of themselves: gravity's direction 3, root height 1, and more.
    """
    up = -proprio[:, :3]
    # the heading is that of the root's x axis, so the y axis of its frame is level and at right angles to that
    left = torch.stack([torch.zeros_like(up[:, 0]), up[:, 2], -up[:, 1]], -1)
    left = left / left.norm(dim=-1, keepdim=True).clamp(min=1e-6)
    ahead = torch.linalg.cross(left, up)
    level = torch.stack([(targets * axis[:, None]).sum(-1) for axis in (ahead, left, up)], -1)
    level[..., 2] += proprio[:, 3, None]
    return spec.told(both_places(torch.where(hands[..., None] > 0, level, torch.nan)))


def both_places(places: Tensor) -> Tensor:
    """Places (N, 2, 3) [m] of left and right wrists, seen from robots at the origin, in which a hand that has nothing
    to do (NaN) is held BESIDE the other, across the line of sight.
    """
    ahead = torch.nanmean(places[..., :2], 1)
    ahead = ahead / ahead.norm(dim=-1, keepdim=True).clamp(min=1e-6)
    left = torch.stack([-ahead[:, 1], ahead[:, 0], torch.zeros_like(ahead[:, 0])], -1)
    beside = places.flip(1) + BESIDE * torch.stack([left, -left], 1)
    return torch.where(places.isnan(), beside, places)


def goals_of(clips: ClipSet) -> Tensor:
    """(C, G) the goals of clips in the world, as they are when the clips begin."""
    spec, found = clips.task.goal, []
    for motion, obj in zip(clips.motions, clips.scenes, strict=True):
        if spec.describe is None:
            here = torch.tensor(motion.root_pos_w[:1] * [1, 1, 0])
            found.append(spec.told(both_places((torch.tensor(motion.wrist_goal_w) - here)[None])[0] + here))
            continue
        goal = torch.tensor(spec.describe(obj))
        if len(motion.object_pos_w):
            pos, yaw = motion.object_pos_w[0], rot.yaw_of(motion.object_quat_w[0])
            goal = spec.from_root(goal, torch.tensor(pos), torch.tensor(yaw))
        found.append(goal)
    return torch.stack(found).float()
