"""Train a tracker: collect, update, look at how it does from the first frame, save, go on where it stopped."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import accumulate
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import torch

from mimicbench.core.progress import Pulse
from mimicbench.core.seeds import digest
from mimicbench.core.settings import BadSetting, identity
from mimicbench.core.training import TorchRandom, append_metrics, check_losses, resume_training, save_training
from mimicbench.envs.clips import ClipSet
from mimicbench.envs.mirrored import with_mirror_images
from mimicbench.envs.vec_env import EnvConfig
from mimicbench.robots.description import Robot
from mimicbench.tasks.task import Task
from mimicbench.track.checkpoint import (
    TrackerConfig,
    build_tracker,
    load_critic,
    load_tracker,
    save_critic,
    save_tracker,
)
from mimicbench.track.evaluation import evaluated, good_enough, was_good_enough
from mimicbench.track.learning.distillation import Distiller, suitable, teachers_of
from mimicbench.track.learning.ppo_config import ppo_learner
from mimicbench.track.parts import TrackingParts
from mimicbench.track.registry import TRACKERS
from mimicbench.track.settings import TrackConfig
from mimicbench.track.tracker import Layout

if TYPE_CHECKING:
    from mimicbench.track.learning.ppo import PPOLearner

    Learner = PPOLearner | Distiller

Report = Callable[[dict[str, Any]], None]


def train_tracker(
    folder: Path,
    clips: Sequence[ClipSet],
    held_out: Sequence[ClipSet],
    config: TrackConfig,
    seed: int,
    env_config: EnvConfig | None = None,
    report: Report = lambda row: None,
    say: Callable[[str], None] = lambda line: None,
) -> Path:
    """Train on `clips`, one set for each task, evaluate on them and on `held_out`, and write `<folder>/checkpoint`.

    Progress goes to `<folder>/metrics.jsonl`, one line per evaluation, and to `report`; `say` hears of it every ten
    seconds. A killed training goes on from its last save when called again, to the same bytes as one that was not
    killed. Returns the checkpoint's folder.
    """
    config, env_config = config.resolved(), env_config or EnvConfig()
    clips = [with_mirror_images(some) for some in clips] if config.mirrored else clips
    torch.manual_seed(digest(seed, "tracker") % (1 << 63))
    torch.set_num_threads(1)
    spec, robot = TRACKERS.get(config.tracker), clips[0].robot
    robots = robots_of(config, len(clips))
    env = TrackingParts(spec, clips, robots, config.parts, config.tracking, seed, env_config, config.frames)
    shape = _shape(config, env.layout, len(robot.joints))
    learner = learner_of(config, shape, env, robot)
    parts = {"env": env, "ppo": learner, "torch": TorchRandom(env.device)}
    fresh = {"samples": 0, "iterations": 0, "seconds": 0.0, "reward": 0.0, "steps": 0}
    identity = {"config": _course(config), "seed": seed, "clips": [m.id for some in clips for m in some.motions]}
    progress = resume_training(folder, identity, parts, fresh)
    notes = {"seed": seed, "tasks": [some.task.name for some in clips]}
    saves = _Saves(folder, robot, shape, learner, identity, parts, notes)
    if progress["samples"]:  # it may have been killed between the state and the checkpoint
        saves.checkpoint(progress)
    obs = env.observe()
    pulse, now, saved = Pulse(say), time.monotonic(), time.monotonic()
    finished = progress["samples"] >= config.samples or was_good_enough(folder, progress, config.until)
    while not finished:
        alone = bool(config.begin_from) and progress["iterations"] < config.critic_first
        obs, total, failed, losses = _learn(env, learner, obs, config, alone)
        check_losses(losses, folder, progress["samples"])
        due = _count(progress, config, total)
        finished = progress["samples"] >= config.samples
        progress["seconds"] += time.monotonic() - now
        pulse(lambda sums=(total, failed): _so_far(progress, config, *sums))
        if finished or due:
            row: dict[str, Any] = {**progress, **losses, "reward": progress["reward"] / progress["steps"]}
            tracker = build_tracker(shape, learner.network_tensors())
            row |= evaluated(tracker, clips, held_out, config.evaluate_clips, env_config) | {"ended": _ended(env)}
            append_metrics(folder, row)
            report(row)
            progress["reward"] = progress["steps"] = 0
            finished |= good_enough(row, config.until)
        if finished or time.monotonic() - saved > config.save_every:
            saves.all(progress)
            saved = time.monotonic()
        now = time.monotonic()
    env.close()
    return folder / "checkpoint"


def check_given(config: TrackConfig, robot: Robot, tasks: Sequence[Task]) -> None:
    """Raise what a training would raise of the trackers that it begins or learns from, before clips are made for it."""
    config = config.resolved()
    spec = TRACKERS.get(config.tracker)
    for folder in config.teachers:
        suitable(folder, robot, spec, config.settings, Layout.of(spec, robot, tasks, config.frames))
    if config.begin_from:
        load_tracker(Path(config.begin_from), robot)


def learner_of(config: TrackConfig, shape: TrackerConfig, env: TrackingParts, robot: Robot) -> "Learner":
    """Who learns the tracker of that shape: by PPO, or from teachers. Raises MimicbenchError."""
    blueprint, spec = shape.blueprint(), TRACKERS.get(config.tracker)
    if config.teachers:
        tasks = dict.fromkeys(name for name, _ in env.places())
        folders = dict(zip(tasks, config.teachers, strict=True))
        teachers = teachers_of(folders, env.places(), robot, spec, config.settings, env.layout)
        taught = Distiller(blueprint, shape.actions, teachers, config.distill, env.device)
        if config.begin_from:
            taught.begin_from(load_tracker(Path(config.begin_from), robot).network.tensors())
        return taught
    learner = ppo_learner()(blueprint, shape.actions, config.num_envs, config.ppo, env.device)
    if config.begin_from:
        begin_from(Path(config.begin_from), robot, learner, env.layout, config.explore_anew)
    return learner


def _shape(config: TrackConfig, layout: Layout, joints: int) -> TrackerConfig:
    """What the trained tracker will be built from."""
    own = config.network is not None
    return TrackerConfig(
        config.tracker,
        layout.names,
        layout.widths,
        joints,
        () if own else config.ppo.hidden,
        _plain(config.settings),
        frames=layout.frames,
        network=_plain(config.network) if own else None,
    )


def _learn(
    env: TrackingParts, learner: "Learner", obs: torch.Tensor, config: TrackConfig, critic_alone: bool
) -> tuple[torch.Tensor, float, float, dict[str, float]]:
    """One round of collecting and updating: the observation after it, the sums over its steps of the mean reward and of
    the share of robots that failed, the losses.
    """
    total, failed = torch.zeros((), device=env.device), torch.zeros((), device=env.device)
    for _ in range(config.ppo.steps):
        obs, reward, done, time_out = env.step(learner.act(obs), config.settings)
        learner.record(obs, reward, done, time_out)
        total += reward.mean()
        failed += (done & ~time_out).float().mean()
    torch.set_num_threads(config.threads)
    losses = learner.update(obs, critic_alone)
    torch.set_num_threads(1)
    return obs, float(total), float(failed), losses


def _count(progress: dict[str, Any], config: TrackConfig, total: float) -> bool:
    """Add a round to the progress; whether an evaluation is due."""
    before = progress["samples"] // config.evaluate_every
    progress["samples"] += config.num_envs * config.ppo.steps
    progress["iterations"] += 1
    progress["reward"] += total
    progress["steps"] += config.ppo.steps
    return progress["samples"] // config.evaluate_every > before


@dataclass(frozen=True)
class _Saves:
    """Writes what a training needs to go on, and what others need to use it."""

    folder: Path
    robot: Robot
    shape: TrackerConfig
    learner: "Learner"
    identity: dict[str, Any]
    parts: dict[str, Any]
    notes: dict[str, Any]

    def checkpoint(self, progress: dict[str, Any]) -> None:
        """The network as it is now."""
        shape = replace(self.shape, deviation=self.learner.deviation)
        tensors, there = self.learner.network_tensors(), self.folder / "checkpoint"
        if critic := self.learner.critic_tensors():
            save_critic(there, self.robot, shape, critic)
        save_tracker(there, self.robot, shape, tensors, {**progress, **self.notes})

    def all(self, progress: dict[str, Any]) -> None:
        """The training's state, and the network."""
        save_training(self.folder, self.identity, self.parts, progress)
        self.checkpoint(progress)


def robots_of(config: TrackConfig, tasks: int) -> list[int]:
    """How many robots each task gets, by its share. Raises BadSetting if there is not a share for each."""
    shares = config.shares or (1.0,) * tasks
    if len(shares) != tasks:
        raise BadSetting(f"track.shares has {len(shares)} numbers for {tasks} tasks; give one for each, or none")
    ends = [round(config.num_envs * part / sum(shares)) for part in accumulate(shares)]
    return [end - start for start, end in zip([0, *ends], ends, strict=False)]


def begin_from(folder: Path, robot: Robot, learner: "PPOLearner", layout: Layout, anew: bool = False) -> None:
    """Take over what a tracker has learned, term by term, and its critic if it was kept; terms that it did not have
    begin without a say. Its deviations, too, unless `anew`. Raises MimicbenchError.
    """
    given, critic = load_tracker(folder, robot), load_critic(folder, robot)
    deviation = () if anew else given.deviation
    learner.begin_from(given.network.tensors(), layout.columns_of(given.layout), deviation, critic)


def _ended(env: TrackingParts) -> dict[str, dict[str, int]]:
    """How many episodes of each task ended for each reason since this was asked last."""
    return {task: dict(zip(env.ends, counts.tolist(), strict=True)) for task, counts in env.ended().items()}


def _so_far(progress: Mapping[str, float], config: TrackConfig, total: float, failed: float) -> str:
    """How far it is, and how the last round went. The reward alone would mislead: at first nobody has fallen yet."""
    done, rate = progress["samples"], progress["samples"] / max(progress["seconds"], 1e-9)
    told = f"{done / 1e6:6.2f} of {config.samples / 1e6:.2f} M samples  {rate:6.0f}/s  reward"
    return f"{told} {total / config.ppo.steps:.3f}  {1000 * failed / config.ppo.steps:.1f} failures per 1000 steps"


def _plain(settings: Any) -> dict[str, Any]:
    return {} if settings is None else msgspec.to_builtins(asdict(settings))


def _course(config: TrackConfig) -> dict[str, Any]:
    """What decides the course of a training; it may run longer, and be saved more or less often. What it began from may
    have been moved, and its teachers: the stage that it is part of knows these trackers themselves.
    """
    begun, taught = "given" if config.begin_from else "", ("given",) * len(config.teachers)
    plain = identity(replace(config, begin_from=begun, teachers=taught))
    return {name: value for name, value in plain.items() if name != "save_every"}
