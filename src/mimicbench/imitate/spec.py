"""What a learner is to the rest of the program: its configuration, and how it learns."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from mimicbench.core.run import RunContext
from mimicbench.envs.clips import ClipSet
from mimicbench.imitate.perception import PerceptionConfig


@dataclass(frozen=True)
class ImitateConfig:
    """What every learner has."""

    learner: str = "planner"
    """What to learn: a name of the registry, such as planner, act or bc. Its own settings follow from it."""
    gains: str | None = None
    """Gains of the robot that the policy drives; None for those of the tracker that it learns from."""
    perception: PerceptionConfig = field(default_factory=PerceptionConfig)

    tracker: ClassVar[str | None] = None
    """The tracker that it speaks to while it runs; None for any."""
    clones: ClassVar[bool] = False
    """Whether it learns from demonstrations."""

    @property
    def looks(self) -> bool:
        """Whether its policy looks for its goal in a map, and so needs the network that does."""
        return True

    @staticmethod
    def chosen(tree: Mapping[str, Any]) -> type["ImitateConfig"]:
        """The class of the learner that a tree of values names. Raises UnknownName."""
        from mimicbench.imitate.registry import LEARNERS

        return LEARNERS.get(str(tree.get("learner", ImitateConfig.learner))).config


@dataclass(frozen=True)
class Given:
    """What a learner learns from. Beside its folder are copies of the tracker and of the eyes that it may use."""

    clips: ClipSet
    """Clips of the training objects."""
    demonstrations: Path | None
    """The data set of demonstrations, if its configuration says that it clones."""
    seed: int
    """Of everything that is drawn."""
    gains: str
    """Gains of the robot that the policy is to drive."""
    context: RunContext
    """How to run."""


@dataclass(frozen=True)
class LearnerSpec:
    """A way to learn a policy. Checkpoints that it leaves are read by a loader of their kind (policies)."""

    name: str
    config: type[ImitateConfig]
    """Its configuration, whose defaults are its own."""
    learn: Callable[[Path, Given, Any], dict[str, Any]]
    """Learn into a folder by a configuration, or go on learning there; what to tell of it."""
