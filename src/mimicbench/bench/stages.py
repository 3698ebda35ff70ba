"""How fast the parts are, each as a ratio to a baseline measured in the same run where there is one."""

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

import numpy as np
import torch

from mimicbench.envs.clips import ClipSet
from mimicbench.envs.vec_env import EnvConfig
from mimicbench.objects.registry import FAMILIES
from mimicbench.references.synthesis.registry import synthesize
from mimicbench.retarget.baselines.speed import frames_per_second
from mimicbench.retarget.clip import Clip
from mimicbench.retarget.registry import DEFAULT_METHOD, METHODS
from mimicbench.robots.description import Robot
from mimicbench.sim.backends import check_device
from mimicbench.tasks.task import Task
from mimicbench.track.learning.ppo_config import PPOConfig, ppo_learner
from mimicbench.track.network import MLPConfig
from mimicbench.track.registry import TRACKERS
from mimicbench.track.settings import TrackConfig, TrackingConfig
from mimicbench.track.tracking import TrackingEnv

if TYPE_CHECKING:
    from mimicbench.track.learning.ppo import PPOLearner

CLIPS = 24
NUM_ENVS = 512
"""Robots side by side by default; a GPU is not filled by them."""


@dataclass(frozen=True)
class BenchResult:
    """Figures of one machine in one run."""

    synthesis_ms: float
    """One human clip, one core [ms]."""
    retarget_fps: float
    """Frames retargeted per second on one core."""
    bare_steps: float
    """Control steps per second of bare stepping (`Physics.advance`) of the tracking scenes."""
    env_steps: float
    """Control steps per second of the tracking environment: observations, rewards, restarts."""
    env_ratio: float
    """env_steps / bare_steps."""
    train_samples: float
    """Samples per second of the whole training: environment, exploration, updates."""


def bench(
    robot: Robot,
    task: Task,
    workers: int,
    seconds: float,
    say: Callable[[str], None],
    device: str = "cpu",
    num_envs: int = NUM_ENVS,
) -> dict[str, float]:
    """Measure everything, the loop with `num_envs` robots; each part runs for about `seconds`."""
    check_device(device)
    objects = [FAMILIES.get(task.family).make(index, 0) for index in range(CLIPS)]
    started = time.perf_counter()
    humans = [synthesize(task.name, index, obj, 0) for index, obj in enumerate(objects)]
    synthesis = (time.perf_counter() - started) / CLIPS
    say(f"one clip synthesized in {1e3 * synthesis:.0f} ms")
    method, clips = (
        METHODS.get(DEFAULT_METHOD),
        [Clip(human, obj, robot) for human, obj in zip(humans, objects, strict=True)],
    )
    retarget = frames_per_second(clips[: max(2, CLIPS // 4)], method)
    say(f"{retarget:.0f} frames retargeted per second and core")
    motions = [method.retarget(clip, "improved") for clip in clips]
    spec = TRACKERS.get(TrackConfig().tracker)
    settings = TrackConfig().resolved().settings
    clip_set = ClipSet(task, robot, motions, {obj.id: obj for obj in objects})
    env = TrackingEnv(spec, clip_set, num_envs, TrackingConfig(), 0, EnvConfig(device=device, workers=workers))
    network = env.layout.blueprint(MLPConfig(PPOConfig().hidden))
    learner = ppo_learner()(network, len(robot.joints), num_envs, PPOConfig(), env.device)
    train = _rate(lambda: _train(env, learner, settings), num_envs * PPOConfig().steps, seconds)
    say(f"training: {train:.0f} samples per second")
    # environment and bare physics take turns, so that both meet the same machine
    rates = [
        (
            _rate(lambda: _steps(env, settings), num_envs * 8, seconds / 4),
            _rate(lambda: _bare(env), num_envs * 8, seconds / 4),
        )
        for _ in range(4)
    ]
    env_steps, bare_steps = (float(np.median(column)) for column in zip(*rates, strict=True))
    ratio = float(np.median([a / b for a, b in rates]))
    say(f"environment: {env_steps:.0f} of bare physics' {bare_steps:.0f} control steps per second, {ratio:.0%}")
    return asdict(BenchResult(1e3 * synthesis, retarget, bare_steps, env_steps, ratio, train))


def _rate(work: Callable[[], None], amount: int, seconds: float) -> float:
    """Amount per second of `work`, after one round to warm up."""
    work()
    rounds, started = 0, time.perf_counter()
    while time.perf_counter() - started < seconds:
        work()
        rounds += 1
    return amount * rounds / (time.perf_counter() - started)


def _train(env: TrackingEnv, learner: "PPOLearner", settings: object) -> None:
    obs = env.observe()
    for _ in range(PPOConfig().steps):
        obs, reward, done, time_out = env.step(learner.act(obs), settings)
        learner.record(obs, reward, done, time_out)
    learner.update(obs)


def _steps(env: TrackingEnv, settings: object) -> None:
    action = torch.zeros(env.num_envs, len(env.clips.robot.joints), device=env.device)
    for _ in range(8):
        env.step(action, settings)
    if env.device != "cpu":  # where steps have only been asked for until somebody waits
        torch.cuda.synchronize(env.device)


def _bare(env: TrackingEnv) -> None:
    target = env.context.reference(0).joint_pos
    for _ in range(8):
        env.env.physics.advance(target)
