"""Stage `demos`: an expert, as a rule the tracker on the training clips, acts to the time limit, and what fulfils K and
stays becomes a demonstration. And what a cloner is shown besides, if it is to learn from its own mistakes.
"""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from mimicbench.core.errors import BadMotion
from mimicbench.core.progress import progress
from mimicbench.core.seeds import digest
from mimicbench.core.stage import Stage
from mimicbench.envs.clips import ClipSet
from mimicbench.envs.disturbance import Disturbance
from mimicbench.envs.policy import Policy
from mimicbench.envs.vec_env import EnvConfig
from mimicbench.imitate.lerobot import DATASET
from mimicbench.imitate.settings.cloning import DaggerConfig
from mimicbench.imitate.settings.demos import DemosConfig
from mimicbench.imitate.stored.demo_writer import SCENE as SCENE_NUMBERS
from mimicbench.imitate.stored.demo_writer import STATE, Demonstration, DemoWriter
from mimicbench.robots.description import Robot
from mimicbench.sensors.observations import chosen_terms
from mimicbench.sensors.proprioception import s_current, s_current_names
from mimicbench.sensors.scene import PICTURE, SCENE
from mimicbench.sim.kinematics import Kinematics
from mimicbench.sim.physics import RobotState
from mimicbench.sim.timing import CONTROL_DT
from mimicbench.tasks.task import Task
from mimicbench.track.driven import drive_clips
from mimicbench.track.experts import Expert
from mimicbench.track.rollout import Rollout, RolloutConfig, roll_out


def make_demos(
    stage: Stage,
    expert: Expert,
    clips: ClipSet,
    config: DemosConfig,
    env_config: EnvConfig | None = None,
    quiet: bool = False,
) -> Stage:
    """Write the demonstrations as a LeRobotDataset v3.

    Killed and started again, it goes on after the last whole shard. Raises BadMotion if no episode fulfilled K and
    stayed.
    """
    if stage.complete:
        return stage
    robot, task, seed = clips.robot, clips.task, stage.header["seed"]
    dataset = stage.folder / DATASET
    names, rate = {STATE: s_current_names(robot), SCENE_NUMBERS: scene_names(task)}, 1 / CONTROL_DT
    writer = DemoWriter(dataset, robot.name, task.title, robot.joint_names, rate, config.batch, names, expert.gains)
    written = set(writer.written)
    shown = (*scene_terms(task), *([PICTURE] if config.images else []))
    clips = clips.first(config.clips)
    parts = batches(clips, config)
    for part, clean in progress(parts, len(parts), "demonstrations", quiet):
        if any(motion.id in written for motion in part.motions):
            continue
        world = Disturbance() if clean else Disturbance(action_noise=config.action_noise, push=config.push)
        rollout = roll_out(expert, part, RolloutConfig(True, world, seed, settle=None, observe=shown), env_config)
        for demo in demonstrations(rollout, part, seed):
            writer.add(demo)
        writer.finish()
    made = len(writer.written)
    if not made:
        raise BadMotion(
            f"the {config.expert} fulfilled {task.name} and stayed on none of {len(clips)} clips; train it longer"
        )
    return stage.finish(clips=len(clips), demonstrations=made, rate=made / len(clips))


def scene_terms(task: Task) -> tuple[str, ...]:
    """Those of SCENE that a task has."""
    return tuple(term.name for term in chosen_terms(SCENE, task))


def scene_names(task: Task) -> list[str]:
    """What each number of them is."""
    around = (
        *(f"center_{axis}" for axis in "xyz"),
        *(f"turned_{i}" for i in range(6)),
        *(f"half_{axis}" for axis in "xyz"),
    )
    targets = [f"{side}_target_{axis}" for side in ("left", "right") for axis in "xyz"]
    return [*around, *(targets if task.wrist_goals else [])]


def batches(clips: ClipSet, config: DemosConfig) -> list[tuple[ClipSet, bool]]:
    """The clips that are tracked together, and whether undisturbed: the first of them, the stated share."""
    clean = round(config.clean_share * len(clips))
    starts = [*range(0, clean, config.batch), *range(clean, len(clips), config.batch), len(clips)]
    return [
        (replace(clips, motions=clips.motions[first:end]), first < clean)
        for first, end in zip(starts[:-1], starts[1:], strict=True)
    ]


def demonstrations(rollout: Rollout, clips: ClipSet, seed: int) -> Iterator[Demonstration]:
    """The episodes of a rollout, recorded to the time limit, that fulfilled K and stay."""
    verdict, kept = rollout.verdict, rollout.recording
    for i, motion in enumerate(clips.motions):
        if not (verdict.success[i] and verdict.stays[i]):
            continue
        state = observed_states(clips.robot, kept.qpos[i], kept.qvel[i], kept.targets[i])
        scene = [kept.seen[name][i].reshape(len(state), -1) for name in scene_terms(clips.task) if name in kept.seen]
        yield Demonstration(
            state,
            kept.targets[i],
            kept.applied[i],
            kept.qpos[i],
            kept.qvel[i],
            motion.object_id,
            motion.id,
            True,
            seed,
            np.concatenate(scene, 1) if scene else None,
            kept.seen[PICTURE][i] if PICTURE in kept.seen else None,
        )


def observed_states(robot: Robot, qpos: np.ndarray, qvel: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """(T, 300) S_current at every recorded frame.

    Its last action is the joint target that was chosen before, zeros at first.
    """
    frames, joints = len(qpos), len(robot.joints)
    pose, motion = torch.from_numpy(qpos.astype(np.float32)), torch.from_numpy(qvel.astype(np.float32))
    state = RobotState(
        pose[:, :3], pose[:, 3:7], motion[:, :3], motion[:, 3:6], pose[:, 7 : 7 + joints], motion[:, 6 : 6 + joints]
    )
    last = torch.zeros(frames, joints)
    last[1:] = torch.as_tensor(targets[:-1])
    return s_current(state, Kinematics(robot, frames, 1).links(qpos, qvel), last).numpy()


def make_driven(
    folder: Path,
    expert: Expert,
    policy: Policy,
    clips: ClipSet,
    config: DaggerConfig,
    seed: int,
    env_config: EnvConfig | None = None,
    quiet: bool = False,
) -> Path:
    """Write a data set of what an expert would have done where a policy got to, unless it is there; its folder.

    Killed and started again, it goes on after the last whole shard.
    """
    random = np.random.default_rng(digest(seed, "driven"))
    order = random.permutation(len(clips))[: config.clips].tolist()
    robot = clips.robot
    names, rate = {STATE: s_current_names(robot)}, 1 / CONTROL_DT
    writer = DemoWriter(
        folder, robot.name, clips.task.title, robot.joint_names, rate, config.batch, names, expert.gains
    )
    written = set(writer.written)
    firsts = range(0, len(order), config.batch)
    for first in progress(firsts, len(firsts), "driving", quiet):
        part = replace(clips, motions=[clips.motions[index] for index in order[first : first + config.batch]])
        if any(motion.id in written for motion in part.motions):
            continue
        kept = drive_clips(expert, policy, part, config.driven, seed, env_config)
        for motion, qpos, qvel, wanted, chosen in zip(
            part.motions, kept.qpos, kept.qvel, kept.targets, kept.applied, strict=True
        ):
            if len(qpos):
                state = observed_states(robot, qpos, qvel, chosen)
                writer.add(Demonstration(state, wanted, chosen, qpos, qvel, motion.object_id, motion.id, False, seed))
        writer.finish()
    return folder
