"""Synthetic human clips: what makes a clip of each task, and what the task asks for wherever its person is."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from mimicbench.core.errors import BadMotion, UnknownName
from mimicbench.core.motion import HumanMotion
from mimicbench.objects.shape import SceneObject
from mimicbench.references.actions.lying_style import LieStyle
from mimicbench.references.actions.sit_styles import SitStyle
from mimicbench.references.locomotion.course import Course
from mimicbench.references.synthesis.lie_bed import lie_bed_courses, synthesize_lie_bed
from mimicbench.references.synthesis.lie_sofa import lie_sofa_courses, synthesize_lie_sofa
from mimicbench.references.synthesis.lift_box import LiftStyle, lift_course, synthesize_lift_box
from mimicbench.references.synthesis.sit_chair import sit_chair_courses, synthesize_sit_chair
from mimicbench.references.synthesis.sit_sofa import sit_sofa_courses, synthesize_sit_sofa
from mimicbench.references.synthesis.touch_points import TouchStyle, synthesize_touch_points, touch_course

TASKS: dict[str, Callable[[str, SceneObject, int], HumanMotion]] = {
    "sit-chair": synthesize_sit_chair,
    "sit-sofa": synthesize_sit_sofa,
    "lie-bed": synthesize_lie_bed,
    "lie-sofa": synthesize_lie_sofa,
    "lift-box": synthesize_lift_box,
    "touch-points": synthesize_touch_points,
}
"""(clip id, object, seed) -> clip."""


class Courses(NamedTuple):
    """How to do a task in a style."""

    style: type
    """The task's style."""
    find: Callable[[SceneObject, Any, np.ndarray], tuple[Course, ...]]
    """(object, style, (2, 3) goals of the wrists [m] or none) -> ways to do it."""


COURSES: dict[str, Courses] = {
    "sit-chair": Courses(SitStyle, lambda obj, style, _: sit_chair_courses(obj, style)),
    "sit-sofa": Courses(SitStyle, lambda obj, style, _: sit_sofa_courses(obj, style)),
    "lie-bed": Courses(LieStyle, lambda obj, style, _: lie_bed_courses(obj, style)),
    "lie-sofa": Courses(LieStyle, lambda obj, style, _: lie_sofa_courses(obj, style)),
    "lift-box": Courses(LiftStyle, lambda obj, style, _: (lift_course(obj, style),)),
    "touch-points": Courses(TouchStyle, lambda obj, style, goal: (touch_course(obj, goal, style),)),
}
KEPT = 64
"""So many objects and styles are remembered with all that was found for them."""


def synthesize(task: str, index: int, obj: SceneObject, seed: int) -> HumanMotion:
    """Clip number `index` of a task on an object; depends on these and the seed alone.

    Raises UnknownName or BadObject.
    """
    if task not in TASKS:
        raise UnknownName("task", task, list(TASKS))
    return TASKS[task](clip_id(task, index, seed), obj, seed)


def clip_id(task: str, index: int, seed: int) -> str:
    """Name of a synthetic clip, such as sit-chair-0-00042 with seed 0."""
    return f"{task}-{seed}-{index:05d}"


@dataclass(frozen=True, eq=False)
class _Request:
    """What courses depend on; the same object is the same, not an equal one."""

    task: str
    obj: SceneObject
    style: Mapping[str, float]
    goal: np.ndarray

    @property
    def key(self) -> tuple[object, ...]:
        return self.task, id(self.obj), tuple(self.style.items()), self.goal.tobytes()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Request) and self.key == other.key

    def __hash__(self) -> int:
        return hash(self.key)


def courses(
    task: str, obj: SceneObject, style: Mapping[str, float], wrist_goal_w: np.ndarray | None = None
) -> tuple[Course, ...]:
    """The ways to do a task on an object in a style as it is stored with clips.

    Those of the last KEPT objects and styles are remembered.

    `wrist_goal_w` (2, 3) is where the wrists are to go [m], for touch-points. Raises UnknownName, BadMotion or
    BadObject.
    """
    if task not in COURSES:
        raise UnknownName("task", task, list(COURSES))
    goal = np.zeros((0, 3)) if wrist_goal_w is None else wrist_goal_w
    missing = [field.name for field in fields(COURSES[task].style) if field.name not in style]
    if missing:
        raise BadMotion(f"this style lacks {', '.join(missing)}; plans need the style of a synthetic clip of {task}")
    if task == "touch-points" and goal.shape != (2, 3):
        raise BadMotion(
            "touch-points needs a place for each wrist: give wrist_goal_w, two places of three numbers, left and right"
        )
    return _courses(_Request(task, obj, style, goal))


@lru_cache(maxsize=KEPT)
def _courses(request: _Request) -> tuple[Course, ...]:
    row = COURSES[request.task]
    style = row.style(**{field.name: request.style[field.name] for field in fields(row.style)})
    return row.find(request.obj, style, request.goal)
