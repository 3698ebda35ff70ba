"""Run a trained tracker over whole clips, from the first frame, and judge each by K and P."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import torch

from mimicbench.core.seeds import digest
from mimicbench.envs.clip_starts import ClipStarts
from mimicbench.envs.clips import ClipSet
from mimicbench.envs.disturbance import Disturbance
from mimicbench.envs.metrics import Verdict
from mimicbench.envs.reference import ReferenceBank
from mimicbench.envs.vec_env import EnvConfig, VecEnv
from mimicbench.sim.devices import tensor_device
from mimicbench.sim.rows import Rows
from mimicbench.sim.threads import one_torch_thread
from mimicbench.sim.timing import CONTROL_DT
from mimicbench.track.experts import ClipExpert, Expert
from mimicbench.track.tracker import Tracker

SETTLE = 1.0
"""[s] that an episode goes on, standing on the clip's last frame, after the clip is over."""


@dataclass(frozen=True)
class RolloutConfig:
    """How clips are tracked."""

    record: bool = False
    """Keep states and targets."""
    disturbance: Disturbance = Disturbance()
    """What is worse than the benchmark's world. With noise on the actions the recorded targets stay clean, so that they
    say how to recover."""
    seed: int = 0
    """Of the noise."""
    settle: float | None = SETTLE
    """[s] that episodes go on after their clip; None: to the time limit."""
    leave_fallen: bool = False
    """Leave robots that have fallen where they are, which is quicker: they have failed, or will not have stayed."""
    observe: tuple[str, ...] = ()
    """Keep these observations (sensors.observations), too, as they were before each action."""


@dataclass(frozen=True)
class Recording:
    """What happened in E episodes, each as long as it took."""

    qpos: list[np.ndarray] = field(default_factory=list)
    """Per episode, (T, nq) simulator positions at every control step."""
    qvel: list[np.ndarray] = field(default_factory=list)
    """Per episode, (T, nv)."""
    targets: list[np.ndarray] = field(default_factory=list)
    """Per episode, (T, J) joint targets that the expert chose [rad]."""
    applied: list[np.ndarray] = field(default_factory=list)
    """Per episode, (T, J) joint targets that were applied: with noise if there was any [rad]."""
    seen: Mapping[str, list[np.ndarray]] = field(default_factory=dict)
    """Per observation that was asked for and episode, (T, ...)."""


@dataclass(frozen=True)
class Rollout:
    """What came of C clips."""

    verdict: Verdict
    steps: np.ndarray
    """(C,) control steps that an episode may take: to the time limit, or as long after its clip as it may settle."""
    recording: Recording
    """Empty unless it was asked for."""
    last_qpos: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    """(C, nq) simulator positions before the last step of all."""
    start_distance: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """(C,) horizontal distance of the root from the object's rectangle in the first frame [m]."""
    end_distance: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """(C,) the same, wherever the object is then, when the episode was over for K and P."""


def track_clips(
    tracker: Tracker, clips: ClipSet, config: RolloutConfig | None = None, env_config: EnvConfig | None = None
) -> Rollout:
    """Track every clip from its first frame by the mean action.

    The tracker's network moves to where the tensors of physics on the device of `env_config` live.
    """
    return roll_out(ClipExpert(tracker, clips.robot), clips, config, env_config)


@torch.no_grad()
@one_torch_thread
def roll_out(
    expert: Expert, clips: ClipSet, config: RolloutConfig | None = None, env_config: EnvConfig | None = None
) -> Rollout:
    """What an expert makes of every clip's first frame, beside its object; see Expert."""
    config, env_config = config or RolloutConfig(), env_config or EnvConfig()
    seed = digest(config.seed, "action noise", *(motion.id for motion in clips.motions))
    env = at_their_beginning(expert, clips, config.disturbance, seed, env_config)
    limit = round(clips.task.time_limit / CONTROL_DT)
    assert env.bank is not None
    lengths = torch.full_like(env.bank.lengths, limit)
    if config.settle is not None:
        lengths = torch.clamp(env.bank.lengths + round(config.settle / CONTROL_DT), max=limit)
    assert env.metrics is not None
    rows: tuple[list[np.ndarray], ...] = tuple([] for _ in range(4 + len(config.observe)))
    last_qpos = env.physics.qpos().astype(np.float32)
    start_distance = env.root_distance()
    end_distance, running = start_distance, torch.ones_like(start_distance, dtype=torch.bool)
    for step in range(int(lengths.max())):
        active = step < lengths
        if config.leave_fallen:
            active &= ~(env.metrics.fell | env.metrics.diverged)
            if not active.any():
                break
        target, action = expert.says(env, env.observe(expert.observations))
        before = [array.astype(np.float32) for array in (env.physics.qpos(), env.physics.qvel())]
        last_qpos, shown = before[0], env.observe(config.observe)
        seen = [shown[name].cpu().numpy() for name in config.observe]
        env.step(target, action, active)
        end_distance = torch.where(running & active, env.root_distance(), end_distance)
        running = running & ~env.metrics.over()
        if config.record:
            taken = (*before, target.cpu().numpy(), env.applied.cpu().numpy(), *seen)
            for kept, values in zip(rows, taken, strict=True):
                kept.append(values)
    ends = lengths.cpu().numpy()
    recording = [
        [values[:length] for values, length in zip(np.stack(kept, 1), ends, strict=True)] if kept else []
        for kept in rows
    ]
    env.close()
    seen = dict(zip(config.observe, recording[4:], strict=True))
    kept = Recording(*recording[:4], seen=seen)
    distances = start_distance.cpu().numpy(), end_distance.cpu().numpy()
    return Rollout(env.metrics.verdict(), ends, kept, last_qpos, *distances)


def at_their_beginning(
    expert: Expert, clips: ClipSet, disturbance: Disturbance, seed: int, env_config: EnvConfig
) -> VecEnv:
    """Every clip at its first frame, in an environment with the gains of an expert, who begins there."""
    bank = ReferenceBank(clips.motions, clips.robot, tensor_device(env_config.device))
    physics = replace(env_config.physics, gains=expert.gains)
    config = disturbance.of(replace(env_config, physics=physics, judged=True, measure_effort=True))
    env = VecEnv(clips.task, clips.robot, clips.scenes, config, seed, bank, disturbance.hooks())
    everyone = torch.arange(len(clips), device=env.device)
    starts = ClipStarts(bank, env.physics.add_objects(clips.scenes), clips.robot)
    env.reset(Rows.every(len(clips), env.device), starts.at(everyone, torch.zeros_like(everyone)))
    expert.begin(env)
    return env
