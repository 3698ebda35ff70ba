"""Synthetic human clips: what makes a clip of each task."""

from collections.abc import Callable

from mimicbench.core.errors import UnknownName
from mimicbench.core.motion import HumanMotion
from mimicbench.objects.shape import SceneObject
from mimicbench.references.lie_bed import synthesize_lie_bed
from mimicbench.references.lie_sofa import synthesize_lie_sofa
from mimicbench.references.lift_box import synthesize_lift_box
from mimicbench.references.sit_chair import synthesize_sit_chair
from mimicbench.references.sit_sofa import synthesize_sit_sofa
from mimicbench.references.touch_points import synthesize_touch_points

TASKS: dict[str, Callable[[str, SceneObject, int], HumanMotion]] = {
    "sit-chair": synthesize_sit_chair,
    "sit-sofa": synthesize_sit_sofa,
    "lie-bed": synthesize_lie_bed,
    "lie-sofa": synthesize_lie_sofa,
    "lift-box": synthesize_lift_box,
    "touch-points": synthesize_touch_points,
}
"""(clip id, object, seed) -> clip."""


def synthesize(task: str, index: int, obj: SceneObject, seed: int) -> HumanMotion:
    """Clip number `index` of a task on an object; depends on these and the seed alone. Raises UnknownName or BadObject."""
    if task not in TASKS:
        raise UnknownName("task", task, list(TASKS))
    return TASKS[task](clip_id(task, index, seed), obj, seed)


def clip_id(task: str, index: int, seed: int) -> str:
    """Name of a synthetic clip, such as sit-chair-0-00042 with seed 0."""
    return f"{task}-{seed}-{index:05d}"
