"""The tasks by name, in the paper's order."""

from mimicbench.core.errors import UnknownName
from mimicbench.tasks.lie_bed import LIE_BED
from mimicbench.tasks.lie_sofa import LIE_SOFA
from mimicbench.tasks.lift_box import LIFT_BOX
from mimicbench.tasks.sit_chair import SIT_CHAIR
from mimicbench.tasks.sit_sofa import SIT_SOFA
from mimicbench.tasks.task import Task
from mimicbench.tasks.touch_points import TOUCH_POINTS

TASKS: dict[str, Task] = {task.slug: task for task in (SIT_CHAIR, SIT_SOFA, LIE_BED, LIE_SOFA, TOUCH_POINTS, LIFT_BOX)}


def get_task(slug: str) -> Task:
    """A task by name. Raises UnknownName."""
    if slug not in TASKS:
        raise UnknownName("task", slug, list(TASKS))
    return TASKS[slug]
