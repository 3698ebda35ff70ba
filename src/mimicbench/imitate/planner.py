"""A planner over the tracker, learned by DAgger: HIT's two stages in closed loop.

The planner sees the robot's own body, a clock, and the seat as it was seen in the first elevation map, carried along by
odometry. It says what the tracker needs to be told: its reference one and five frames ahead, relative to the body. The
tracker turns that into joint targets. While learning, the label is the clip's own next frames at the same time index,
seen from wherever the robot has got to; who drives changes from the tracker on true references to the planner itself.
"""

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
import torch
from torch import nn
from torch.nn import functional

from mimicbench.core import rotations as rot
from mimicbench.core.checkpoint import load_checkpoint, save_checkpoint
from mimicbench.core.errors import MimicbenchError
from mimicbench.core.motion import RobotMotion
from mimicbench.core.seeds import digest
from mimicbench.imitate.clock import SIZE as CLOCK_SIZE
from mimicbench.imitate.clock import clock_features
from mimicbench.imitate.perception import MEMORY_SIZE, SEAT_SIZE, Perception, SeatMemory, disturb_seat, load_perception, seat_in_root, seat_memory, seat_of
from mimicbench.imitate.policy import Senses, look_again, look_first
from mimicbench.imitate.resume import resume_training, save_training
from mimicbench.objects.shape import SceneObject
from mimicbench.robot.description import Robot
from mimicbench.sense.proprioception import body_state
from mimicbench.sim.scene import CONTROL_DT
from mimicbench.track.checkpoint import Tracker, load_tracker
from mimicbench.track.env import TrackingConfig, TrackingEnv
from mimicbench.track.residual import LOOKAHEAD, RESIDUAL, assemble, plan_observation, planned_joint_pos, residual_target
from mimicbench.track.tracker import Moment


@dataclass(frozen=True)
class PlannerConfig:
    """The planner's network and its training."""

    hidden: tuple[int, ...] = (512, 512, 256)
    """Widths of the hidden layers."""
    samples: int = 2_400_000
    """Control steps to see, over all robots."""
    num_envs: int = 256
    """Robots side by side."""
    steps: int = 24
    """Control steps between rounds of learning."""
    batches: int = 40
    """Batches per round."""
    batch: int = 768
    """Frames per batch."""
    memory: int = 400_000
    """Most recent frames that are learned from."""
    teacher_share: float = 0.2
    """Part of the training over which the tracker on true references drives ever less."""
    action_weight: float = 0.5
    """Weight of the difference that the plan makes to the tracker's action."""
    learning_rate: float = 1e-3
    """Of Adam at the start; falls to a tenth along a cosine."""
    save_every: float = 120.0
    """Seconds between saves: what a kill can lose at most."""
    threads: int = 2
    """Threads of the network's arithmetic. Sums round differently with another number, so it is part of the result."""
    tracking: TrackingConfig = field(default_factory=lambda: TrackingConfig(first_frame=0.5, push=0.2, max_pos_error=0.5, max_angle_error=1.0, max_drop=0.25))
    """Starts, disturbances and ends of training episodes. Pushed no harder than what the tracker survives: who falls teaches nothing."""


class PlannerNetwork(nn.Module):
    """Body, clock and memory -> plan. Inputs and outputs are normalized inside."""

    def __init__(self, inputs: int, outputs: int, hidden: tuple[int, ...]) -> None:
        super().__init__()
        self.input_mean: torch.Tensor
        self.input_std: torch.Tensor
        self.plan_mean: torch.Tensor
        self.plan_std: torch.Tensor
        for name, size in (("input", inputs), ("plan", outputs)):
            self.register_buffer(f"{name}_mean", torch.zeros(size))
            self.register_buffer(f"{name}_std", torch.ones(size))
        layers: list[nn.Module] = []
        width = inputs
        for size in hidden:
            layers += [nn.Linear(width, size), nn.ELU()]
            width = size
        self.layers = nn.Sequential(*layers, nn.Linear(width, outputs))

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        """(N, outputs) normalized plan."""
        return self.layers(((inputs - self.input_mean) / self.input_std).clamp(-10, 10))

    def plan(self, inputs: torch.Tensor) -> torch.Tensor:
        """(N, outputs) plan in the tracker's units."""
        return self(inputs) * self.plan_std + self.plan_mean


def planner_inputs(body: torch.Tensor, seconds: torch.Tensor, memory: torch.Tensor) -> torch.Tensor:
    """(N, 48 + 13 + 10 for the H1) what the planner sees."""
    return torch.cat([body, clock_features(seconds), memory], -1)


def plan_size(joints: int) -> int:
    """Numbers of a plan."""
    return len(LOOKAHEAD) * (12 + 2 * joints)


class _Episodes:
    """For each training robot: where its clip starts, and the seat as it would be perceived from there."""

    def __init__(self, env: TrackingEnv, objects: Mapping[str, SceneObject], seed: int) -> None:
        self._env = env
        clips = torch.arange(len(env.bank))
        first = env.bank.frame(clips, torch.zeros_like(clips))
        self._start_pos, self._start_yaw = first.root_pos_w[:, :2], rot.yaw_of(first.root_quat_w)
        seats = torch.tensor(np.array([seat_of(objects[object_id]) for object_id in env.bank.object_ids]), dtype=torch.float32)
        self._seats = seat_in_root(seats, first.root_pos_w, self._start_yaw)
        self._generator = torch.Generator().manual_seed(digest(seed, "planner", "seat noise") % (1 << 63))
        self._seen = torch.zeros(env.num_envs, SEAT_SIZE)
        self.begin(torch.arange(env.num_envs))

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
        return planner_inputs(body_state(state), env.index * CONTROL_DT, memory)


def tracker_action(tracker: Tracker, moment: Moment, plan: torch.Tensor) -> torch.Tensor:
    """(N, J) the tracker's action on a plan (N, P)."""
    return tracker.network(assemble(body_state(moment.state), moment.last_action, plan))


def train_planner(
    folder: Path, robot: Robot, tracker: Tracker, motions: Sequence[RobotMotion], objects: Mapping[str, SceneObject],
    config: PlannerConfig, seed: int, workers: int = 0, report: Callable[[dict], None] | None = None,
) -> PlannerNetwork:  # fmt: skip
    """Learn a planner over `tracker` by DAgger on `motions`.

    Training state goes to `<folder>/training.*` and `<folder>/metrics.jsonl`; a killed training goes on from there.
    """
    if tracker.kind is not RESIDUAL:
        raise MimicbenchError(f"the planner needs a tracker of preset 'improved', not {tracker.kind.name!r}")
    torch.manual_seed(digest(seed, "planner") % (1 << 63))
    torch.set_num_threads(config.threads)
    env = TrackingEnv(RESIDUAL, robot, motions, objects, config.num_envs, config.tracking, seed, workers)
    episodes = _Episodes(env, objects, seed)
    joints = len(robot.joints)
    network = PlannerNetwork(episodes.inputs().shape[1], plan_size(joints), config.hidden)
    optimizer = torch.optim.Adam(network.parameters(), lr=config.learning_rate)
    progress = resume_training(folder, network, optimizer, {"round": 0, "samples": 0, "seconds": 0.0})
    store = _Store(config.memory, network.input_mean.numel(), joints, plan_size(joints))
    rounds = config.samples // (config.num_envs * config.steps)
    teacher = torch.rand(config.num_envs) < _teacher_share(progress["round"] / rounds, config)
    now = saved = time.monotonic()
    while progress["round"] < rounds:
        part = progress["round"] / rounds
        failures, endings = _collect(env, episodes, tracker, network, store, teacher, _teacher_share(part, config), config.steps)
        if progress["round"] == 0:
            store.statistics(network)
        for group in optimizer.param_groups:
            group["lr"] = config.learning_rate * (0.55 + 0.45 * np.cos(np.pi * part))
        losses = [_learn(network, optimizer, tracker, store.draw(config.batch), config.action_weight) for _ in range(config.batches)]
        progress["round"] += 1
        progress["samples"] += config.num_envs * config.steps
        progress["seconds"] += time.monotonic() - now
        now = time.monotonic()
        if progress["round"] % 10 == 0 and report:
            report({**progress, "loss": float(np.mean(losses)), "failed": failures / max(endings, 1)})
        if now - saved > config.save_every or progress["round"] == rounds:
            save_training(folder, network, optimizer, progress)
            row = {**progress, "loss": float(np.mean(losses)), "failed": failures / max(endings, 1), "teacher_share": _teacher_share(part, config)}
            with open(folder / "metrics.jsonl", "a") as stream:
                stream.write(json.dumps(row) + "\n")
            saved = time.monotonic()
    return network.eval()


def _teacher_share(part: float, config: PlannerConfig) -> float:
    return max(0.0, 1.0 - part / config.teacher_share)


@torch.no_grad()
def _collect(
    env: TrackingEnv, episodes: _Episodes, tracker: Tracker, network: PlannerNetwork, store: "_Store", teacher: torch.Tensor, share: float, steps: int
) -> tuple[int, int]:
    """Let tracker or planner drive for some steps and remember what each robot should have planned. Returns failures and endings of planner episodes."""
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
            teacher[ids] = torch.rand(len(ids)) < share
            episodes.begin(ids)
    return failures, endings


class _Store:
    """The most recent frames: inputs, last action, label."""

    def __init__(self, size: int, inputs: int, actions: int, plan: int) -> None:
        self._rows = torch.zeros(size, inputs + actions + plan)
        self._widths = [inputs, actions, plan]
        self._next = self.filled = 0

    def add(self, inputs: torch.Tensor, last_action: torch.Tensor, label: torch.Tensor) -> None:
        rows = torch.cat([inputs, last_action, label], -1)
        at = (self._next + torch.arange(len(rows))) % len(self._rows)
        self._rows[at] = rows
        self._next = (self._next + len(rows)) % len(self._rows)
        self.filled = min(self.filled + len(rows), len(self._rows))

    def draw(self, count: int) -> tuple[torch.Tensor, ...]:
        """`count` frames at random: inputs, last action, label."""
        return self._rows[torch.randint(self.filled, (count,))].split(self._widths, -1)

    def statistics(self, network: PlannerNetwork) -> None:
        """Set the network's normalization from what is stored."""
        inputs, _, label = self._rows[: self.filled].split(self._widths, -1)
        # the first frames are the teacher's, close to its clips: a plan is to be precise to centimeters and hundredths of a
        # radian, but a robot that has got off its clip must not outweigh all others
        for name, values, least in (("input", inputs, 0.05), ("plan", label, 0.1)):
            getattr(network, f"{name}_mean").copy_(values.mean(0))
            getattr(network, f"{name}_std").copy_(values.std(0).clamp(min=least))


def _learn(network: PlannerNetwork, optimizer: torch.optim.Optimizer, tracker: Tracker, frames: tuple[torch.Tensor, ...], action_weight: float) -> float:
    """One step: smooth L1 between the normalized plans, and the difference that the plan makes to the tracker's action."""
    inputs, last_action, label = frames
    body = inputs[:, : inputs.shape[1] - CLOCK_SIZE - MEMORY_SIZE]
    planned = network(inputs)
    loss = functional.smooth_l1_loss(planned, (label - network.plan_mean) / network.plan_std)
    with torch.no_grad():
        wanted = tracker.network(assemble(body, last_action, label))
    done = tracker.network(assemble(body, last_action, planned * network.plan_std + network.plan_mean))
    loss = loss + action_weight * functional.smooth_l1_loss(done, wanted)
    optimizer.zero_grad()
    loss.backward()
    nn.utils.clip_grad_norm_(network.parameters(), 1.0)
    optimizer.step()
    return float(loss.detach())


class PlannerPolicy:
    """The planner in closed loop: looks, remembers, looks again while unsure, plans every frame, and the tracker follows."""

    gains = RESIDUAL.gains
    eyes: Literal["cameras", "rays"] = "cameras"

    def __init__(self, robot: Robot, network: PlannerNetwork, tracker: Tracker, perception: Perception) -> None:
        self._robot, self._network, self._tracker = robot, network, tracker
        self._memory = SeatMemory(perception, 0)
        self._last_action = torch.zeros(0, len(robot.joints))

    @torch.no_grad()
    def reset(self, ids: torch.Tensor, senses: Senses) -> None:
        """Look at the first map and remember the seat."""
        if len(self._last_action) != len(senses.time):
            self._memory = SeatMemory(self._memory.perception, len(senses.time))
            self._last_action = torch.zeros(len(senses.time), len(self._robot.joints))
        look_first(self._memory, ids, senses)
        self._last_action[ids] = 0.0

    @torch.no_grad()
    def act(self, senses: Senses) -> torch.Tensor:
        """Joint position targets (N, J) [rad]."""
        look_again(self._memory, senses)
        memory = self._memory.recall(senses.odometry_pos, senses.odometry_yaw)
        plan = self._network.plan(planner_inputs(senses.proprio, senses.time, memory))
        action = self._tracker.network(assemble(senses.proprio, self._last_action, plan))
        self._last_action = action
        joints = len(self._robot.joints)
        joint_pos = senses.proprio[:, -2 * joints : -joints]
        return residual_target(self._robot, planned_joint_pos(plan, joint_pos), action)


def save_planner(folder: Path, robot: Robot, network: PlannerNetwork, config: PlannerConfig, notes: Mapping[str, object]) -> None:
    """Write the planner's own network; its tracker and perception are in folders beside it."""
    save_checkpoint(folder, "planner", robot.name, config, {name: value.numpy() for name, value in network.state_dict().items()}, notes)


def load_planner(folder: Path, robot: Robot) -> PlannerPolicy:
    """Read a planner with the `tracker` and the `perception` in the folders beside it. Raises BadCheckpoint."""
    checkpoint = load_checkpoint(folder, "planner", robot.name)
    config = checkpoint.config_as(PlannerConfig)
    tracker, perception = load_tracker(folder.parent / "tracker", robot), load_perception(folder.parent / "perception", robot.name)
    joints = len(robot.joints)
    network = PlannerNetwork(10 + 2 * joints + CLOCK_SIZE + MEMORY_SIZE, plan_size(joints), config.hidden)
    arrays = checkpoint.matching({name: tuple(value.shape) for name, value in network.state_dict().items()})
    network.load_state_dict({name: torch.from_numpy(array.copy()) for name, array in arrays.items()})
    return PlannerPolicy(robot, network.eval(), tracker, perception)
