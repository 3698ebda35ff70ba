"""A learner of somebody else, and its policy: a robot that holds the mean of the poses in which clips end."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from mimicbench.core.checkpoint import load_checkpoint, save_checkpoint
from mimicbench.imitate.spec import Given, ImitateConfig, LearnerSpec
from mimicbench.policies.loader import Loader
from mimicbench.robots.description import Robot
from mimicbench.sensors.observations import Observations
from mimicbench.tasks.task import Task


@dataclass(frozen=True)
class StillImitation(ImitateConfig):
    """How to stand still."""

    learner: str = "still"
    last: int = 10
    """Frames at the end of each clip whose mean is held."""


@dataclass(frozen=True)
class StillConfig:
    """What a checkpoint says beside its arrays."""

    gains: str


class Still:
    """The policy."""

    observations: tuple[str, ...] = ("proprio",)

    def __init__(self, pose: Tensor, gains: str) -> None:
        self.pose, self.gains = pose, gains

    def to(self, device: str) -> None:
        """Move the pose to a device."""
        self.pose = self.pose.to(device)

    def reset(self, ids: Tensor, obs: Observations) -> None:
        """It remembers nothing."""

    def act(self, obs: Observations) -> Tensor:
        """(N, J) joint targets [rad]: the same for all."""
        return self.pose.expand(obs.num_envs, -1)


def learn(folder: Path, given: Given, config: StillImitation) -> dict[str, Any]:
    """The mean pose into a folder."""
    ends = np.concatenate([motion.joint_pos[-config.last :] for motion in given.clips.motions])
    pose = ends.mean(0).astype(np.float32)
    save_checkpoint(folder, "still", given.clips.robot.name, StillConfig(given.gains), {"pose": pose}, {})
    return {"clips": len(given.clips)}


def load(folder: Path, robot: Robot, task: Task) -> Still:
    """The policy in a folder."""
    checkpoint = load_checkpoint(folder, "still", robot.name)
    pose = checkpoint.matching({"pose": (len(robot.joints),)})["pose"]
    return Still(torch.from_numpy(pose), checkpoint.config_as(StillConfig).gains)


LEARNER = LearnerSpec("still", StillImitation, learn)
LOADER = Loader("still", load)
