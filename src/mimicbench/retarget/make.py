"""Stage `retarget`: every human clip becomes a robot clip, measured, and judged by its measures and by the task's
metric K.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

from mimicbench.core.errors import BadMotion
from mimicbench.core.motion import HumanMotion, RobotMotion
from mimicbench.core.parallel import map_items
from mimicbench.core.stage import Stage, open_stage
from mimicbench.objects.shape import SceneObject, load_object
from mimicbench.retarget.acceptance import Outcome, outcome, summary
from mimicbench.retarget.clip import Clip
from mimicbench.retarget.mapping import Preset
from mimicbench.retarget.registry import METHODS
from mimicbench.robots.description import Robot
from mimicbench.robots.registry import ROBOTS

Fulfils = Callable[[RobotMotion, SceneObject, Robot], bool]
"""A task's K on a whole motion (tasks.task.Task.fulfilled)."""


@dataclass(frozen=True)
class RetargetConfig:
    """How to retarget."""

    robot: str = "h1"
    method: str = "optimization"
    """One of `mimicbench.retarget.registry.METHODS`."""
    preset: Preset | None = None
    """`paper`: tables and loss to the letter; `improved`: what we find to be better; None: the method's default."""


def make_retargeted(
    folder: Path,
    references: Stage,
    objects_folder: Path,
    task: str,
    fulfils: Fulfils,
    config: RetargetConfig,
    workers: int,
    quiet: bool = False,
    first: int | None = None,
) -> Stage:
    """Retarget the clips of a stage, one `<id>.npz` each, or only the `first` so many.

    Each header says whether the clip was solved and fulfils K; only such clips are passed on. The stage's summary
    counts why the
    others are not (see verdict.summary). Killed and started again, it goes on with the clips that are missing.

    Raises:
        UnknownName: There is no such method, or no mapping from the clips' skeleton to the robot.
        BadMotion: There are no clips, or none is passed on.
    """
    method = METHODS.get(config.method)
    config = replace(config, preset=method.preset(config.preset))
    paths = sorted(references.folder.glob("*.npz"))[:first]
    if not paths:
        raise BadMotion(
            f"there are no clips in {references.folder}; run `mimicbench references --task {task}` "
            "again, or import some"
        )
    settings = asdict(config) | ({} if first is None else {"first": first})
    stage = open_stage(
        folder, "retarget", task, references.header["seed"], settings, {"references": references.fingerprint}
    )
    if stage.complete:
        return stage
    found = summary(
        map_items(
            partial(_retarget_one, folder, objects_folder, fulfils, config),
            paths,
            workers,
            f"clips by {method.name}",
            quiet,
        )
    )
    if not found.kept and first is None:
        reasons = ", ".join(f"{name} {count}" for name, count in found.rejected_for.items())
        raise BadMotion(
            f"none of {len(paths)} clips that {method.name} retargeted is solved and fulfils {task} ({reasons}); "
            "try another --method, or make other clips"
        )
    return stage.finish(**asdict(found))


def _retarget_one(folder: Path, objects_folder: Path, fulfils: Fulfils, config: RetargetConfig, path: Path) -> Outcome:
    target, method = folder / path.name, METHODS.get(config.method)
    robot = ROBOTS.get(config.robot)
    if target.exists():
        motion = RobotMotion.load(target, robot.name)
    else:
        human = HumanMotion.load(path)
        obj = load_object(objects_folder, human.object_id)
        motion = method.retarget(Clip(human, obj, robot), method.preset(config.preset))
        fulfilled = bool(fulfils(motion, obj, robot))
        found = outcome(motion.measures, fulfilled, motion.frames, method.limits)
        motion = replace(motion, success=not found.wrong, measures={**motion.measures, "fulfilled": float(fulfilled)})
        motion.save(target)
    return outcome(
        motion.measures, bool(motion.measures.get("fulfilled", motion.success)), motion.frames, method.limits
    )


def read_retargeted(folder: Path, robot: str) -> list[RobotMotion]:
    """The clips of a finished stage that are solved and fulfil K, in order of their ids."""
    return [motion for path in sorted(folder.glob("*.npz")) if (motion := RobotMotion.load(path, robot)).success]
