"""Run a policy on the protocol's episodes: unseen objects, unseen starts, nothing but the robot's own senses."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import mujoco
import numpy as np
import torch

import mimicbench
from mimicbench.core.motion import RobotMotion
from mimicbench.core.seeds import digest
from mimicbench.envs.clips import ClipSet
from mimicbench.envs.initial_states import stacked, start_of
from mimicbench.envs.metrics import PHASES, Verdict
from mimicbench.envs.policy import Policy, refuse_privileged
from mimicbench.envs.vec_env import EnvConfig, VecEnv
from mimicbench.evaluate.guard import PATIENCE, Guard
from mimicbench.evaluate.rows import EpisodeRow
from mimicbench.sim.rows import Rows
from mimicbench.sim.timing import CONTROL_DT
from mimicbench.tasks.task import Task
from mimicbench.track.rollout import Rollout

SECOND = round(1 / CONTROL_DT)
"""Control steps in a second."""


@dataclass(frozen=True)
class Protocol:
    """How episodes run. The defaults are the benchmark's."""

    batch: int = 128
    """Episodes side by side. Part of the protocol: networks may round differently in batches of another size."""
    patience: float = PATIENCE
    """[s] that a policy may take for a decision, for all robots of a batch; ten times as long before their episodes."""


@dataclass(frozen=True)
class PolicyRun:
    """What a policy did on a list of episodes."""

    verdict: Verdict
    start_distance: np.ndarray
    """(E,) of the root from the object's rectangle [m]."""
    end_distance: np.ndarray
    """(E,) the same when the episode ended."""
    errors: dict[int, str] = field(default_factory=dict)
    """What the policy did wrong, of the episodes that failed by it."""
    recordings: dict[int, np.ndarray] = field(default_factory=dict)
    """(T, nq) simulator positions of the episodes that were recorded, at 32 bits."""


def run_policy(
    policy: Policy,
    clips: ClipSet,
    protocol: Protocol | None = None,
    record: Sequence[int] = (),
    tick: Callable[[int], None] | None = None,
    env_config: EnvConfig | None = None,
) -> list[PolicyRun]:
    """One episode from the first frame of each of `clips`, beside that clip's object, to the time limit.

    Everything else of the clips is withheld. Runs in batches of the protocol's size; returns one PolicyRun a batch.
    `tick(1)` is called whenever another second of a batch has been simulated. The policy's networks
    move to where the tensors of physics on the device of `env_config` live. Episodes in which the policy raises, gives
    targets that are none, or takes too long have failed, and `errors` says why; the others go on. Raises
    MimicbenchError if the policy observes what no robot can sense.
    """
    refuse_privileged(policy.observations, "this policy")
    protocol, env_config = protocol or Protocol(), env_config or EnvConfig()
    runs = []
    for number, part in enumerate(clips.batches(protocol.batch)):
        first = number * protocol.batch
        wanted = [episode - first for episode in record if first <= episode < first + len(part)]
        runs.append(_run_batch(policy, part, wanted, env_config, protocol.patience, tick or (lambda count: None)))
    return runs


@torch.no_grad()
def _run_batch(
    policy: Policy,
    clips: ClipSet,
    record: Sequence[int],
    env_config: EnvConfig,
    patience: float,
    tick: Callable[[int], None],
) -> PolicyRun:
    task, robot = clips.task, clips.robot
    config = replace(env_config, physics=replace(env_config.physics, gains=policy.gains))
    # what sensors err by, where they do, is other in every batch
    seed = digest(0, "sensors", *(motion.id for motion in clips.motions))
    env = VecEnv(task, robot, clips.scenes, config, seed)
    starts = [start_of(motion, clips.objects[motion.object_id], robot, task) for motion in clips.motions]
    env.reset(Rows.every(len(clips), env.device), stacked(starts, env.physics))
    assert env.metrics is not None
    start_distance = env.root_distance()
    end_distance, running = start_distance, torch.ones(len(clips), dtype=torch.bool, device=env.device)
    tracks: dict[int, list[np.ndarray]] = {
        episode: [env.physics.qpos()[episode].astype(np.float32)] for episode in record
    }
    guard = Guard(policy, env.context.state.joint_pos, patience)
    guard.to(env.device)
    for step in range(round(task.time_limit / CONTROL_DT)):
        obs = env.observe(policy.observations)
        if step == 0:
            guard.reset(torch.arange(len(clips), device=env.device), obs)
        target = guard.act(obs)
        if target is None:
            break
        env.step(target, running=guard.sound)
        # where the episode ends for the paper: K and P are judged there, though the robot goes on to the time limit
        end_distance = torch.where(running, env.root_distance(), end_distance)
        running = running & ~env.metrics.over()
        positions = env.physics.qpos() if tracks else ()
        for episode, track in tracks.items():
            track.append(positions[episode].astype(np.float32))
        if (step + 1) % SECOND == 0:
            tick(1)
    env.close()
    errors = guard.errors()
    found = _failed(env.metrics.verdict(), errors), start_distance.cpu().numpy(), end_distance.cpu().numpy()
    return PolicyRun(*found, errors, {episode: np.array(track) for episode, track in tracks.items()})


def _failed(verdict: Verdict, errors: Mapping[int, str]) -> Verdict:
    """What episodes came to: nothing that a policy's error ended was done."""
    done = torch.ones_like(verdict.success)
    done[list(errors)] = False
    return replace(
        verdict,
        success=verdict.success & done,
        success_at_end=verdict.success_at_end & done,
        stays=verdict.stays & done,
    )


@dataclass(frozen=True)
class Judged:
    """Who was judged, in which run."""

    stage: str
    """`track` for a tracker on its references, `imitate` for a policy."""
    policy: str
    preset: str
    seed: int


def policy_rows(runs: Sequence[PolicyRun], clips: ClipSet, who: Judged, first: int = 0) -> list[EpisodeRow]:
    """One row per episode of `run_policy`; the clips are those of these runs, numbered on from `first`."""
    rows = []
    for run in runs:
        for i, distances in enumerate(zip(run.start_distance.tolist(), run.end_distance.tolist(), strict=True)):
            row = _row(run.verdict, i, clips.motions[len(rows)], clips, who, distances)
            rows.append(replace(row, episode=first + len(rows), error=run.errors.get(i, "")))
    return rows


def tracker_rows(runs: Sequence[Rollout], clips: ClipSet, who: Judged, first: int = 0) -> list[EpisodeRow]:
    """One row per clip of `track.rollout.track_clips`, batch by batch; as `policy_rows`."""
    rows = []
    for run in runs:
        for i, distances in enumerate(zip(run.start_distance.tolist(), run.end_distance.tolist(), strict=True)):
            row = _row(run.verdict, i, clips.motions[len(rows)], clips, who, distances)
            rows.append(replace(row, episode=first + len(rows)))
    return rows


def _row(
    verdict: Verdict, i: int, motion: RobotMotion, clips: ClipSet, who: Judged, distances: tuple[float, float]
) -> EpisodeRow:
    obj, task = clips.objects[motion.object_id], clips.task
    success, fell, first = bool(verdict.success[i]), bool(verdict.fell[i]), float(verdict.first_success[i])
    return EpisodeRow(
        task=task.name,
        stage=who.stage,
        policy=who.policy,
        preset=who.preset,
        robot=clips.robot.name,
        seed=who.seed,
        episode=i,
        object_id=obj.id,
        object_kind=obj.kind,
        split=obj.split,
        reference_id=motion.id,
        steps=round(first / CONTROL_DT) if success and not task.in_last_frame else int(verdict.steps[i]),
        success=success,
        success_at_end=bool(verdict.success_at_end[i]),
        stays=bool(verdict.stays[i]),
        first_success_time=first if success else None,
        fell=fell,
        fell_time=float(verdict.fell_time[i]) if fell else None,
        fell_phase=phase_in_words(task, int(verdict.fell_phase[i])) if fell else "",
        diverged=bool(verdict.diverged[i]),
        max_energy=float(verdict.effort[i]),
        seat_height=obj.seat_height,
        start_distance=distances[0],
        end_distance=distances[1],
        mimicbench=mimicbench.__version__,
        mujoco=mujoco.__version__,
    )


def phase_in_words(task: Task, phase: int) -> str:
    """What a robot was at, such as `walking`, or the task's own word for what is done at the object."""
    return task.action if PHASES[phase] == "acting" else PHASES[phase]
