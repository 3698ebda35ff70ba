"""PPO on what the robot senses, from nothing: the paper's baseline that learns from nobody (Schulman et al. 2017).

Actor and critic are a ResNet that reads the map and an MLP that reads its features beside the state. Actions are joint
position targets around the robot's rest pose, `rest + scale * a`. Reward and ends are those of
imitate.exploring.episodes, updates those of track.ppo. The paper says no more of it than that it is vision-based PPO.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor

from mimicbench.core.checkpoint import beside
from mimicbench.imitate.exploring.network import Explorer, ExplorerConfig
from mimicbench.imitate.exploring.practice import Practice, course_of, practise
from mimicbench.imitate.goals import known_goal
from mimicbench.imitate.learned import save_learner
from mimicbench.imitate.policy import Senses
from mimicbench.imitate.spec import Given, ImitateConfig, LearnerSpec
from mimicbench.robots.description import Robot


@dataclass(frozen=True)
class PPOImitation(Practice, ImitateConfig):
    """Vision-based PPO without references."""

    learner: str = "ppo"
    gains: str | None = "improved"
    """Gains of the robot that the policy drives."""
    network: ExplorerConfig = field(default_factory=ExplorerConfig.small)

    references: ClassVar[bool] = False

    @property
    def remembers(self) -> bool:
        """Whether it remembers its goal."""
        return self.network.inputs.memory


class Beginner:
    """Who knows nothing yet (practice.Student): actions are around the rest pose."""

    critic = None

    def __init__(self, robot: Robot, explorer: Explorer, senses: Senses) -> None:
        explorer.begin_at(torch.tensor(robot.rest_pose))
        self.senses, self._robot, self._explorer = senses, robot, explorer
        self.blueprint, self.action_size = explorer.config.blueprint, explorer.config.action_size

    def flat(self, vector: Tensor, maps: Tensor | None) -> Tensor:
        """(N, inputs) what the layers take."""
        return self._explorer.flat(vector, maps)

    def targets(self, action: Tensor, joint_pos: Tensor) -> Tensor:
        """(N, J) joint targets [rad] of actions (N, J)."""
        return self._explorer.to(action.device).targets(action)

    def shown(self) -> None:
        """Nothing."""

    def save(self, folder: Path, tensors: Mapping[str, np.ndarray], notes: Mapping[str, Any]) -> None:
        """Write the policy."""
        self._explorer.network.load_tensors(tensors)
        save_learner(folder, self._explorer, self._robot.name, notes)


def learn(folder: Path, given: Given, config: PPOImitation) -> dict[str, Any]:
    """Learn into a folder, or go on learning there, to the same bytes."""
    robot, task = given.clips.robot, given.clips.task
    network = config.network.of(robot, task)
    goal = known_goal(beside(folder, "perception"), robot, task) if network.inputs.memory else None
    beginner = Beginner(robot, network.build(), Senses(network.inputs, goal))
    return practise(folder, given, config, beginner, course_of(config))


LEARNER = LearnerSpec("ppo", PPOImitation, learn)
