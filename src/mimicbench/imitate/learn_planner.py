"""Learning the planner by DAgger: tracker or planner drives, and the clip says what should have been planned."""

import json
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import torch
from torch import nn
from torch.nn import functional

from mimicbench.core import rotations as rot
from mimicbench.core.errors import MimicbenchError
from mimicbench.core.motion import RobotMotion
from mimicbench.core.seeds import digest
from mimicbench.imitate.clock import SIZE as CLOCK_SIZE
from mimicbench.imitate.perception import MEMORY_SIZE, SEAT_SIZE, disturb_seat, seat_in_root, seat_memory, seat_of
from mimicbench.imitate.planner import (
    PlannerConfig,
    PlannerNetwork,
    plan_size,
    planner_inputs,
    styles_of,
    tracker_action,
)
from mimicbench.imitate.resume import resume_training, save_training
from mimicbench.objects.shape import SceneObject
from mimicbench.robots.description import Robot
from mimicbench.sensors.proprioception import body_state
from mimicbench.sim.scene import CONTROL_DT
from mimicbench.track.checkpoint import Tracker
from mimicbench.track.env import TrackingEnv
from mimicbench.track.residual import RESIDUAL, assemble, plan_observation, planned_joint_pos, residual_target


class _Episodes:
    """For each training robot: where its clip starts, and the seat as it would be perceived from there."""

    def __init__(self, env: TrackingEnv, objects: Mapping[str, SceneObject], styles: torch.Tensor, seed: int) -> None:
        """`styles` (C, S) are the clips', normalized."""
        self._env, self._styles = env, styles
        clips = torch.arange(len(env.bank), device=env.device)
        first = env.bank.frame(clips, torch.zeros_like(clips))
        self._start_pos, self._start_yaw = first.root_pos_w[:, :2], rot.yaw_of(first.root_quat_w)
        seats = torch.tensor(
            np.array([seat_of(objects[object_id]) for object_id in env.bank.object_ids]),
            dtype=torch.float32,
            device=env.device,
        )
        self._seats = seat_in_root(seats, first.root_pos_w, self._start_yaw)
        self._generator = torch.Generator(env.device).manual_seed(digest(seed, "planner", "seat noise") % (1 << 63))
        self._seen = torch.zeros(env.num_envs, SEAT_SIZE, device=env.device)
        self.begin(torch.arange(env.num_envs, device=env.device))

    def begin(self, ids: torch.Tensor) -> None:
        """Robots `ids` begin anew: each perceives its seat, with the errors that perception makes, once an episode."""
        self._seen[ids] = disturb_seat(self._seats[self._env.clip[ids]], self._generator)

    def inputs(self) -> torch.Tensor:
        """(N, I) what the planner sees now."""
        env, state = self._env, self._env.moment.state
        start, yaw = self._start_pos[env.clip], self._start_yaw[env.clip]
        cos, sin = torch.cos(yaw), torch.sin(yaw)
        dx, dy = (state.root_pos_w[:, :2] - start).unbind(-1)
        moved = torch.stack([cos * dx + sin * dy, cos * dy - sin * dx], -1)
        memory = seat_memory(self._seen, moved, rot.wrap_angle(rot.yaw_of(state.root_quat_w) - yaw))
        return planner_inputs(body_state(state), env.index * CONTROL_DT, memory, self._styles[env.clip])

    def first_looks(self) -> tuple[torch.Tensor, torch.Tensor]:
        """(N, 6) the seats as first seen, and (N, S) the normalized styles of the clips that began so."""
        return self._seen, self._styles[self._env.clip]


def train_planner(
    folder: Path,
    robot: Robot,
    tracker: Tracker,
    motions: Sequence[RobotMotion],
    objects: Mapping[str, SceneObject],
    config: PlannerConfig,
    seed: int,
    workers: int = 0,
    report: Callable[[dict], None] | None = None,
    device: str = "cpu",
) -> PlannerNetwork:
    """Learn a planner over `tracker` by DAgger on `motions`.

    Training state goes to `<folder>/training.*` and `<folder>/metrics.jsonl`; a killed training goes on from there.
    `device` computes the physics, and learns; the tracker's network moves there, too.
    """
    if tracker.kind is not RESIDUAL:
        raise MimicbenchError(f"the planner needs a tracker of preset 'improved', not {tracker.kind.name!r}")
    torch.manual_seed(digest(seed, "planner") % (1 << 63))
    torch.set_num_threads(config.threads)
    env = TrackingEnv(RESIDUAL, robot, motions, objects, config.num_envs, config.tracking, seed, workers, device)
    joints = len(robot.joints)
    _, styles = styles_of(motions)
    network = PlannerNetwork(joints, styles.shape[1], config.hidden)
    network.set_styles(styles)
    network.to(env.device)
    tracker.network.to(env.device)
    styles = styles.to(env.device)
    episodes = _Episodes(env, objects, network.normalized_style(styles), seed)
    optimizer = torch.optim.Adam(network.parameters(), lr=config.learning_rate)
    progress = resume_training(folder, network, optimizer, {"round": 0, "samples": 0, "seconds": 0.0})
    store = _Store(config.memory, network.input_mean.numel(), joints, plan_size(joints), env.device)
    rounds = config.samples // (config.num_envs * config.steps)
    teacher = (torch.rand(config.num_envs) < _teacher_share(progress["round"] / rounds, config)).to(env.device)
    now = saved = time.monotonic()
    while progress["round"] < rounds:
        part = progress["round"] / rounds
        failures, endings = _collect(
            env, episodes, tracker, network, store, teacher, _teacher_share(part, config), config.steps
        )
        if progress["round"] == 0:
            store.statistics(network)
        for group in optimizer.param_groups:
            group["lr"] = config.learning_rate * (0.55 + 0.45 * np.cos(np.pi * part))
        losses = [
            _learn(network, optimizer, tracker, store.draw(config.batch), episodes, config.action_weight)
            for _ in range(config.batches)
        ]
        progress["round"] += 1
        progress["samples"] += config.num_envs * config.steps
        progress["seconds"] += time.monotonic() - now
        now = time.monotonic()
        if progress["round"] % 10 == 0 and report:
            report({**progress, "loss": float(np.mean(losses)), "failed": failures / max(endings, 1)})
        if now - saved > config.save_every or progress["round"] == rounds:
            save_training(folder, network, optimizer, progress)
            row = {
                **progress,
                "loss": float(np.mean(losses)),
                "failed": failures / max(endings, 1),
                "teacher_share": _teacher_share(part, config),
            }
            with open(folder / "metrics.jsonl", "a") as stream:
                stream.write(json.dumps(row) + "\n")
            saved = time.monotonic()
    return network.eval()


def _teacher_share(part: float, config: PlannerConfig) -> float:
    return max(0.0, 1.0 - part / config.teacher_share)


@torch.no_grad()
def _collect(
    env: TrackingEnv,
    episodes: _Episodes,
    tracker: Tracker,
    network: PlannerNetwork,
    store: "_Store",
    teacher: torch.Tensor,
    share: float,
    steps: int,
) -> tuple[int, int]:
    """Let tracker or planner drive for some steps and remember what each robot should have planned.

    Returns failures and endings of planner episodes.
    """
    failures = endings = 0
    for _ in range(steps):
        env.disturb()
        moment, inputs = env.moment, episodes.inputs()
        label = plan_observation(moment)
        store.add(inputs, moment.last_action, label)
        plan = torch.where(teacher[:, None], label, network.plan(inputs))
        action = tracker_action(tracker, moment, plan)
        target = residual_target(env.robot, planned_joint_pos(plan, moment.state.joint_pos), action)
        _, _, done, time_out = env.step(action, target)
        if done.any():
            ids = done.nonzero()[:, 0]
            endings += int((~teacher[ids]).sum())
            failures += int((~teacher[ids] & ~time_out[ids]).sum())
            teacher[ids] = (torch.rand(len(ids)) < share).to(teacher.device)
            episodes.begin(ids)
    return failures, endings


class _Store:
    """The most recent frames: inputs, last action, label."""

    def __init__(self, size: int, inputs: int, actions: int, plan: int, device: str) -> None:
        self._rows = torch.zeros(size, inputs + actions + plan, device=device)
        self._widths = [inputs, actions, plan]
        self._next = self.filled = 0

    def add(self, inputs: torch.Tensor, last_action: torch.Tensor, label: torch.Tensor) -> None:
        rows = torch.cat([inputs, last_action, label], -1)
        at = (self._next + torch.arange(len(rows), device=rows.device)) % len(self._rows)
        self._rows[at] = rows
        self._next = (self._next + len(rows)) % len(self._rows)
        self.filled = min(self.filled + len(rows), len(self._rows))

    def draw(self, count: int) -> tuple[torch.Tensor, ...]:
        """`count` frames at random: inputs, last action, label."""
        return self._rows[torch.randint(self.filled, (count,)).to(self._rows.device)].split(self._widths, -1)

    def statistics(self, network: PlannerNetwork) -> None:
        """Set the network's normalization from what is stored."""
        inputs, _, label = self._rows[: self.filled].split(self._widths, -1)
        # the first frames are the teacher's, close to its clips: a plan is to be precise to centimeters and hundredths
        # of a
        # radian, but a robot that has got off its clip must not outweigh all others
        for name, values, least in (("input", inputs, 0.05), ("plan", label, 0.1)):
            getattr(network, f"{name}_mean").copy_(values.mean(0))
            getattr(network, f"{name}_std").copy_(values.std(0).clamp(min=least))


def _learn(
    network: PlannerNetwork,
    optimizer: torch.optim.Optimizer,
    tracker: Tracker,
    frames: tuple[torch.Tensor, ...],
    episodes: _Episodes,
    action_weight: float,
) -> float:
    """One step: smooth L1 between the normalized plans, the difference that the plan makes to the tracker's action,
    and the chooser's error.
    """
    inputs, last_action, label = frames
    body = inputs[:, : inputs.shape[1] - CLOCK_SIZE - MEMORY_SIZE - len(network.style_mean)]
    planned = network(inputs)
    loss = functional.smooth_l1_loss(planned, (label - network.plan_mean) / network.plan_std)
    with torch.no_grad():
        wanted = tracker.network(assemble(body, last_action, label))
    done = tracker.network(assemble(body, last_action, planned * network.plan_std + network.plan_mean))
    loss = loss + action_weight * functional.smooth_l1_loss(done, wanted)
    if len(network.style_mean):
        seats, styles = episodes.first_looks()
        loss = loss + functional.mse_loss(network.chooser(seats), styles)
    optimizer.zero_grad()
    loss.backward()
    nn.utils.clip_grad_norm_(network.parameters(), 1.0)
    optimizer.step()
    return float(loss.detach())
