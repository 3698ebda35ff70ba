"""Planning online over the tracker: nothing to learn but to see. How it plans is in imitate.online."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from mimicbench.imitate.online.planning import OnlineConfig, Planning
from mimicbench.imitate.online.policy import save_online
from mimicbench.imitate.spec import Given, ImitateConfig, LearnerSpec


@dataclass(frozen=True)
class OnlineImitation(ImitateConfig):
    """Plans online over the tracker."""

    learner: str = "online"
    planning: OnlineConfig = field(default_factory=OnlineConfig)

    tracker: ClassVar[str | None] = None


def learn(folder: Path, given: Given, config: OnlineImitation) -> dict[str, Any]:
    """Say how to plan, after making sure that the task can be planned. Raises MimicbenchError."""
    Planning(given.clips.robot, given.clips.task, config.planning)
    told = {"seed": given.seed, "task": given.clips.task.name}
    save_online(folder, given.clips.robot, config.planning, told)
    return told


LEARNER = LearnerSpec("online", OnlineImitation, learn)
