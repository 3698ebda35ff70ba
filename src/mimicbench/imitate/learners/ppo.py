"""PPO on what the robot senses, from nothing: the paper's baseline that learns from nobody (Schulman et al. 2017).

Actor and critic are a ResNet that reads the map and an MLP that reads its features beside the state. Actions are joint
position targets around the robot's rest pose, `rest + scale * a`. Reward and ends are those of
imitate.exploring.episodes, updates those of track.ppo. The paper says no more of it than that it is vision-based PPO.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import torch

from mimicbench.imitate.exploring.network import ExplorerConfig
from mimicbench.imitate.exploring.practice import Practice, course_of, practise
from mimicbench.imitate.spec import Given, ImitateConfig, LearnerSpec


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


def learn(folder: Path, given: Given, config: PPOImitation) -> dict[str, Any]:
    """Learn into a folder, or go on learning there, to the same bytes."""
    robot, task = given.clips.robot, given.clips.task
    explorer = config.network.of(robot, task).build()
    explorer.begin_at(torch.tensor(robot.rest_pose))
    return practise(folder, given, config, course_of(config), explorer, cloned=False)


LEARNER = LearnerSpec("ppo", PPOImitation, learn)
