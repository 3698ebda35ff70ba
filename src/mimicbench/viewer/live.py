"""An episode that is acted out while one looks: a tracker follows a clip, or a policy acts, a step at a time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch

from mimicbench.benchmark.who import Who
from mimicbench.core.errors import MimicbenchError
from mimicbench.envs.clip_starts import ClipStarts
from mimicbench.envs.initial_states import stacked, start_of
from mimicbench.envs.metrics import PHASES
from mimicbench.envs.reference import ReferenceBank
from mimicbench.envs.vec_env import EnvConfig, VecEnv
from mimicbench.evaluate.guard import Guard
from mimicbench.evaluate.rollout import phase_in_words
from mimicbench.policies.loading import load_policy
from mimicbench.robots.description import Robot
from mimicbench.sim.physics import PhysicsConfig
from mimicbench.sim.rows import Rows
from mimicbench.sim.threads import one_torch_thread
from mimicbench.sim.timing import CONTROL_DT
from mimicbench.tasks.task import BodyPoints
from mimicbench.track.checkpoint import load_tracker
from mimicbench.track.history import Follower
from mimicbench.viewer.opened import Opened
from mimicbench.viewer.tracks import Curves, Pose, State, first_fulfilled, torques

Act = Callable[[], "tuple[torch.Tensor, torch.Tensor | None] | None"]
"""Targets (1, J) for the next step and the action that they were made of; None if there are none to be had."""


@dataclass
class LiveTrack:
    """What an episode has come to by now; grows while it is acted out."""

    title: str
    figure: Robot
    opened: Opened
    fps: float = 1 / CONTROL_DT
    poses: list[Pose] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    """Per frame, what the condition of K lacks."""
    steps: list[tuple[float, np.ndarray, np.ndarray]] = field(default_factory=list)
    """Per step, e [W^2], torques and powers of the joints."""
    states: list[State] = field(default_factory=list)
    """Per step, what it began with."""

    def __len__(self) -> int:
        return len(self.poses)

    def pose(self, frame: int) -> Pose:
        """Where everything is in a frame."""
        return self.poses[frame]

    def lacks(self, frame: int) -> str:
        """What the condition of K lacks in a frame."""
        return self.missing[frame]

    def fulfilled(self) -> int | None:
        """The frame in which K is first fulfilled, by now. The first frame is none of the episode's."""
        holds = np.array([not words for words in self.missing[1:]])
        found = first_fulfilled(self.opened.task, holds, self.fps)
        return None if found is None else found + 1

    def state(self, frame: int) -> State | None:
        """All that the physics was in a frame; in the last one, in which nobody has chosen yet what to do, the one
        before stands for it.
        """
        return self.states[min(frame, len(self.states) - 1)] if self.states else None

    def curves(self) -> Curves | None:
        """What the joints had to do."""
        if not self.steps:
            return None
        effort, torque, power = (np.array(values) for values in zip(*self.steps, strict=True))
        return Curves((1 + np.arange(len(effort))) * CONTROL_DT, effort, torque, power)


class Episode:
    """One robot beside the object of an item, driven by a checkpoint. Close it after use."""

    def __init__(self, name: str, folder: Path, opened: Opened) -> None:
        """Stand at the beginning of the item's clip. Raises MimicbenchError if there is none, or the checkpoint is not
        for it.
        """
        if opened.clip is None:
            raise MimicbenchError("there is no retargeted clip to begin from; run `mimicbench retarget` first")
        self.name, self.opened = name, opened
        self.track = LiveTrack(name, opened.robot, opened)
        self.over, self.error = False, ""
        self.follows = Who(name, folder).is_tracker
        """Whether it follows the item's clip."""
        make = _following if self.follows else _acting
        self.env, self.act, self.gains, self._guard = make(folder, opened)
        self._limit = round(opened.task.time_limit / CONTROL_DT)
        self._note()

    def until(self, time: float) -> None:
        """Act until a time [s], or to the end."""
        while not self.over and (len(self.track) - 1) * CONTROL_DT < time - 1e-9:
            self.step()

    @torch.no_grad()
    @one_torch_thread  # networks for one robot are too small to share, and threads wait by spinning
    def step(self) -> None:
        """One control step."""
        chosen = self.act()
        if chosen is None or (self._guard is not None and not bool(self._guard.sound.all())):
            self.over, self.error = True, self._guard.errors().get(0, "") if self._guard is not None else ""
            return
        target, action = chosen
        state, robot = self.env.context.state, self.opened.robot
        velocity = state.joint_vel[0].cpu().numpy()
        given = target[0].cpu().numpy()
        torque = torques(robot, self.gains, state.joint_pos[0].cpu().numpy(), velocity, given)
        physics = self.env.physics
        self.track.states.append(State(physics.qpos()[0].copy(), physics.qvel()[0].copy(), given, self.gains))
        self.env.step(target, action)
        self.track.steps.append((float(physics.effort[0]), torque, torque * velocity))
        self._note()
        assert self.env.metrics is not None
        self.over = len(self.track) > self._limit or bool(self.env.metrics.diverged[0])

    def push(self, velocity_w: np.ndarray) -> None:
        """Add (3,) to the root's velocity [m/s], where the episode is now."""
        self.env.physics.push(torch.from_numpy(np.asarray(velocity_w, np.float32))[None].to(self.env.device))

    def verdict(self) -> str:
        """What it has come to by now, in words."""
        assert self.env.metrics is not None
        found = self.env.metrics.verdict()
        if self.error:
            return f"ended: {self.error}"
        if bool(found.diverged[0]):
            return "ended: the physics broke down"
        if bool(found.fell[0]):
            phase = phase_in_words(self.opened.task, int(found.fell_phase[0])) or PHASES[1]
            return f"fell {'' if phase.startswith('after') else 'while '}{phase}, at {float(found.fell_time[0]):.1f} s"
        return "at its end" if self.over else "has not fallen"

    def close(self) -> None:
        """Give everything back."""
        self.env.close()

    def _note(self) -> None:
        """Keep where everything is now."""
        env, task, robot = self.env, self.opened.task, self.opened.robot
        links = env.context.links
        pos, quat = (values[0].cpu().numpy().astype(float) for values in (links.pos_w, links.quat_w))
        object_pos, object_quat = (values[0] for values in env.physics.object_pose())
        self.track.poses.append(Pose(pos, quat, object_pos, object_quat))
        assert env.metrics is not None
        info = env.metrics.info.map(lambda values: values.cpu().numpy())
        points = BodyPoints.of(robot, pos[None], quat[None])
        lacks = task.failure_reason(points, info.moved(object_pos[None], object_quat[None]))[0]
        self.track.missing.append(lacks)


def _environment(opened: Opened, gains: str, bank: ReferenceBank | None = None) -> VecEnv:
    config = EnvConfig(workers=1, physics=PhysicsConfig(gains=gains))
    return VecEnv(opened.task, opened.robot, [opened.obj], config, bank=bank)


def _following(folder: Path, opened: Opened) -> Any:
    """A tracker on the item's clip, which is cut as for the tracker's judge."""
    tracker = load_tracker(folder, opened.robot)
    assert opened.clip is not None
    clip = opened.task.trimmed(opened.clip, opened.obj, opened.robot)
    bank = ReferenceBank([clip], opened.robot, "cpu")
    env = _environment(opened, tracker.spec.gains, bank)
    first = torch.zeros(1, dtype=torch.long)
    starts = ClipStarts(bank, env.physics.add_objects([opened.obj]), opened.robot)
    env.reset(Rows.every(1, env.device), starts.at(first, first))
    follower = Follower(tracker, 1, env.device)

    def act() -> tuple[torch.Tensor, torch.Tensor]:
        action = follower.action(env.observe(tracker.spec.observations))
        reference = env.context.reference(1).joint_pos
        return tracker.spec.aim(opened.robot, reference, action, env.context.last_action, tracker.settings), action

    return env, act, tracker.spec.gains, None


def _acting(folder: Path, opened: Opened) -> Any:
    """A policy that knows the first frame of the item's clip and nothing else of it."""
    policy = load_policy(folder, opened.robot, opened.task)
    assert opened.clip is not None
    env = _environment(opened, policy.gains)
    start = start_of(opened.clip, opened.obj, opened.robot, opened.task)
    env.reset(Rows.every(1, env.device), stacked([start], env.physics))
    policy.to(env.device)
    guard = Guard(policy, env.context.state.joint_pos)
    guard.reset(torch.arange(1), env.observe(policy.observations))

    def act() -> tuple[torch.Tensor, None] | None:
        target = guard.act(env.observe(policy.observations))
        return None if target is None else (target, None)

    return env, act, policy.gains, guard
