"""HIT, as imitate.networks.hit has it: what can be set of it, and how it is learned."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

from mimicbench.core.settings import Positive, Share
from mimicbench.imitate.settings.cloning import TrainConfig
from mimicbench.imitate.settings.encoder import EncoderConfig
from mimicbench.imitate.settings.inputs import NetworkConfig, Window, check_heads
from mimicbench.imitate.spec import CloneImitation, Given, LearnerSpec

if TYPE_CHECKING:
    from mimicbench.envs.clips import ClipSet
    from mimicbench.imitate.lerobot import Demos
    from mimicbench.imitate.networks.hit import HIT
    from mimicbench.imitate.stored.poses import ClipPlans
    from mimicbench.robots.description import Robot
    from mimicbench.tasks.task import Task


@dataclass(frozen=True)
class HITConfig(NetworkConfig):
    """The network. The defaults are those that the original's README trains with."""

    encoder: EncoderConfig = field(default_factory=EncoderConfig)
    """The network that reads the map."""
    action_size: int = 0
    """Numbers that tell the poses of a frame of the chunk. Robot and task decide."""
    chunk: Positive = 50
    """Frames that are planned at once."""
    hidden: Positive = 512
    """Width of all tokens; of the feed-forward blocks, four times that."""
    heads: Positive = 8
    """Attention heads."""
    blocks: Positive = 6
    """Of the transformer."""
    dropout: Share = 0.1
    """Share of activations that are dropped in training."""
    feature_weight: float = 0.005
    """Weight of the map's features in the loss."""

    def of(self, robot: Robot, task: Task) -> Self:
        """The same for a robot at a task."""
        from mimicbench.imitate.plan import PosePlan

        return replace(super().of(robot, task), action_size=PosePlan(robot, task).size)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_heads(self.hidden, self.heads)

    @property
    def window(self) -> Window:
        """Which frames it is shown."""
        return Window(self.chunk, looks_ahead=self.inputs.sees)

    @property
    def layers(self) -> tuple[int, ...]:
        """How many of everything that is repeated."""
        return self.blocks, *self.encoder.layers

    def build(self) -> HIT:
        """A new network, with weights from torch's random numbers."""
        from mimicbench.imitate.networks.hit import HIT

        return HIT(self)

    @staticmethod
    def small() -> HITConfig:
        """For a CPU: about 1 million parameters, half a second ahead."""
        return HITConfig(encoder=EncoderConfig.quick(), chunk=25, hidden=128, heads=4, blocks=3, dropout=0.05)


@dataclass(frozen=True)
class HITImitation(CloneImitation):
    """HIT as the paper has it: S_current and the map of every frame, over the tracker that made the demonstrations."""

    says_poses: ClassVar[bool] = True
    learner: str = "hit"
    network: HITConfig = field(default_factory=HITConfig.small)
    train: TrainConfig = field(default_factory=lambda: TrainConfig(steps=20_000, learning_rate=5e-4))

    def plans(self, demos: Demos, clips: ClipSet) -> ClipPlans:
        """The poses of the clips."""
        from mimicbench.imitate.stored.poses import ClipPlans

        return ClipPlans(demos, clips)


@dataclass(frozen=True)
class OwnPoses(HITImitation):
    """The same where demonstrations follow no clip: it says what they do themselves."""

    def plans(self, demos: Demos, clips: ClipSet) -> ClipPlans:
        """The poses of the demonstrations."""
        from mimicbench.imitate.stored.poses import ClipPlans, motions_of

        return ClipPlans(demos, motions_of(demos, clips))


def learn(folder: Path, given: Given, config: HITImitation) -> dict[str, Any]:
    """Clone what the tracker beside the folder can be told. Raises as `check_told` before anything is learned."""
    from mimicbench.core.checkpoint import beside
    from mimicbench.imitate.cloning import clone
    from mimicbench.imitate.networks.hit import check_told
    from mimicbench.track.checkpoint import load_tracker

    clips = given.clips
    check_told(clips.robot, clips.task, load_tracker(beside(folder, "tracker"), clips.robot), config.network.chunk)
    return clone(folder, given, config if given.follows else OwnPoses(**vars(config)))


LEARNER = LearnerSpec("hit", HITImitation, learn)
