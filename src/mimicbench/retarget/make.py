"""Stage `retarget`: every human clip becomes a robot clip, measured and judged by the task's metric K."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

from mimicbench.core.errors import BadMotion
from mimicbench.core.motion import HumanMotion, RobotMotion
from mimicbench.core.parallel import map_items
from mimicbench.core.stage import Stage, open_stage
from mimicbench.objects.shape import SceneObject, load_object
from mimicbench.retarget.clip import Clip
from mimicbench.retarget.mapping import Preset
from mimicbench.retarget.methods import get_method
from mimicbench.robot.description import Robot, load_robot

Fulfils = Callable[[RobotMotion, SceneObject, Robot], bool]
"""A task's K on a whole motion (tasks.task.Task.fulfilled)."""


@dataclass(frozen=True)
class RetargetConfig:
    """How to retarget."""

    robot: str = "h1"
    method: str = "optimization"
    """One of `mimicbench.retarget.methods.METHODS`."""
    preset: Preset = "improved"
    """`paper`: tables and loss to the letter; `improved`: what we find to be better."""


def make_retargeted(
    folder: Path, references: Stage, objects_folder: Path, task: str, fulfils: Fulfils, config: RetargetConfig, workers: int, quiet: bool = False
) -> Stage:
    """Retarget all clips of a stage, one `<id>.npz` each; its header says whether K holds, and only those are passed on.

    Killed and started again, it goes on with the clips that are missing. Raises BadMotion if K holds for none.
    """
    seed = references.header["seed"]
    stage = open_stage(folder, "retarget", task, seed, asdict(config), {"references": references.fingerprint})
    if stage.complete:
        return stage
    paths = sorted(references.folder.glob("*.npz"))
    kept = map_items(partial(_retarget_one, folder, objects_folder, fulfils, config), paths, workers, "retargeted clips", quiet)
    if not any(kept):
        raise BadMotion(f"none of {len(paths)} retargeted clips fulfils {task}; look at one with `mimicbench view`, or make other clips")
    return stage.finish(clips=len(paths), fulfilled=sum(kept), rate=sum(kept) / len(paths))


def _retarget_one(folder: Path, objects_folder: Path, fulfils: Fulfils, config: RetargetConfig, path: Path) -> bool:
    target = folder / path.name
    robot = load_robot(config.robot)
    if target.exists():
        return RobotMotion.load(target, robot.name).success
    motion = HumanMotion.load(path)
    obj = load_object(objects_folder, motion.object_id)
    retargeted = get_method(config.method).retarget(Clip(motion, obj, robot), config.preset)
    retargeted = replace(retargeted, success=bool(fulfils(retargeted, obj, robot)))
    retargeted.save(target)
    return retargeted.success


def read_retargeted(folder: Path, robot: str) -> list[RobotMotion]:
    """The clips of a finished stage that fulfil K, in order of their ids."""
    return [motion for path in sorted(folder.glob("*.npz")) if (motion := RobotMotion.load(path, robot)).success]
