"""Cloning demonstrations, whatever the network: how it is configured, learned, saved and loaded."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar, Protocol, TypeVar

from mimicbench.core.errors import MimicbenchError
from mimicbench.imitate.dataset import DemoFrames, MapMaker
from mimicbench.imitate.inputs import InputConfig, Learner
from mimicbench.imitate.learned import load_learner, save_learner
from mimicbench.imitate.lerobot import load_demos
from mimicbench.imitate.perception import load_perception
from mimicbench.imitate.policy import VisionPolicy
from mimicbench.imitate.spec import Given, ImitateConfig, LearnerSpec
from mimicbench.imitate.train import TrainConfig, train
from mimicbench.objects.shape import SceneObject
from mimicbench.robots.description import Robot
from mimicbench.sensors.heightmap import ObjectMaps
from mimicbench.sim.devices import tensor_device
from mimicbench.tasks.task import Task

REMEMBERING = InputConfig(body="proprio", clock=True, memory=True, elevation=False)
"""Body, clock, and what has to be found as seen in the first map."""


class NetworkConfig(Protocol):
    """What a network that clones is built from: a frozen dataclass."""

    @property
    def inputs(self) -> InputConfig:
        """What it sees."""
        ...

    @property
    def chunk(self) -> int:
        """Frames of action that it predicts."""
        ...

    def build(self) -> Learner:
        """A new network, with weights from torch's random numbers."""
        ...


Network = TypeVar("Network", bound=Learner)


@dataclass(frozen=True)
class CloneImitation(ImitateConfig):
    """A clone of demonstrations; what it is made of is its field `network`, a NetworkConfig."""

    clones: ClassVar[bool] = True
    network: Any = None
    """What it is made of, and what it sees."""
    train: TrainConfig = field(default_factory=TrainConfig)

    @property
    def looks(self) -> bool:
        """Who has no memory of the goal sees it in every map, or not at all."""
        return bool(self.network.inputs.memory)


def cloner(name: str, config: type[CloneImitation]) -> LearnerSpec:
    """The learner of that name which clones demonstrations with the network of a configuration."""
    return LearnerSpec(name, config, clone)


def clone(folder: Path, given: Given, config: CloneImitation) -> dict[str, Any]:
    """Clone demonstrations into a folder, or go on cloning."""
    if given.demonstrations is None:
        raise MimicbenchError(f"{config.learner} clones demonstrations; make some with `mimicbench demos` first")
    network, robot, objects = config.network, given.clips.robot, given.clips.objects
    demos = load_demos(given.demonstrations, robot.name, state=network.inputs.body == "state")
    scene = [objects[object_id] for object_id in sorted(set(demos.object_ids))]
    maps = _plain_maps(scene) if network.inputs.elevation else None
    frames = DemoFrames(demos, objects, network.inputs, network.chunk, maps=maps)
    course = replace(config.train, seed=given.seed, device=tensor_device(given.context.device))
    trained = train(network, frames, course, folder, given.context.quiet)
    told = {"demonstrations": demos.episodes, "batches": course.steps}
    notes = {"seed": given.seed, "task": given.clips.task.name, "gains": given.gains, **told}
    save_learner(folder, trained, robot.name, notes)
    return told


def _plain_maps(scene: list[SceneObject]) -> MapMaker:
    """Maps as vertical rays make them (sensors.elevation.down_map)."""
    return ObjectMaps(scene).sample


def clone_loader(config_type: type) -> Callable[[Path, Robot, Task], VisionPolicy]:
    """Reads policies whose network is built from that configuration."""

    def load(folder: Path, robot: Robot, task: Task) -> VisionPolicy:
        """The policy in a folder, with the eyes in the folder `perception` beside it if it remembers."""
        learner, notes = load_learner(folder, robot.name, config_type)
        eyes = load_perception(folder.parent / "perception", robot.name) if learner.inputs.memory else None
        return VisionPolicy(learner, eyes, str(notes.get("gains", "improved")))

    return load
