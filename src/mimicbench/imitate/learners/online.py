"""Planning online over the tracker: nothing to learn but to see. How it plans is in imitate.online."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, ClassVar

from mimicbench.core.settings import Positive, Seed, Within
from mimicbench.imitate.spec import Given, ImitateConfig, LearnerSpec
from mimicbench.retarget.registry import DEFAULT_METHOD


@dataclass(frozen=True)
class OnlineConfig:
    """How to plan."""

    method: str = DEFAULT_METHOD
    """How plans are retargeted."""
    tries: Positive = 4
    """Styles that are tried until a plan is kept as a clip on the stand-in would be."""
    rehearsals: Annotated[int, Within(0, 64)] = 0
    """So many plans that are kept are rehearsed (imitate.online.rehearsal), and the best is followed; 0: the first."""
    room: float = 0.0
    """[m] Of plans that go well, those are better by whose end K could lose so much and still hold, as far as eyes err
    about the object; what exceeds that counts no more. 0: as long as it holds, all are alike."""
    pace: float = 0.15
    """How fast a plan moves to where its goal is by now [m/s]; twice that in radians."""
    anew: float = 0.35
    """A plan is made anew where what is known of the goal by now differs by more than that from what it was made for
    [m], [rad]; 0 for never."""
    seed: Seed = 0
    """Of the styles."""


@dataclass(frozen=True)
class OnlineImitation(ImitateConfig):
    """Plans online over the tracker."""

    learner: str = "online"
    planning: OnlineConfig = field(default_factory=OnlineConfig)

    tracker: ClassVar[str | None] = None


def learn(folder: Path, given: Given, config: OnlineImitation) -> dict[str, Any]:
    """Say how to plan, after making sure that the task can be planned. Raises MimicbenchError."""
    from mimicbench.imitate.online.planning import Planning
    from mimicbench.imitate.online.policy import save_online

    Planning(given.clips.robot, given.clips.task, config.planning)
    told = {"seed": given.seed, "task": given.clips.task.name}
    save_online(folder, given.clips.robot, config.planning, told)
    return told


LEARNER = LearnerSpec("online", OnlineImitation, learn)
