"""Stage `retarget`: every human clip becomes a robot clip, measured, and judged by its measures and by the task's
metric K.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

from mimicbench.core.motion import HumanMotion, RobotMotion
from mimicbench.core.parallel import map_items
from mimicbench.core.run import RunContext
from mimicbench.core.stage import Stage
from mimicbench.objects.shape import SceneObject, load_object
from mimicbench.retarget.acceptance import Outcome, outcome, summary
from mimicbench.retarget.clip import Clip
from mimicbench.retarget.registry import METHODS
from mimicbench.retarget.settings import RetargetConfig
from mimicbench.robots.description import Robot
from mimicbench.robots.registry import ROBOTS

Fulfils = Callable[[RobotMotion, SceneObject, Robot], bool]
"""A task's K on a whole motion (tasks.task.Task.fulfilled)."""


@dataclass(frozen=True)
class Places:
    """What clips are retargeted to, where their objects are, and what they are judged by."""

    robot: str
    objects: Path
    fulfils: Fulfils


def make_retargeted(
    stage: Stage, clips: Sequence[Path], places: Places, config: RetargetConfig, context: RunContext
) -> Stage:
    """Retarget human clips, one `<id>.npz` each.

    Each header says whether the clip was solved and fulfils K; only such clips are passed on. The stage's summary
    counts why the others are not (see acceptance.summary). Killed and started again, or given more, it goes on with
    the clips that are missing. Raises UnknownName if there is no mapping from the clips' skeleton to the robot.
    """
    work = partial(_retarget_one, stage.folder, places, config)
    found = summary(map_items(work, clips, context.workers, f"clips by {config.method}", context.quiet))
    return stage.finish(**asdict(found))


def _retarget_one(folder: Path, places: Places, config: RetargetConfig, path: Path) -> Outcome:
    target, method = folder / path.name, METHODS.get(config.method)
    robot = ROBOTS.get(places.robot)
    if target.exists():
        motion = RobotMotion.load(target, robot.name)
    else:
        human = HumanMotion.load(path)
        obj = load_object(places.objects, human.object_id)
        motion = method.retarget(Clip(human, obj, robot), method.preset(config.variant))
        fulfilled = bool(places.fulfils(motion, obj, robot))
        found = outcome(motion.measures, fulfilled, motion.frames, method.limits)
        motion = replace(motion, success=not found.wrong, measures={**motion.measures, "fulfilled": float(fulfilled)})
        motion.save(target)
    return outcome(
        motion.measures, bool(motion.measures.get("fulfilled", motion.success)), motion.frames, method.limits
    )


def read_retargeted(folder: Path, robot: str, count: int | None = None) -> list[RobotMotion]:
    """The clips of a finished stage that are solved and fulfil K, in order of their ids.

    Of its first `count` clips, or of all.
    """
    paths = sorted(folder.glob("*.npz"))[:count]
    return [motion for path in paths if (motion := RobotMotion.load(path, robot)).success]
