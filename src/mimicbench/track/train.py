"""Train a tracker: collect, update, look at how it does from the first frame, keep checkpoints, go on where it
stopped.
"""

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import safetensors.numpy
import torch

from mimicbench.core.checkpoint import read_tensors
from mimicbench.core.files import read_json, write_atomic, write_json
from mimicbench.core.motion import RobotMotion
from mimicbench.core.seeds import digest
from mimicbench.objects.shape import SceneObject
from mimicbench.robots.description import Robot
from mimicbench.tasks.task import Task
from mimicbench.track.checkpoint import Tracker, TrackerConfig, save_tracker
from mimicbench.track.env import TrackingConfig, TrackingEnv
from mimicbench.track.network import TrackerNetwork
from mimicbench.track.ppo import PPOConfig, PPOLearner
from mimicbench.track.rollout import track_clips
from mimicbench.track.tracker import get_kind


@dataclass(frozen=True)
class TrackConfig:
    """A tracker's training."""

    preset: str = "improved"
    """`improved`, or `paper` for HST as the paper has it."""
    samples: int = 30_000_000
    """Control steps to learn from, over all robots."""
    num_envs: int = 1024
    """Robots side by side."""
    evaluate_every: float = 420.0
    """Seconds between evaluations from the first frame."""
    evaluate_clips: int = 64
    """Clips of an evaluation."""
    save_every: float = 120.0
    """Seconds between saves of the training state: what a kill can lose at most."""
    threads: int = 1
    """Threads of the network's arithmetic. Sums round differently with another number, so it is part of the result."""
    ppo: PPOConfig = field(default_factory=PPOConfig)
    tracking: TrackingConfig = field(default_factory=TrackingConfig)


def train_tracker(
    folder: Path,
    robot: Robot,
    task: Task,
    motions: Sequence[RobotMotion],
    held_out: Sequence[RobotMotion],
    objects: Mapping[str, SceneObject],
    config: TrackConfig,
    seed: int,
    workers: int = 0,
    report: Callable[[dict], None] | None = None,
    device: str = "cpu",
) -> Path:
    """Train on `motions`, evaluate on `held_out`, and write `<folder>/checkpoint`.

    Progress goes to `<folder>/metrics.jsonl`, one line per evaluation, and to `report`. A killed training goes on from
    its last save when called again. `device` computes the physics, and learns. Returns the checkpoint's folder.
    """
    torch.manual_seed(digest(seed, "tracker") % (1 << 63))
    torch.set_num_threads(config.threads)
    kind = get_kind(config.preset)
    env = TrackingEnv(kind, robot, motions, objects, config.num_envs, config.tracking, seed, workers, device)
    obs = env.observe()
    shape = TrackerConfig(config.preset, obs.shape[1], len(robot.joints), config.ppo.hidden)
    learner = PPOLearner(shape.observations, shape.actions, config.num_envs, config.ppo, env.device)
    progress = _resume(folder, learner)
    now = saved = evaluated = time.monotonic()
    recent: list[float] = []
    while progress["samples"] < config.samples:
        for _ in range(config.ppo.steps):
            env.disturb()
            action = learner.act(obs)
            obs, reward, done, time_out = env.step(action)
            learner.record(obs, reward, done, time_out)
            recent.append(float(reward.mean()))
        losses = learner.update(obs)
        progress["samples"] += config.num_envs * config.ppo.steps
        progress["iterations"] += 1
        progress["seconds"] += time.monotonic() - now
        now = time.monotonic()
        done_training = progress["samples"] >= config.samples
        if now - evaluated > config.evaluate_every or done_training:
            tracker = Tracker(kind, shape, TrackerNetwork(shape.observations, shape.actions, shape.hidden))
            tracker.network.load_tensors(learner.network_tensors())
            row = {**progress, **losses, "reward": sum(recent) / len(recent), "ended": dict(env.ended)}
            for name, clips in (("k_train", motions), ("k_held_out", held_out)):
                chosen = clips[:: max(1, len(clips) // config.evaluate_clips)][: config.evaluate_clips]
                rollout = (
                    track_clips(tracker, robot, task, chosen, objects, workers, go_on=False, device=device)
                    if chosen
                    else None
                )
                row[name] = None if rollout is None else float(rollout.judge.success.mean())
            _append(folder / "metrics.jsonl", row)
            if report:
                report(row)
            recent, env.ended = [], dict.fromkeys(env.ended, 0)
            evaluated = time.monotonic()
        if now - saved > config.save_every or done_training:
            _save(folder, learner, progress)
            save_tracker(
                folder / "checkpoint",
                robot,
                shape,
                learner.network_tensors(),
                {**progress, "seed": seed, "task": task.name},
            )
            saved = time.monotonic()
        now = time.monotonic()
    return folder / "checkpoint"


def _save(folder: Path, learner: PPOLearner, progress: Mapping[str, float]) -> None:
    data = safetensors.numpy.save(learner.state_tensors(), {"progress": json.dumps(dict(progress))})
    write_atomic(folder / "training.safetensors", lambda stream: stream.write(data))
    write_json(folder / "training.json", dict(progress))


def _resume(folder: Path, learner: PPOLearner) -> dict[str, float]:
    if not (folder / "training.json").exists():
        return {"samples": 0, "iterations": 0, "seconds": 0.0}
    learner.load_state_tensors(read_tensors(folder / "training.safetensors"))
    return read_json(folder / "training.json")


def _append(path: Path, row: Mapping[str, object]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path, "a") as stream:
        stream.write(json.dumps(row) + "\n")
