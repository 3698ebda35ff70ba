"""Stage `imitate`: what can be learned for a task, each in a folder of its own beside the tracker and the eyes that
it uses.

<imitate>/tracker/       the tracker, copied here so that the folder can be moved as a whole
<imitate>/perception/    the network that finds the seat in a map
<imitate>/planner/       DAgger over the tracker
<imitate>/act/, bc/      as the paper has them: S_current and the map of every frame
<imitate>/act-clock/, bc-clock/    with a clock and a memory of the start instead
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from mimicbench.core.checkpoint import checkpoint_kind
from mimicbench.core.errors import UnknownName
from mimicbench.core.parallel import counter
from mimicbench.core.stage import Stage, open_stage
from mimicbench.envs.clips import ClipSet
from mimicbench.envs.vec_env import EnvConfig
from mimicbench.imitate.act import ACTConfig
from mimicbench.imitate.bc import BCConfig
from mimicbench.imitate.dataset import DemoFrames, MapMaker
from mimicbench.imitate.demos import DemosConfig
from mimicbench.imitate.inputs import InputConfig
from mimicbench.imitate.learn_perception import evaluate_perception, train_perception
from mimicbench.imitate.learn_planner import train_planner
from mimicbench.imitate.learners import LearnerConfig, save_learner
from mimicbench.imitate.lerobot import load_demos
from mimicbench.imitate.perception import PerceptionConfig, save_perception
from mimicbench.imitate.planner import PlannerConfig, PlannerPolicy, load_planner, save_planner
from mimicbench.imitate.policy import VisionPolicy, load_policy
from mimicbench.imitate.train import TrainConfig, train
from mimicbench.objects.shape import SceneObject
from mimicbench.robots.description import Robot
from mimicbench.sensors.heightmap import ObjectMaps
from mimicbench.tasks.task import Task
from mimicbench.track.checkpoint import load_tracker

REMEMBERING = InputConfig(body="proprio", clock=True, memory=True, elevation=False)
"""What the `-clock` learners see: body, clock, and the seat as seen in the first map."""
LEARNERS: dict[str, LearnerConfig] = {
    "act": ACTConfig.small(),
    "bc": BCConfig.small(),
    "act-clock": ACTConfig.quick(REMEMBERING),
    "bc-clock": BCConfig.small(REMEMBERING),
}
"""Learners that clone demonstrations. `ACTConfig.paper()` is the paper's size, for a GPU."""


@dataclass(frozen=True)
class CloneConfig:
    """How long a learner clones."""

    train: TrainConfig = field(default_factory=lambda: TrainConfig())


@dataclass(frozen=True)
class ImitateConfig:
    """Everything that a policy is learned with."""

    perception: PerceptionConfig = field(default_factory=PerceptionConfig)
    planner: PlannerConfig = field(default_factory=PlannerConfig)
    demos: DemosConfig = field(default_factory=DemosConfig)
    clone: CloneConfig = field(default_factory=CloneConfig)


def make_perception(
    folder: Path,
    task: str,
    robot: Robot,
    objects: Sequence[SceneObject],
    held_out: Sequence[SceneObject],
    made_from: Mapping[str, str],
    config: PerceptionConfig,
    quiet: bool,
) -> Stage:
    """Learn to find the seat of `objects` in elevation maps; `held_out` measures how well."""
    stage = open_stage(folder, "perception", task, config.seed, asdict(config), made_from)
    if stage.complete:
        return stage
    with counter(config.steps, "seat perception", quiet) as tick:
        network = train_perception(folder, config, objects, lambda batches, loss: tick(batches))
    error = evaluate_perception(network, held_out)
    save_perception(folder, network, robot.name, asdict(error))
    return stage.finish(**asdict(error))


def make_planner(
    stage: Stage,
    clips: ClipSet,
    config: PlannerConfig,
    say: Callable[[str], None],
    env_config: EnvConfig | None = None,
) -> Stage:
    """Learn the planner over the tracker beside it."""
    if stage.complete:
        return stage
    robot, task, seed = clips.robot, clips.task, stage.header["seed"]
    tracker = load_tracker(stage.folder.parent / "tracker", robot)

    def report(row: dict) -> None:
        say(
            f"{row['samples'] / 1e6:6.2f} M frames  {row['samples'] / row['seconds']:6.0f}/s  loss {row['loss']:.4f}"
            f"  failed {row['failed']:.2f}"
        )

    network = train_planner(stage.folder, tracker, clips, config, seed, env_config, report)
    notes = {"seed": seed, "task": task.name, "samples": config.samples, "clips": len(clips)}
    save_planner(stage.folder, robot, network, config, notes)
    return stage.finish(clips=len(clips), samples=config.samples)


def make_clone(
    folder: Path,
    robot: Robot,
    task: Task,
    name: str,
    demos_folder: Path,
    objects: Mapping[str, SceneObject],
    made_from: Mapping[str, str],
    config: CloneConfig,
    seed: int,
    quiet: bool,
) -> Stage:
    """Clone the demonstrations with the learner `name`. Raises UnknownName."""
    if name not in LEARNERS:
        raise UnknownName("learner", name, list(LEARNERS))
    learner = LEARNERS[name]
    stage = open_stage(folder, name, task.name, seed, {"learner": asdict(learner), **asdict(config)}, made_from)
    if stage.complete:
        return stage
    demos = load_demos(demos_folder, robot.name, state=learner.inputs.body == "state")
    chunk = learner.chunk if isinstance(learner, ACTConfig) else 1
    scene = [objects[object_id] for object_id in sorted(set(demos.object_ids))]
    frames = DemoFrames(
        demos, objects, learner.inputs, chunk, maps=_plain_maps(scene) if learner.inputs.elevation else None
    )
    trained = train(learner, frames, config.train, folder, quiet)
    save_learner(folder, trained, robot.name, {"seed": seed, "task": task.name, "demonstrations": demos.episodes})
    return stage.finish(demonstrations=demos.episodes, frames=demos.frames)


def _plain_maps(scene: Sequence[SceneObject]) -> MapMaker:
    """Maps as vertical rays make them (sense.elevation.down_map)."""
    return ObjectMaps(scene).sample


def load_any(folder: Path, robot: Robot, task: Task) -> PlannerPolicy | VisionPolicy:
    """The policy in a folder, whatever kind it is. Raises BadCheckpoint or UnknownName."""
    kind = checkpoint_kind(folder)
    if kind == "planner":
        return load_planner(folder, robot, task)
    return load_policy(folder, robot.name, folder.parent / "perception")
