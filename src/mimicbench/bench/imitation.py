"""How fast learners learn and decide, each on the same made-up demonstrations: robots that glide to objects."""

import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from mimicbench.benchmark.shipped import SHIPPED, shipped_trackers
from mimicbench.core import rotations as rot
from mimicbench.core.checkpoint import CONFIG, copy_checkpoint
from mimicbench.core.motion import RobotMotion
from mimicbench.envs.clips import ClipSet
from mimicbench.imitate.cloning import demo_frames
from mimicbench.imitate.learned import save_learner
from mimicbench.imitate.lerobot import Demos
from mimicbench.imitate.registry import LEARNERS
from mimicbench.imitate.spec import CloneImitation
from mimicbench.imitate.train import CloneTraining, Course
from mimicbench.objects.registry import FAMILIES
from mimicbench.policies.loading import load_policy
from mimicbench.robots.description import Robot
from mimicbench.sensors.observations import TERMS, Observations
from mimicbench.sim.timing import CONTROL_DT
from mimicbench.tasks.task import Task

EPISODES, FRAMES = 24, 250
WARM_UP = 2
"""Batches, or decisions, before the clock runs."""


def bench_imitation(
    robot: Robot, task: Task, learners: Sequence[str], seconds: float, say: Callable[[str], None]
) -> dict[str, dict[str, float]]:
    """Measure learners that clone, and decisions of all whose policy can be had.

    Args:
        robot: The robot.
        task: The task.
        learners: Names of learners; all if empty.
        seconds: How long each figure is measured.
        say: Hears of each learner.

    Returns:
        By learner: `frames_per_second` and `batches_per_second` of its training as configured by default, `waiting`,
        the share of that time for which the network waits for data, and `decision_ms`, of one robot on one thread, maps
        being made already. What a learner does not have is left out.
    """
    clips = _clips(robot, task)
    demos = _demos(clips)
    found: dict[str, dict[str, float]] = {}
    for name in learners or LEARNERS.names():
        config = LEARNERS.get(name).config()
        with tempfile.TemporaryDirectory() as folder:
            figures: dict[str, float] = {}
            policy = SHIPPED / task.name / name
            if isinstance(config, CloneImitation):
                figures |= _training(config, demos, clips, Path(folder) / "policy", seconds)
                policy = _beside(Path(folder), robot, task)
            if policy is not None and (policy / CONFIG).exists():
                figures["decision_ms"] = _decision(policy, robot, task, seconds)
        found[name] = figures
        say(f"{name}: {', '.join(f'{key} {value:.3g}' for key, value in figures.items())}")
    return found


def _training(config: CloneImitation, demos: Demos, clips: ClipSet, folder: Path, seconds: float) -> dict[str, float]:
    """Learn for so long, and leave the network in a folder."""
    network = config.network.of(clips.robot, clips.task)
    data = demo_frames(demos, clips, network, config)
    training = CloneTraining(network, data, Course.of(replace(config.train, steps=1 << 30), 0, "cpu"), folder)
    for _ in range(WARM_UP):
        training.step()
    batches, begun, waited = 0, time.perf_counter(), training.waited
    while time.perf_counter() - begun < seconds or not batches:
        training.step()
        batches += 1
    spent = time.perf_counter() - begun
    training.close()
    save_learner(folder, training.result(), clips.robot.name)
    return {
        "frames_per_second": batches * config.train.batch / spent,
        "batches_per_second": batches / spent,
        "waiting": (training.waited - waited) / spent,
    }


def _beside(folder: Path, robot: Robot, task: Task) -> Path | None:
    """The policy in a folder, with the shipped tracker and perception beside it; None if there are none."""
    tracker, eyes = shipped_trackers(robot.name).get(task.name), SHIPPED / task.name / "perception"
    if tracker is None:
        return None
    copy_checkpoint(tracker, folder / "tracker")
    if (eyes / CONFIG).exists():
        copy_checkpoint(eyes, folder / "perception")
    return folder / "policy"


def _decision(folder: Path, robot: Robot, task: Task, seconds: float) -> float:
    """Milliseconds from observations to joint targets, of one robot on one thread."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        policy = load_policy(folder, robot, task)
        random = torch.Generator().manual_seed(0)
        shapes = {name: (1, *TERMS[name].shape(robot, task)) for name in policy.observations}
        seen: dict[str, Tensor] = {n: 0.1 * torch.randn(shape, generator=random) for n, shape in shapes.items()}
        policy.reset(torch.tensor([0]), Observations({**seen, "time": torch.zeros(1, 1)}))
        spent, frame = 0.0, 0
        while spent < seconds or frame <= 2 * WARM_UP:
            frame += 1
            obs = Observations({**seen, "time": torch.full((1, 1), frame * CONTROL_DT)})
            begun = time.process_time()
            policy.act(obs)
            spent += time.process_time() - begun if frame > WARM_UP else 0.0
        return 1e3 * spent / (frame - WARM_UP)
    finally:
        torch.set_num_threads(threads)


def _clips(robot: Robot, task: Task) -> ClipSet:
    """Robots that glide to objects, all joints swinging; what is to be moved or touched goes along, or is there."""
    objects = [FAMILIES.get(task.family).make(index, 0) for index in range(EPISODES)]
    at, rest, motions = np.arange(FRAMES) * CONTROL_DT, np.array(robot.rest_pose), []
    for index, obj in enumerate(objects):
        yaw = np.full(FRAMES, 2.0 * index) + 0.1 * at
        pos = np.stack([2.0 - 0.2 * at, 0.1 * at + 0.01 * index, 1.0 + 0.0 * at], -1)
        joints = np.clip(rest + 0.1 * np.sin(at[:, None] + np.arange(len(rest))), *robot.joint_range.T)
        more: dict[str, Any] = {}
        if task.moves_object:
            more = {"object_pos_w": pos + [0.4, 0.0, 0.0], "object_quat_w": rot.from_yaw(0.0 * yaw)}
        if task.wrist_goals:
            more = {"wrist_goal_w": np.array([[0.4, 0.2, 1.0], [0.4, -0.2, 1.0]])}
        name = f"glide-{index}"
        turned, names = rot.from_yaw(yaw), robot.joint_names
        motions.append(
            RobotMotion(name, task.name, robot.name, names, 1 / CONTROL_DT, pos, turned, joints, obj.id, name, **more)
        )
    return ClipSet(task, robot, motions, {obj.id: obj for obj in objects})


def _demos(clips: ClipSet) -> Demos:
    """Demonstrations that follow clips to the letter, but for what is felt on the way, which is noise."""
    random, robot, frames = np.random.default_rng(0), clips.robot, EPISODES * FRAMES
    poses = [np.concatenate([m.root_pos_w, m.root_quat_w, m.joint_pos], -1) for m in clips.motions]
    if clips.task.moves_object:
        parts = zip(poses, clips.motions, strict=True)
        poses = [np.concatenate([pose, m.object_pos_w, m.object_quat_w], -1) for pose, m in parts]
    actions = np.concatenate([motion.joint_pos for motion in clips.motions]).astype(np.float32)
    state = TERMS["state"].shape(robot, clips.task)
    return Demos(
        robot=robot.name,
        task=clips.task.name,
        fps=1 / CONTROL_DT,
        joint_names=robot.joint_names,
        starts=np.arange(EPISODES + 1) * FRAMES,
        state=random.normal(size=(frames, *state)).astype(np.float32),
        action=actions,
        executed_action=actions,
        qpos=np.concatenate(poses),
        qvel=0.1 * random.normal(size=(frames, 6 + len(robot.joints) + (6 if clips.task.moves_object else 0))),
        object_ids=tuple(motion.object_id for motion in clips.motions),
        reference_ids=tuple(motion.id for motion in clips.motions),
        success=np.ones(EPISODES, bool),
    )
