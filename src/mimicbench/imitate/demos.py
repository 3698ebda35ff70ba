"""Stage `demos`: the tracker follows the training clips, and what fulfils K becomes a demonstration."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch

from mimicbench.core.errors import BadMotion
from mimicbench.core.motion import RobotMotion
from mimicbench.core.parallel import progress
from mimicbench.core.stage import Stage, open_stage
from mimicbench.imitate.lerobot import Demonstration, DemoWriter
from mimicbench.objects.shape import SceneObject
from mimicbench.robots.description import Robot
from mimicbench.sensors.proprioception import s_current
from mimicbench.sim.kinematics import Kinematics
from mimicbench.sim.physics import RobotState
from mimicbench.sim.scene import CONTROL_DT
from mimicbench.tasks.task import Task
from mimicbench.track.checkpoint import Tracker
from mimicbench.track.rollout import track_clips


@dataclass(frozen=True)
class DemosConfig:
    """How demonstrations are made."""

    clips: int = 1500
    """Training clips to track, at most."""
    action_noise: float = 0.05
    """Standard deviation of what is added to the executed joint targets [rad]; the recorded targets stay clean."""
    clean_share: float = 0.25
    """Part of the clips that are tracked without noise."""
    settle: float = 1.0
    """[s] seated at the end."""
    batch: int = 64
    """Clips side by side: one shard of the data set, and what a kill can lose."""


def make_demos(
    folder: Path,
    retarget: Stage,
    robot: Robot,
    task: Task,
    tracker: Tracker,
    made_by: str,
    motions: Sequence[RobotMotion],
    objects: Mapping[str, SceneObject],
    config: DemosConfig,
    seed: int,
    workers: int,
    quiet: bool = False,
    device: str = "cpu",
) -> Stage:
    """Write the demonstrations as a LeRobotDataset v3; `made_by` is the tracker's fingerprint.

    Killed and started again, it goes on after the last whole shard. Raises BadMotion if K was never fulfilled.
    """
    stage = open_stage(
        folder, "demos", task.name, seed, asdict(config), {"retarget": retarget.fingerprint, "tracker": made_by}
    )
    if stage.complete:
        return stage
    writer = DemoWriter(folder / "dataset", robot.name, task.title, robot.joint_names, 1 / CONTROL_DT, config.batch)
    written = set(writer.written)
    clips = motions[: config.clips]
    parts = [clips[first : first + config.batch] for first in range(0, len(clips), config.batch)]
    for number, part in enumerate(progress(parts, len(parts), "demonstrations", quiet)):
        if any(motion.id in written for motion in part):
            continue
        noise = 0.0 if number < config.clean_share * len(parts) else config.action_noise
        rollout = track_clips(
            tracker, robot, task, part, objects, workers, True, noise, seed, config.settle, device=device
        )
        for i, motion in enumerate(part):
            if not rollout.judge.success[i] or rollout.judge.diverged[i]:
                continue
            state = observed_states(robot, rollout.qpos[i], rollout.qvel[i], rollout.targets[i])
            writer.add(
                Demonstration(
                    state,
                    rollout.targets[i],
                    rollout.executed[i],
                    rollout.qpos[i],
                    rollout.qvel[i],
                    motion.object_id,
                    motion.id,
                    True,
                    seed,
                )
            )
        writer.finish()
    made = len(writer.written)
    if not made:
        raise BadMotion(f"the tracker fulfilled {task.name} on none of {len(clips)} clips; train it longer")
    return stage.finish(clips=len(clips), demonstrations=made, rate=made / len(clips), device=device)


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
