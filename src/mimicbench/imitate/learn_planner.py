"""Learning the planner by DAgger: tracker or planner drives, and the clip says what should have been planned."""

import time
from collections.abc import Callable, Mapping
from dataclasses import asdict
from pathlib import Path

import msgspec
import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from mimicbench.core import rotations as rot
from mimicbench.core.errors import MimicbenchError
from mimicbench.core.seeds import digest
from mimicbench.core.training import (
    NetworkState,
    OptimizerState,
    TorchRandom,
    append_metrics,
    resume_training,
    save_training,
)
from mimicbench.envs.clips import ClipSet
from mimicbench.envs.vec_env import EnvConfig
from mimicbench.imitate.clock import SIZE as CLOCK_SIZE
from mimicbench.imitate.perception import MEMORY_SIZE, SEAT_SIZE, disturb_seat, seat_in_root, seat_memory, seat_of
from mimicbench.imitate.planner import PlannerConfig, PlannerNetwork, plan_terms, planner_inputs, styles_of
from mimicbench.sim.scene import CONTROL_DT
from mimicbench.track.spec import Tracker, flat, sizes
from mimicbench.track.tracking import TrackingEnv


class _Episodes:
    """For each training robot: where its clip starts, and the seat as it would be perceived from there."""

    def __init__(self, env: TrackingEnv, styles: Tensor, seed: int) -> None:
        """`styles` (C, S) are the clips', normalized."""
        self._env, self._styles, device = env, styles, env.device
        clips = torch.arange(len(env.bank), device=device)
        first = env.bank.frame(clips, torch.zeros_like(clips))
        self._start_pos, self._start_yaw = first.root_pos_w[:, :2], rot.yaw_of(first.root_quat_w)
        seats = torch.tensor(np.array([seat_of(obj) for obj in env.clips.scenes]), dtype=torch.float32, device=device)
        self._seats = seat_in_root(seats, first.root_pos_w, self._start_yaw)
        self._generator = torch.Generator(device).manual_seed(digest(seed, "planner", "seat noise") % (1 << 63))
        self._seen = torch.zeros(env.num_envs, SEAT_SIZE, device=device)
        self.begin(torch.arange(env.num_envs, device=device))

    def begin(self, ids: Tensor) -> None:
        """Robots `ids` begin anew: each perceives its seat, with the errors that perception makes, once an episode."""
        self._seen[ids] = disturb_seat(self._seats[self._env.env.clip[ids]], self._generator)

    def inputs(self) -> Tensor:
        """(N, I) what the planner sees now."""
        env, context = self._env.env, self._env.context
        state, start, yaw = context.state, self._start_pos[env.clip], self._start_yaw[env.clip]
        cos, sin = torch.cos(yaw), torch.sin(yaw)
        dx, dy = (state.root_pos_w[:, :2] - start).unbind(-1)
        moved = torch.stack([cos * dx + sin * dy, cos * dy - sin * dx], -1)
        memory = seat_memory(self._seen, moved, rot.wrap_angle(rot.yaw_of(state.root_quat_w) - yaw))
        body = self._env.terms()["proprio"]
        return planner_inputs(body, env.index * CONTROL_DT, memory, self._styles[env.clip])

    def first_looks(self) -> tuple[Tensor, Tensor]:
        """(N, 6) the seats as first seen, and (N, S) the normalized styles of the clips that began so."""
        return self._seen, self._styles[self._env.env.clip]

    def state_tensors(self) -> dict[str, Tensor]:
        """What was perceived, and the random numbers to come."""
        return {"seen": self._seen.clone(), "random": self._generator.get_state()}

    def load_state_tensors(self, tensors: Mapping[str, Tensor]) -> None:
        """The inverse of `state_tensors`."""
        self._seen.copy_(tensors["seen"])
        self._generator.set_state(tensors["random"].cpu())


class _Drivers:
    """Who drives each robot: the tracker on true references, or the planner."""

    def __init__(self, count: int, device: str) -> None:
        self.teacher = torch.zeros(count, dtype=torch.bool, device=device)
        """(N,) whether it is the tracker on true references."""

    def draw(self, ids: Tensor, share: float) -> None:
        """Robots `ids` begin anew; the teacher drives a share of them."""
        self.teacher[ids] = (torch.rand(len(ids)) < share).to(self.teacher.device)

    def state_tensors(self) -> dict[str, Tensor]:
        """Who drives now."""
        return {"teacher": self.teacher.clone()}

    def load_state_tensors(self, tensors: Mapping[str, Tensor]) -> None:
        """The inverse of `state_tensors`."""
        self.teacher.copy_(tensors["teacher"])


def train_planner(
    folder: Path,
    tracker: Tracker,
    clips: ClipSet,
    config: PlannerConfig,
    seed: int,
    env_config: EnvConfig | None = None,
    report: Callable[[dict], None] | None = None,
) -> PlannerNetwork:
    """Learn a planner over `tracker` by DAgger on `clips`.

    Training state goes to `<folder>/training.safetensors`, progress to `<folder>/metrics.jsonl`; a killed training goes
    on from there to the same bytes. The networks move to where the tensors of physics on the device live.
    """
    for name in tracker.observed:
        if name not in (*tracker.spec.plan(clips.task), "proprio", "last_action"):
            raise MimicbenchError(
                f"tracker {tracker.spec.name} observes {name!r}, which this planner does not keep of a robot; plan "
                "over one that observes proprio, last_action and its reference"
            )
    torch.manual_seed(digest(seed, "planner") % (1 << 63))
    torch.set_num_threads(config.threads)
    env = TrackingEnv(tracker.spec, clips, config.num_envs, config.tracking, seed, env_config)
    device, joints = env.device, len(clips.robot.joints)
    plan_size = sum(sizes(tracker.spec.plan(clips.task), clips.robot, clips.task))
    _, styles = styles_of(clips.motions)
    network = PlannerNetwork(joints, plan_size, styles.shape[1], config.hidden)
    network.set_styles(styles)
    network.to(device)
    tracker.network.to(device)
    episodes = _Episodes(env, network.normalized_style(styles.to(device)), seed)
    optimizer = torch.optim.Adam(network.parameters(), lr=config.learning_rate)
    store = _Store(config.memory, [network.input_mean.numel(), joints, plan_size], device)
    drivers = _Drivers(config.num_envs, device)
    drivers.draw(torch.arange(config.num_envs, device=device), 1.0)
    parts = {"env": env, "episodes": episodes, "store": store, "drivers": drivers, "network": NetworkState(network)}
    parts |= {"optimizer": OptimizerState(optimizer), "torch": TorchRandom(device)}
    plain = msgspec.to_builtins(asdict(config))
    identity = {"config": {name: value for name, value in plain.items() if name != "save_every"}, "seed": seed}
    identity["clips"] = [motion.id for motion in clips.motions]
    progress = resume_training(folder, identity, parts, {"round": 0, "samples": 0, "seconds": 0.0})
    rounds = config.samples // (config.num_envs * config.steps)
    now = saved = time.monotonic()
    while progress["round"] < rounds:
        part = progress["round"] / rounds
        share = _teacher_share(part, config)
        failures, endings = _collect(env, episodes, tracker, network, store, drivers, share, config.steps)
        if progress["round"] == 0:
            store.statistics(network)
        for group in optimizer.param_groups:
            group["lr"] = config.learning_rate * (0.55 + 0.45 * np.cos(np.pi * part))
        losses = [
            _learn(network, optimizer, tracker, store.draw(config.batch), episodes, env, config.action_weight)
            for _ in range(config.batches)
        ]
        progress["round"] += 1
        progress["samples"] += config.num_envs * config.steps
        progress["seconds"] += time.monotonic() - now
        now, finished = time.monotonic(), progress["round"] == rounds
        row = {**progress, "loss": float(np.mean(losses)), "failed": failures / max(endings, 1), "teacher_share": share}
        if progress["round"] % 10 == 0 or finished:
            append_metrics(folder, row)
        if report:
            report(row)
        if now - saved > config.save_every or finished:
            save_training(folder, identity, parts, progress)
            saved = time.monotonic()
    env.env.close()
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
    drivers: _Drivers,
    share: float,
    steps: int,
) -> tuple[int, int]:
    """Let tracker or planner drive for some steps and remember what each robot should have planned.

    Returns failures and endings of planner episodes.
    """
    failures = endings = 0
    robot, task, plan_names = env.clips.robot, env.clips.task, tracker.spec.plan(env.clips.task)
    for _ in range(steps):
        terms, inputs = env.terms(), episodes.inputs()
        label = flat(terms, plan_names)
        store.add(inputs, env.context.last_action, label)
        plan = torch.where(drivers.teacher[:, None], label, network.plan(inputs))
        planned = {**dict(terms), **plan_terms(tracker, plan, robot, task)}
        action = tracker.action(planned)
        target = tracker.target(robot, planned, action)
        _, _, done, time_out = env.step(action, tracker.settings, target)
        if done.any():
            ids, teacher = done.nonzero()[:, 0], drivers.teacher
            endings += int((~teacher[ids]).sum())
            failures += int((~teacher[ids] & ~time_out[ids]).sum())
            drivers.draw(ids, share)
            episodes.begin(ids)
    return failures, endings


class _Store:
    """The most recent frames: inputs, last action, label."""

    def __init__(self, size: int, widths: list[int], device: str) -> None:
        self._rows = torch.zeros(size, sum(widths), device=device)
        self._widths = widths
        self._next = self.filled = 0

    def add(self, inputs: Tensor, last_action: Tensor, label: Tensor) -> None:
        rows = torch.cat([inputs, last_action, label], -1)
        at = (self._next + torch.arange(len(rows), device=rows.device)) % len(self._rows)
        self._rows[at] = rows
        self._next = (self._next + len(rows)) % len(self._rows)
        self.filled = min(self.filled + len(rows), len(self._rows))

    def draw(self, count: int) -> tuple[Tensor, ...]:
        """`count` frames at random: inputs, last action, label."""
        return self._rows[torch.randint(self.filled, (count,)).to(self._rows.device)].split(self._widths, -1)

    def statistics(self, network: PlannerNetwork) -> None:
        """Set the network's normalization from what is stored."""
        inputs, _, label = self._rows[: self.filled].split(self._widths, -1)
        # the first frames are the teacher's, close to its clips: a plan is to be precise to centimeters and hundredths
        # of a radian, but a robot that has got off its clip must not outweigh all others
        for name, values, least in (("input", inputs, 0.05), ("plan", label, 0.1)):
            getattr(network, f"{name}_mean").copy_(values.mean(0))
            getattr(network, f"{name}_std").copy_(values.std(0).clamp(min=least))

    def state_tensors(self) -> dict[str, Tensor]:
        """The frames, and where the next one goes."""
        return {"rows": self._rows[: self.filled].clone(), "next": torch.tensor(self._next)}

    def load_state_tensors(self, tensors: Mapping[str, Tensor]) -> None:
        """The inverse of `state_tensors`."""
        self.filled, self._next = len(tensors["rows"]), int(tensors["next"])
        self._rows[: self.filled] = tensors["rows"].to(self._rows.device)


def _learn(
    network: PlannerNetwork,
    optimizer: torch.optim.Optimizer,
    tracker: Tracker,
    frames: tuple[Tensor, ...],
    episodes: _Episodes,
    env: TrackingEnv,
    action_weight: float,
) -> float:
    """One step: smooth L1 between the normalized plans, the difference that the plan makes to the tracker's action.

    And the chooser's error.
    """
    inputs, last_action, label = frames
    body = {"proprio": inputs[:, : inputs.shape[1] - CLOCK_SIZE - MEMORY_SIZE - len(network.style_mean)]}
    body["last_action"] = last_action

    def act(plan: Tensor) -> Tensor:
        return tracker.action({**body, **plan_terms(tracker, plan, env.clips.robot, env.clips.task)})

    planned = network(inputs)
    loss = functional.smooth_l1_loss(planned, (label - network.plan_mean) / network.plan_std)
    with torch.no_grad():
        wanted = act(label)
    done = act(planned * network.plan_std + network.plan_mean)
    loss = loss + action_weight * functional.smooth_l1_loss(done, wanted)
    if len(network.style_mean):
        seats, styles = episodes.first_looks()
        loss = loss + functional.mse_loss(network.chooser(seats), styles)
    optimizer.zero_grad()
    loss.backward()
    nn.utils.clip_grad_norm_(network.parameters(), 1.0)
    optimizer.step()
    return float(loss.detach())
