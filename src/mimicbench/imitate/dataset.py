"""Batches of demonstrations: what a learner would have seen in a frame, made again from the simulator's state, and
what to do.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import torch
from torch import Tensor

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadFile
from mimicbench.core.seeds import digest
from mimicbench.imitate.inputs import Batch
from mimicbench.imitate.lerobot import Demos
from mimicbench.imitate.settings.inputs import InputConfig, Window
from mimicbench.imitate.stored.sampler import Sampler
from mimicbench.imitate.stored.scenery import Scenery, disturbed
from mimicbench.imitate.stored.scratch import scratch
from mimicbench.objects.shape import SceneObject
from mimicbench.sensors.targets import TARGET_CELL, target_map
from mimicbench.tasks.goal import GoalSpec


@dataclass(frozen=True)
class EpisodeGoals:
    """What E demonstrations were to do."""

    spec: GoalSpec
    start_w: Tensor
    """(E, G) their goals in the world, as they were at the start."""
    places_w: np.ndarray | None = None
    """(E, 2, 3) where each wrist was told to go in the world [m], NaN of a hand that has nothing to do."""
    map_cell: float = TARGET_CELL
    """[m] Side of a cell of the maps of what robots are told."""
    to_find: bool = False
    """Whether a learner is also to say where they are in each frame."""


class Plans(Protocol):
    """What a learner is to say instead of joint targets."""

    def of(self, frames: Tensor, steps: Tensor) -> Tensor:
        """(B, chunk, A) what is to be said in frames (B,) of the frames `steps` (B, chunk), none after the end."""
        ...


class RelativeTargets:
    """Joint targets as differences from the joint angles of the frame in which they are chosen."""

    def __init__(self, demos: Demos) -> None:
        joints = slice(7, 7 + len(demos.joint_names))
        self._action = torch.from_numpy(demos.action.astype(np.float32, copy=False))
        self._joint_pos = torch.from_numpy(demos.qpos[:, joints])

    def of(self, frames: Tensor, steps: Tensor) -> Tensor:
        """(B, chunk, J) [rad], see Plans."""
        return self._action[steps] - self._joint_pos[frames].float()[:, None]


class DemoFrames:
    """The frames of demonstrations as a learner with the given inputs sees them.

    A tenth of the episodes, chosen by their reference's id alone, are kept for validation.
    """

    def __init__(
        self,
        demos: Demos,
        objects: Mapping[str, SceneObject],
        inputs: InputConfig,
        window: Window,
        scenery: Scenery | None = None,
        goals: EpisodeGoals | None = None,
        plans: Plans | None = None,
        validation: float = 0.1,
    ) -> None:
        """Prepare everything but the maps, which are made batch by batch.

        Args:
            demos: The demonstrations.
            objects: By id, at least those of the demonstrations.
            inputs: What the learner sees.
            window: Which frames it is shown.
            scenery: What makes what surrounds it; needed if it sees that.
            goals: What they were to do; needed if the learner has a memory, is told, or finds them.
            plans: What it is to say; joint targets by default.
            validation: Share of the episodes that is kept apart.
        """
        self.demos, self.inputs, self.window, self._plans = demos, inputs, window, plans
        missing = sorted(set(demos.object_ids) - set(objects))
        if missing:
            raise BadFile(
                f"object {missing[0]!r} of the demonstrations is missing; make the objects again with "
                "the seed that the demonstrations had"
            )
        if inputs.body == "state" and demos.state is None:
            raise BadFile("the demonstrations were read without S_current, which this learner sees; read them with it")
        ids = sorted(set(demos.object_ids))
        self.episode = torch.from_numpy(np.repeat(np.arange(demos.episodes), np.diff(demos.starts)))
        self.starts = torch.from_numpy(demos.starts)
        self.object_index = torch.tensor([ids.index(object_id) for object_id in demos.object_ids])
        self.state = None if demos.state is None or inputs.body != "state" else torch.from_numpy(demos.state)
        self.proprio = torch.from_numpy(_proprioception_of(demos))
        self.action = torch.from_numpy(demos.action.astype(np.float32, copy=False))
        self.root_pos = torch.from_numpy(demos.qpos[:, :3].astype(np.float32))
        self.root_quat = torch.from_numpy(demos.qpos[:, 3:7])
        self.root_yaw = torch.from_numpy(rot.yaw_of(demos.qpos[:, 3:7]).astype(np.float32))
        self.time = (torch.arange(demos.frames) - self.starts[self.episode]) / demos.fps
        rest = demos.qpos[:, 7 + len(demos.joint_names) :]
        self.object_pose = torch.from_numpy(rest.astype(np.float32)) if rest.shape[1] else None
        if scenery is not None:
            self._scenery = scenery
        elif inputs.sees:
            raise ValueError("this learner sees what surrounds it; say what makes that")
        self._finds = goals is not None and goals.to_find
        if goals is not None:
            self._goals = goals
        if inputs.memory or inputs.targets:
            if goals is None:
                raise ValueError("this learner knows its goal; say what it was")
            first = self.starts[:-1]
            self.goal = goals.spec.to_root(goals.start_w, self.root_pos[first], self.root_yaw[first])
        held = torch.from_numpy(_apart(demos, validation))[self.episode]
        self.train_frames, self.validation_frames = torch.nonzero(~held)[:, 0], torch.nonzero(held)[:, 0]

    @cached_property
    def _sampler(self) -> Sampler:
        return Sampler(self.demos, self.train_frames)

    def draw(self, count: int, soon: float, driven: float, wrong: float, generator: torch.Generator) -> Tensor:
        """(count,) frames to learn from; see Sampler."""
        return self._sampler.draw(count, soon, driven, wrong, generator)

    def batch(self, frames: Tensor, generator: torch.Generator | None = None) -> Batch:
        """What is seen in the given frames (B,) and the actions from there on.

        Without a generator there is no noise.
        """
        steps, last = self._steps(frames)
        seen = self._history(frames)
        vector = self.vector(seen.flatten(), generator)
        if self.inputs.history > 1:
            vector = vector.unflatten(0, seen.shape)
        ahead = self._history(torch.minimum(steps[:, -1] + 1, last[:, 0]))
        return Batch(
            vector,
            self._seen(seen, generator) if self.inputs.sees else None,
            self._actions(frames, steps, last),
            steps > last,
            self._goal(frames) if self._finds else None,
            self._seen(ahead, generator) if self.window.looks_ahead and self.inputs.sees else None,
        )

    def _goal(self, frames: Tensor) -> Tensor:
        """(B, G) where the goal is in frames (B,), in the units of GoalSpec.middle_and_spread."""
        spec, start_w = self._goals.spec, self._goals.start_w[self.episode[frames]]
        middle, spread = spec.middle_and_spread()
        return (spec.to_root(start_w, self.root_pos[frames], self.root_yaw[frames]) - middle) / spread

    def samples(self, frames: Tensor) -> Tensor:
        """What is learned, of frames (M,), for its statistics: (M, A), or (M / 10, chunk, A) of plans."""
        # plans are as large as their chunks are long, and neighbors are alike
        return self.action[frames] if self._plans is None else self._actions(frames[::10], *self._steps(frames[::10]))

    def ends(self) -> Tensor:
        """(2, A) the lowest and the highest action [rad] of all that are learned from; a peak may last a frame."""
        parts = [self.action[some] for some in self.train_frames.split(_AT_ONCE)]
        return torch.stack(
            [torch.stack([p.amin(0) for p in parts]).amin(0), torch.stack([p.amax(0) for p in parts]).amax(0)]
        )

    def _steps(self, frames: Tensor) -> tuple[Tensor, Tensor]:
        """The frames (B, chunk) of the window of frames (B,), and the last one (B, 1) of the episode,
        after which some may lie.
        """
        first = self.starts[self.episode[frames]][:, None]
        steps = frames[:, None] + torch.arange(self.window.chunk) - self.window.past
        return torch.maximum(steps, first), self.starts[self.episode[frames] + 1][:, None] - 1

    def _history(self, frames: Tensor) -> Tensor:
        """(B, history) the frames that are seen in frames (B,): the first one again where there was none before."""
        before = frames[:, None] - torch.arange(self.inputs.history - 1, -1, -1)
        return torch.maximum(before, self.starts[self.episode[frames]][:, None])

    def _actions(self, frames: Tensor, steps: Tensor, last: Tensor) -> Tensor:
        there = torch.minimum(steps, last)
        return self.action[there] if self._plans is None else self._plans.of(frames, there)

    def vector(self, frames: Tensor, generator: torch.Generator | None = None) -> Tensor:
        """The input vectors (B, size) of frames (B,)."""
        memory = None
        if self.inputs.memory:
            episode = self.episode[frames]
            goal = self.goal[episode]
            if generator is not None:
                goal = self._goals.spec.disturbed(goal, generator)
            memory = self._goals.spec.carried(
                goal, *odometry(self.root_pos, self.root_yaw, self.starts[episode], frames)
            )
        state = self.proprio[frames] if self.state is None else self.state[frames]
        return self.inputs.vector(state, self.proprio[frames], self.time[frames], memory)

    def _seen(self, frames: Tensor, generator: torch.Generator | None) -> Tensor:
        """What is seen in frames (B, history), as Batch.picture has it."""
        pictures = self.pictures(frames.flatten(), generator)
        return pictures.unflatten(0, frames.shape) if self.inputs.history > 1 else pictures

    def pictures(self, frames: Tensor, generator: torch.Generator | None = None) -> Tensor:
        """What is seen (B, channels, 128, 128) in frames (B,)."""
        places = None
        if self.inputs.targets:
            places = self._goals.places_w[self.episode[frames].numpy()]
        seen = self._around(self._earlier(frames, generator), places)
        if self.inputs.views:
            return seen
        seen = seen if generator is None else disturbed(seen, self.root_pos[frames, 2], self._scenery.errors, generator)
        if places is None:
            return seen[:, None]
        heading = rot.from_yaw(self.root_yaw[frames].numpy())
        told = target_map(self.root_pos[frames].numpy(), heading, places, self._goals.map_cell)
        return torch.stack([seen, told], 1)

    def _earlier(self, frames: Tensor, generator: torch.Generator | None) -> Tensor:
        """(B,) the frames, of the same episodes, of which the maps are that come in frames (B,)."""
        if generator is None or not self._scenery.errors.late:
            return frames
        age = torch.randint(self._scenery.errors.late + 1, frames.shape, generator=generator)
        return torch.maximum(frames - age, self.starts[self.episode[frames]])

    def _around(self, frames: Tensor, places: np.ndarray | None) -> Tensor:
        """(B, 128, 128), or (B, channels, 128, 128), what surrounds the robots."""
        index, root_pos = self.object_index[self.episode[frames]], self.root_pos[frames]
        pose = None if self.object_pose is None else self.object_pose[frames]
        return self._scenery.make(index, root_pos, self.root_quat[frames], pose, places)


def _apart(demos: Demos, share: float) -> np.ndarray:
    """(E,) which episodes are kept for validation."""
    # by the reference's id, so that the same clip is never learned from in one run and validated on in the next
    apart = np.array([digest(0, "validation", reference) % 1000 < 1000 * share for reference in demos.reference_ids])
    if apart.all() or not apart.any():
        apart[:] = False
        apart[0] = demos.episodes > 1 and share > 0
    return apart


def odometry(root_pos: Tensor, root_yaw: Tensor, start: Tensor, now: Tensor) -> tuple[Tensor, Tensor]:
    """Position (B, 2) [m] and heading (B,) [rad] in frames `now` (B,) relative to frames `start` (B,)."""
    yaw = root_yaw[start]
    delta = root_pos[now, :2] - root_pos[start, :2]
    cos, sin = yaw.cos(), yaw.sin()
    pos = torch.stack([cos * delta[:, 0] + sin * delta[:, 1], cos * delta[:, 1] - sin * delta[:, 0]], -1)
    return pos, rot.wrap_angle(root_yaw[now] - yaw)


_AT_ONCE = 1 << 16


def _proprioception_of(demos: Demos) -> np.ndarray:
    """(F, 10 + 2 J) of all frames, some of them at a time."""
    joints = len(demos.joint_names)
    whole = scratch((demos.frames, 10 + 2 * joints), np.float32, demos.disk)
    for begin in range(0, demos.frames, _AT_ONCE):
        some = slice(begin, begin + _AT_ONCE)
        whole[some] = proprioception(demos.qpos[some], demos.qvel[some], joints)
    return whole


def proprioception(qpos: np.ndarray, qvel: np.ndarray, joints: int) -> np.ndarray:
    """What a robot with J joints measures of itself (F, 10 + 2 J), from simulator positions (F, 7 + J + ...) and
    velocities (F, 6 + J + ...), an object's behind the robot's.

    Gravity's direction 3, root height 1, root linear velocity 3 and angular velocity 3 in the root frame, joint angles
    J, joint velocities J.
    """
    quat = qpos[:, 3:7]
    down = np.broadcast_to(np.array([0.0, 0.0, -1.0]), (len(qpos), 3))
    parts = [
        rot.rotate_inverse(quat, down),
        qpos[:, 2:3],
        rot.rotate_inverse(quat, qvel[:, :3]),
        qvel[:, 3:6],
        qpos[:, 7 : 7 + joints],
        qvel[:, 6 : 6 + joints],
    ]
    return np.concatenate(parts, -1).astype(np.float32)
