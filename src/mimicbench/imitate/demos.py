"""Stage `demos`: an expert, as a rule the tracker on the training clips, acts to the time limit, and what fulfils K and
stays becomes a demonstration. And what a cloner is shown besides, if it is to learn from its own mistakes.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import torch

from mimicbench.core.errors import BadMotion
from mimicbench.core.progress import progress
from mimicbench.core.seeds import digest
from mimicbench.core.settings import BadSetting, Positive, Share, Within
from mimicbench.core.stage import Stage
from mimicbench.envs.clips import ClipSet
from mimicbench.envs.disturbance import Disturbance
from mimicbench.envs.policy import Policy
from mimicbench.envs.vec_env import EnvConfig
from mimicbench.imitate.lerobot import DATASET
from mimicbench.imitate.stored.demo_writer import SCENE as SCENE_NUMBERS
from mimicbench.imitate.stored.demo_writer import STATE, Demonstration, DemoWriter
from mimicbench.objects.make import MADE
from mimicbench.robots.description import Robot
from mimicbench.sensors.observations import chosen_terms
from mimicbench.sensors.proprioception import s_current, s_current_names
from mimicbench.sensors.scene import PICTURE, SCENE
from mimicbench.sim.kinematics import Kinematics
from mimicbench.sim.physics import RobotState
from mimicbench.sim.timing import CONTROL_DT
from mimicbench.tasks.task import Task
from mimicbench.track.driven import DrivenConfig, drive_clips
from mimicbench.track.experts import Expert
from mimicbench.track.rollout import Rollout, RolloutConfig, roll_out

TRACKER, CLIPS, RULE, POSES = "tracker", "clips", "rule", "poses"
"""The expert that follows clips; where demonstrations start."""


@dataclass(frozen=True)
class DemosConfig:
    """How demonstrations are made."""

    source: str = MADE
    """`made`: by the tracker. Else the name of a data set in `<workdir>/<task>/demos`, such as the published one of
    examples/sample; nothing is made then, and all other settings of this stage are without effect."""
    expert: str = TRACKER
    """Who demonstrates, and says in DAgger what should be done: the `tracker` on its clips; or a policy from the clips'
    first frames on, by the name of what is shipped for the task, or the folder of its checkpoint. A tracker knows what
    comes next, and who learns from it has to guess that; a policy acts on nothing that cannot be seen."""
    starts: str = CLIPS
    """Where a policy that demonstrates begins: `clips`, in their first frames; `rule`, at rest around training objects,
    drawn by the rule of the environments: for that no clip has to be made, so there can be thousands; `poses`, there
    as well, but in the poses in which clips begin. People stand straighter than a robot at rest, evaluations begin like
    people, and who learned only from the other way to stand squats and tips over before the first step."""
    clips: Positive = 1500
    """Training clips to track, or to begin from, at most; how many starts are drawn by rule, or in poses."""
    action_noise: float = 0.05
    """Standard deviation of what is added to the executed joint targets [rad]; the recorded targets stay clean."""
    push: float = 0.1
    """Standard deviation of the horizontal velocity that a push adds [m/s], every two seconds in the mean."""
    clean_share: Share = 0.25
    """Part of the clips that are tracked without noise and pushes."""
    batch: Positive = 64
    """Clips side by side: one shard of the data set, and what a kill can lose."""
    images: bool = False
    """Store the elevation map of every frame, too, as a picture that LeRobot's policies see; our own learners make
    their maps from the states. Some milliseconds and 2 kB a frame."""

    def __post_init__(self) -> None:
        if self.starts not in (CLIPS, RULE, POSES):
            raise BadSetting(f"demos.starts is {self.starts!r}; give clips, rule or poses")
        if self.starts != CLIPS and self.expert == TRACKER:
            raise BadSetting(
                f"demos.starts is {self.starts!r}, where there is no clip for a tracker; name a policy, demos.expert"
            )


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
    for part, noise in progress(parts, len(parts), "demonstrations", quiet):
        if any(motion.id in written for motion in part.motions):
            continue
        world = Disturbance(action_noise=noise, push=config.push if noise else 0.0)
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


def batches(clips: ClipSet, config: DemosConfig) -> list[tuple[ClipSet, float]]:
    """The clips that are tracked together, and with how much noise: the first of them with none, the stated share."""
    clean = round(config.clean_share * len(clips))
    starts = [*range(0, clean, config.batch), *range(clean, len(clips), config.batch), len(clips)]
    return [
        (replace(clips, motions=clips.motions[first:end]), 0.0 if first < clean else config.action_noise)
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


@dataclass(frozen=True)
class DaggerConfig:
    """What a cloner learns from beside the demonstrations: what it got into itself, and what who demonstrated would
    have done there (DAgger, Ross et al. 2011).
    """

    rounds: Annotated[int, Within(0, 1000)] = 0
    """How often, between trainings of all its batches, it drives robots for more frames to learn from."""
    clips: Positive = 128
    """Training clips, drawn anew in each round, on which it drives from a random moment on."""
    batch: Positive = 64
    """Clips side by side, and a shard of the data set."""
    driven: DrivenConfig = field(default_factory=DrivenConfig)
    rounds_of: tuple[str, ...] = ()
    """Folders of other policies that cloned the same demonstrations: from what they got into in their rounds is learned
    too, before the rounds of one's own. What one learner ran into serves others, who are then compared on the same
    frames, or learn in one long training what took it many short ones."""


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
