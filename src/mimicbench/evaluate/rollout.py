"""Run a policy on the protocol's episodes: unseen objects, unseen starts, nothing but the robot's own senses."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import mujoco
import numpy as np
import torch

import mimicbench
from mimicbench.core.motion import RobotMotion
from mimicbench.envs.judge import Judge
from mimicbench.envs.start import put_at_start, start_of
from mimicbench.evaluate.rows import EpisodeRow
from mimicbench.imitate.policy import Policy, Senses
from mimicbench.objects.shape import SceneObject
from mimicbench.robots.description import Robot
from mimicbench.sensors.elevation import camera_map, down_map
from mimicbench.sensors.proprioception import Odometry, body_state, s_current
from mimicbench.sim.backends import make_physics
from mimicbench.sim.physics import Physics
from mimicbench.sim.scene import CONTROL_DT
from mimicbench.tasks.task import Task
from mimicbench.track.rollout import Rollout

Eyes = Callable[..., torch.Tensor]
EYES: dict[str, Eyes] = {"cameras": camera_map, "rays": down_map}
"""Makers of the elevation maps (M, 128, 128) of some robots (M,), of which a policy names one."""


@dataclass(frozen=True)
class Protocol:
    """How episodes run. The defaults are the benchmark's."""

    batch: int = 128
    """Episodes side by side. Part of the protocol: networks may round differently in batches of another size."""
    linger: float = 0.0
    """[s] that an episode goes on after K is fulfilled, for pictures."""


@dataclass(frozen=True)
class PolicyRun:
    """What a policy did on a list of episodes."""

    judge: Judge
    start_distance: np.ndarray
    """(E,) of the root from the object's rectangle [m]."""
    end_distance: np.ndarray
    """(E,) the same when the episode ended."""
    recordings: dict[int, np.ndarray] = field(default_factory=dict)
    """(T, nq) simulator positions of the episodes that were recorded."""


def run_policy(
    policy: Policy,
    robot: Robot,
    task: Task,
    starts: Sequence[RobotMotion],
    objects: Mapping[str, SceneObject],
    preset: str,
    protocol: Protocol | None = None,
    workers: int = 0,
    record: Sequence[int] = (),
    tick: Callable[[int], None] | None = None,
    device: str = "cpu",
) -> list[PolicyRun]:
    """One episode from the first frame of each motion in `starts`, beside that motion's object.

    Everything else of the motions is withheld. Runs in batches of the protocol's size; returns one PolicyRun a batch.
    `tick(n)` is called when n more episodes are over. The policy's networks move to where the tensors of physics on
    `device` live.
    """
    protocol = protocol or Protocol()
    runs = []
    for first in range(0, len(starts), protocol.batch):
        part = starts[first : first + protocol.batch]
        wanted = [episode - first for episode in record if first <= episode < first + len(part)]
        runs.append(_run_batch(policy, robot, task, part, objects, preset, protocol, workers, wanted, tick, device))
    return runs


@torch.no_grad()
def _run_batch(
    policy: Policy,
    robot: Robot,
    task: Task,
    starts: Sequence[RobotMotion],
    objects: Mapping[str, SceneObject],
    preset: str,
    protocol: Protocol,
    workers: int,
    record: Sequence[int],
    tick: Callable[[int], None] | None,
    device: str,
) -> PolicyRun:
    n = len(starts)
    scene = [objects[motion.object_id] for motion in starts]
    physics = make_physics(device, robot, scene, preset, workers=workers)
    put_at_start(
        physics, np.arange(n), [start_of(motion, obj, robot, task) for motion, obj in zip(starts, scene, strict=True)]
    )
    policy.to(physics.device)
    judge = Judge(task, robot, scene, CONTROL_DT, [motion.wrist_goal_w for motion in starts])
    odometry = Odometry(n, physics.device)
    everyone = torch.arange(n, device=physics.device)
    odometry.reset(everyone, physics.state())
    last_target = torch.zeros(n, len(robot.joints), device=physics.device)
    eyes = partial(EYES[policy.eyes], workers=workers)
    start_distance = _distances(physics, scene)
    end_distance = start_distance.copy()
    limit = round(task.time_limit / CONTROL_DT)
    running = np.ones(n, bool)
    tracks: dict[int, list[np.ndarray]] = {episode: [physics.qpos()[episode].copy()] for episode in record}
    for step in range(limit):
        senses = _sense(physics, odometry, last_target, step, eyes)
        if step == 0:
            policy.reset(everyone, senses)
        last_target = policy.act(senses)
        physics.step(last_target, True, None if running.all() else np.flatnonzero(running))
        judge.see(physics, running)
        odometry.update(physics.state(), CONTROL_DT)
        ended = running & judge.over(protocol.linger)
        for episode in tracks:
            if running[episode]:
                tracks[episode].append(physics.qpos()[episode].copy())
        if ended.any():
            end_distance[ended] = _distances(physics, scene)[ended]
            running &= ~ended
            if tick:
                tick(int(ended.sum()))
        if not running.any():
            break
    end_distance[running] = _distances(physics, scene)[running]
    if tick:
        tick(int(running.sum()))
    return PolicyRun(
        judge, start_distance, end_distance, {episode: np.array(track) for episode, track in tracks.items()}
    )


def _sense(physics: Physics, odometry: Odometry, last_target: torch.Tensor, step: int, eyes: Eyes) -> Senses:
    state = physics.state()
    return Senses(
        state=s_current(state, physics.links(), last_target),
        proprio=body_state(state),
        time=torch.full((physics.num_envs,), step * CONTROL_DT, device=physics.device),
        odometry_pos=odometry.pos,
        odometry_yaw=odometry.yaw,
        elevation=lambda ids: eyes(physics, ids.cpu().numpy()).to(physics.device),
    )


def _distances(physics: Physics, scene: Sequence[SceneObject]) -> np.ndarray:
    """(N,) horizontal distance of each root from its object's bounding rectangle [m]."""
    low, high = (np.array(corner)[:, :2] for corner in zip(*(obj.bounds() for obj in scene), strict=True))
    xy = physics.qpos()[:, :2]
    return np.linalg.norm(np.maximum(np.maximum(low - xy, xy - high), 0.0), axis=-1)


def policy_rows(
    runs: Sequence[PolicyRun],
    starts: Sequence[RobotMotion],
    objects: Mapping[str, SceneObject],
    task: Task,
    robot: Robot,
    policy: str,
    preset: str,
    seed: int,
) -> list[EpisodeRow]:
    """One row per episode of `run_policy`."""
    rows = []
    episode = 0
    for run in runs:
        for i in range(len(run.start_distance)):
            distances = float(run.start_distance[i]), float(run.end_distance[i])
            rows.append(
                _row(
                    run.judge,
                    i,
                    starts[episode],
                    objects,
                    task,
                    robot,
                    ("imitate", policy, preset),
                    seed,
                    episode,
                    distances,
                )
            )
            episode += 1
    return rows


def tracker_rows(
    rollout: Rollout,
    motions: Sequence[RobotMotion],
    objects: Mapping[str, SceneObject],
    task: Task,
    robot: Robot,
    tracker: str,
    preset: str,
    seed: int,
) -> list[EpisodeRow]:
    """One row per clip of `track.rollout.track_clips`."""
    rows = []
    for i, motion in enumerate(motions):
        obj = objects[motion.object_id]
        distances = _distance(obj, motion.root_pos_w[0]), _distance(obj, motion.root_pos_w[-1])
        rows.append(
            _row(rollout.judge, i, motion, objects, task, robot, ("track", tracker, preset), seed, i, distances)
        )
    return rows


def _distance(obj: SceneObject, pos: np.ndarray) -> float:
    low, high = obj.bounds()
    return float(np.linalg.norm(np.maximum(np.maximum(low[:2] - pos[:2], pos[:2] - high[:2]), 0.0)))


def _row(
    judge: Judge,
    i: int,
    motion: RobotMotion,
    objects: Mapping[str, SceneObject],
    task: Task,
    robot: Robot,
    who: tuple[str, str, str],
    seed: int,
    episode: int,
    distances: tuple[float, float],
) -> EpisodeRow:
    obj = objects[motion.object_id]
    stage, policy, preset = who
    return EpisodeRow(
        task=task.name,
        stage=stage,
        policy=policy,
        preset=preset,
        robot=robot.name,
        seed=seed,
        episode=episode,
        object_id=obj.id,
        object_kind=obj.kind,
        split=obj.split,
        reference_id=motion.id,
        steps=int(judge.steps[i]),
        success=bool(judge.success[i]),
        success_at_end=bool(judge.success_at_end[i]),
        first_success_time=float(judge.first_success[i]) if judge.success[i] else None,
        fell=bool(judge.fell[i]),
        max_energy=float(judge.effort()[i]),
        seat_height=obj.seat_height,
        start_distance=distances[0],
        end_distance=distances[1],
        mimicbench=mimicbench.__version__,
        mujoco=mujoco.__version__,
    )
