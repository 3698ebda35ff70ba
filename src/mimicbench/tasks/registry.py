"""The tasks by name."""

from mimicbench.core.errors import UnknownName
from mimicbench.tasks.sit_chair import SIT_CHAIR
from mimicbench.tasks.task import Task

TASKS: dict[str, Task] = {task.slug: task for task in (SIT_CHAIR,)}


def get_task(slug: str) -> Task:
    """A task by name. Raises UnknownName."""
    if slug not in TASKS:
        raise UnknownName("task", slug, list(TASKS))
    return TASKS[slug]
