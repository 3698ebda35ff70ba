"""What a learner is to the rest of the program: its configuration, and how it learns."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from mimicbench.core.settings import BadSetting
from mimicbench.imitate.settings.cloning import DaggerConfig, MapErrors, TrainConfig
from mimicbench.imitate.settings.perception import PerceptionConfig

if TYPE_CHECKING:  # what learns brings torch, which who only asks what can be set does without
    from mimicbench.core.run import RunContext
    from mimicbench.envs.clips import ClipSet
    from mimicbench.envs.policy import Policy
    from mimicbench.imitate.dataset import Plans
    from mimicbench.imitate.lerobot import Demos
    from mimicbench.robots.description import Robot
    from mimicbench.tasks.task import Task
    from mimicbench.track.experts import Expert


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
    says_poses: ClassVar[bool] = False
    """Whether it learns to say poses: those of the clips, or what demonstrations that follow none come to."""
    references: ClassVar[bool] = True
    """Whether it learns from references: clips that were retargeted, and the tracker that follows them. Who does not is
    given objects alone, and says itself which gains it drives."""

    @property
    def remembers(self) -> bool:
        """Whether it remembers its goal, so that it needs eyes for what has to be found."""
        return True

    @property
    def tasks_beside(self) -> tuple[str, ...]:
        """Names of the tasks beside the recipe's that it learns."""
        return ()

    @property
    def sets_beside(self) -> tuple[str, ...]:
        """Names of the sets of recordings that it learns from beside the recipe's clips."""
        return ()

    @staticmethod
    def chosen(tree: Mapping[str, Any]) -> type[ImitateConfig]:
        """The class of the learner that a tree of values names. Raises UnknownName."""
        from mimicbench.imitate.registry import LEARNERS

        return LEARNERS.get(str(tree.get("learner", ImitateConfig.learner))).config


@dataclass(frozen=True)
class CloneImitation(ImitateConfig):
    """A clone of demonstrations; what it is made of is its field `network`, a NetworkConfig."""

    clones: ClassVar[bool] = True
    network: Any = None
    """What it is made of, and what it sees."""
    begin_from: str = ""
    """Folder of a policy of the same kind, from whose weights and statistics learning begins; empty: from nothing. What
    that policy does not have, such as a head that finds goals, begins as it would have."""
    train: TrainConfig = field(default_factory=TrainConfig)
    dagger: DaggerConfig = field(default_factory=DaggerConfig)

    def __post_init__(self) -> None:
        inputs = getattr(self.network, "inputs", None)
        if self.train.maps != MapErrors() and inputs is not None and (inputs.views or not inputs.elevation):
            raise BadSetting("train.maps is of elevation maps, which this learner does not see; leave it out")

    @property
    def remembers(self) -> bool:
        """Whether it remembers its goal."""
        return self.network.inputs.memory

    def plans(self, demos: Demos, clips: ClipSet) -> Plans | None:
        """What it learns to say instead of the joint targets of demonstrations, whose clips these are."""
        from mimicbench.imitate.dataset import RelativeTargets

        return RelativeTargets(demos) if self.network.relative else None


@dataclass(frozen=True)
class Given:
    """What a learner learns from. Beside its folder are copies of the tracker, and of the eyes, if it uses any."""

    clips: ClipSet
    """Clips of the training objects; these objects, and no clip, for who learns without references."""
    demonstrations: Path | None
    """The data set of demonstrations, if its configuration says that it clones."""
    seed: int
    """Of everything that is drawn."""
    gains: str
    """Gains of the robot that the policy is to drive."""
    context: RunContext
    """How to run."""
    load_policy: Callable[[Path, Robot, Task], Policy] | None = None
    """Reads what was learned, for who drives with it while it learns."""
    expert: Expert | None = None
    """Who demonstrates, for who asks it while it learns; None where that is not known."""
    follows: bool = True
    """Whether the demonstrations follow the clips."""
    beside: Sequence[ClipSet] = ()
    """Clips of the tasks beside its own that its configuration names."""


@dataclass(frozen=True)
class LearnerSpec:
    """A way to learn a policy. Checkpoints that it leaves are read by a loader of their kind (policies)."""

    name: str
    config: type[ImitateConfig]
    """Its configuration, whose defaults are its own."""
    learn: Callable[[Path, Given, Any], dict[str, Any]]
    """Learn into a folder by a configuration, or go on learning there; what to tell of it."""


def cloner(name: str, config: type[CloneImitation]) -> LearnerSpec:
    """The learner of that name which clones demonstrations with the network of a configuration."""
    return LearnerSpec(name, config, _clone)


def _clone(folder: Path, given: Given, config: CloneImitation) -> dict[str, Any]:
    from mimicbench.imitate.cloning import clone

    return clone(folder, given, config)
