"""Stage `imitate`: what can be learned for a task, each in a folder with the tracker and the eyes that it uses.

<imitate>/tracker/       the tracker, copied here so that the folder can be moved as a whole
<imitate>/perception/    the network that finds the goal in a map
<imitate>/policy/        what was learned: the planner, by DAgger over the tracker, or a clone of demonstrations
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, make_dataclass
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

from mimicbench.core.checkpoint import CONFIG
from mimicbench.core.errors import UnknownName
from mimicbench.core.parallel import counter
from mimicbench.core.run import RunContext
from mimicbench.envs.clips import ClipSet
from mimicbench.envs.vec_env import EnvConfig
from mimicbench.imitate.act import ACTConfig
from mimicbench.imitate.bc import BCConfig
from mimicbench.imitate.dataset import DemoFrames, MapMaker
from mimicbench.imitate.inputs import InputConfig
from mimicbench.imitate.learn_perception import evaluate_perception, train_perception
from mimicbench.imitate.learn_planner import train_planner
from mimicbench.imitate.learners import LearnerConfig, save_learner
from mimicbench.imitate.lerobot import load_demos
from mimicbench.imitate.perception import PerceptionConfig, save_perception
from mimicbench.imitate.planner import PlannerConfig, save_planner
from mimicbench.imitate.train import TrainConfig, train
from mimicbench.objects.shape import SceneObject
from mimicbench.robots.description import Robot
from mimicbench.sensors.heightmap import ObjectMaps
from mimicbench.tasks.task import Task
from mimicbench.track.checkpoint import load_tracker

PLANNER = "planner"
REMEMBERING = InputConfig(body="proprio", clock=True, memory=True, elevation=False)
"""What the `-clock` learners see: body, clock, and the seat as seen in the first map."""
CLONES: dict[str, tuple[LearnerConfig, int]] = {
    "act": (ACTConfig.small(), 1500),
    "bc": (BCConfig.small(), 3000),
    "act-clock": (ACTConfig.quick(REMEMBERING), 12_000),
    "bc-clock": (BCConfig.small(REMEMBERING), 40_000),
}
"""Learners that clone demonstrations: their networks, and how many batches they learn from."""


@dataclass(frozen=True)
class ImitateConfig:
    """What every learner has."""

    learner: str = PLANNER
    """What to learn: planner, act, bc, act-clock or bc-clock. Its own settings follow from it."""
    gains: str | None = None
    """Gains of the robot that the policy drives; None for those of the tracker that it learns from."""
    perception: PerceptionConfig = field(default_factory=PerceptionConfig)

    tracker: ClassVar[str | None] = None
    """The tracker that it speaks to while it runs; None for any."""
    clones: ClassVar[bool] = False
    """Whether it learns from demonstrations."""

    @staticmethod
    def chosen(tree: Mapping[str, Any]) -> type["ImitateConfig"]:
        """The class of the learner that a tree of values names. Raises UnknownName."""
        return _imitation(str(tree.get("learner", PLANNER)))


@dataclass(frozen=True)
class PlannerImitation(ImitateConfig):
    """A planner over the tracker, by DAgger."""

    planner: PlannerConfig = field(default_factory=PlannerConfig)

    tracker: ClassVar[str | None] = "residual"


@dataclass(frozen=True)
class CloneImitation(ImitateConfig):
    """A clone of demonstrations."""

    clones: ClassVar[bool] = True
    network: LearnerConfig = field(default_factory=BCConfig.small)
    """What it is made of, and what it sees."""
    train: TrainConfig = field(default_factory=lambda: TrainConfig(steps=1500))


@cache
def _imitation(learner: str) -> type[ImitateConfig]:
    """The configuration of a learner, with its own defaults. Raises UnknownName."""
    if learner == PLANNER:
        return PlannerImitation
    if learner not in CLONES:
        raise UnknownName("learner", learner, [PLANNER, *CLONES])
    network, batches = CLONES[learner]
    made = [
        ("learner", str, field(default=learner)),
        ("network", type(network), field(default=network)),
        ("train", TrainConfig, field(default_factory=lambda: TrainConfig(steps=batches))),
    ]
    return make_dataclass(f"{type(network).__name__}Imitation", made, bases=(CloneImitation,), frozen=True)


def make_perception(
    folder: Path,
    task: Task,
    robot: Robot,
    objects: Sequence[SceneObject],
    held_out: Sequence[SceneObject],
    config: PerceptionConfig,
    quiet: bool,
) -> dict[str, float]:
    """Learn to find a task's goal beside `objects` in elevation maps; `held_out` measures how well. Does nothing if
    that is done.
    """
    if (folder / CONFIG).exists():
        return {}
    with counter(config.steps, "perception", quiet) as tick:
        network = train_perception(folder, config, task, objects, lambda batches, loss: tick(batches))
    error = evaluate_perception(network, task, held_out)
    save_perception(folder, network, robot.name, error)
    return error


def make_planner(folder: Path, clips: ClipSet, config: PlannerConfig, seed: int, context: RunContext) -> None:
    """Learn the planner over the tracker beside it."""
    robot, task = clips.robot, clips.task
    tracker = load_tracker(folder.parent / "tracker", robot)

    def report(row: dict) -> None:
        context.say(
            f"{row['samples'] / 1e6:6.2f} M frames  {row['samples'] / row['seconds']:6.0f}/s  loss "
            f"{row['loss']:.4f}  failed {row['failed']:.2f}"
        )

    env_config = EnvConfig(device=context.device, workers=context.workers)
    network = train_planner(folder, tracker, clips, config, seed, env_config, report)
    notes = {"seed": seed, "task": task.name, "samples": config.samples, "clips": len(clips)}
    save_planner(folder, robot, network, config, notes)


def make_clone(
    folder: Path,
    robot: Robot,
    demos_folder: Path,
    objects: Mapping[str, SceneObject],
    config: CloneImitation,
    notes: Mapping[str, Any],
    quiet: bool,
) -> None:
    """Clone demonstrations. `notes` go into the checkpoint."""
    learner = config.network
    demos = load_demos(demos_folder, robot.name, state=learner.inputs.body == "state")
    chunk = learner.chunk if isinstance(learner, ACTConfig) else 1
    scene = [objects[object_id] for object_id in sorted(set(demos.object_ids))]
    frames = DemoFrames(
        demos, objects, learner.inputs, chunk, maps=_plain_maps(scene) if learner.inputs.elevation else None
    )
    trained = train(learner, frames, config.train, folder, quiet)
    save_learner(folder, trained, robot.name, {**notes, "demonstrations": demos.episodes})


def _plain_maps(scene: Sequence[SceneObject]) -> MapMaker:
    """Maps as vertical rays make them (sense.elevation.down_map)."""
    return ObjectMaps(scene).sample
