"""What makes a clip of each task, and what the task asks for wherever its person is."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import lru_cache

import numpy as np

from mimicbench.core.errors import BadMotion
from mimicbench.core.motion import HumanMotion
from mimicbench.core.registry import Registry
from mimicbench.objects.shape import SceneObject
from mimicbench.references.locomotion.course import Course
from mimicbench.references.synthesis.synthesis import Synthesis

SYNTHESES: Registry[Synthesis] = Registry(
    what="task with synthetic clips",
    package="mimicbench.references.synthesis",
    attribute="SYNTHESIS",
    kind="mimicbench.references.synthesis.synthesis:Synthesis",
    group="mimicbench.references",
)
"""One module of this package each, or an entry point of somebody else's."""
KEPT = 64
"""So many objects and styles are remembered with all that was found for them."""


def synthesize(task: str, index: int, obj: SceneObject, seed: int, alike: bool = False) -> HumanMotion:
    """Clip number `index` of a task on an object, all people being `alike` or not; depends on these and the seed alone.

    Raises UnknownName or BadObject, or BadMotion if people cannot be alike there.
    """
    row, what = SYNTHESES.get(task), (clip_id(task, index, seed), obj, seed)
    if not alike:
        return row.make(*what)
    if not row.alike:
        raise BadMotion(
            f"people who do {task} choose nothing that they could have in common; leave out references.alike"
        )
    return row.make(*what, True)


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

    `wrist_goal_w` (2, 3) is where the wrists are to go [m], for tasks that tell it. Raises UnknownName, BadMotion or
    BadObject.
    """
    row = SYNTHESES.get(task)
    if row.style is None or row.find is None:
        raise BadMotion(f"clips of {task} cannot be planned anew; its synthesis has no style, or no ways to find")
    goal = np.zeros((0, 3)) if wrist_goal_w is None else wrist_goal_w
    missing = [field.name for field in fields(row.style) if field.name not in style]
    if missing:
        raise BadMotion(f"this style lacks {', '.join(missing)}; plans need the style of a synthetic clip of {task}")
    if row.wrist_goals and goal.shape != (2, 3):
        raise BadMotion(
            f"{task} needs a place for each wrist: give wrist_goal_w, two places of three numbers, left and right"
        )
    return _courses(_Request(task, obj, style, goal))


@lru_cache(maxsize=KEPT)
def _courses(request: _Request) -> tuple[Course, ...]:
    row = SYNTHESES.get(request.task)
    assert row.style is not None and row.find is not None
    style = row.style(**{field.name: request.style[field.name] for field in fields(row.style)})
    return row.find(request.obj, style, request.goal)
