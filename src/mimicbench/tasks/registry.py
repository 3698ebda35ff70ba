"""The tasks by name, in the paper's order."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mimicbench.core.registry import Registry

if TYPE_CHECKING:
    from mimicbench.tasks.task import Task

DEFAULT_TASK = "sit-chair"
"""Where nobody names another."""
TASKS: Registry[Task] = Registry(
    what="task",
    package="mimicbench.tasks",
    attribute="TASK",
    kind="mimicbench.tasks.task:Task",
    group="mimicbench.tasks",
    first=("sit-chair", "sit-sofa", "lie-bed", "lie-sofa", "touch-points", "lift-box"),
)
