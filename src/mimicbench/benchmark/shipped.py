"""Checkpoints that come with the package."""

from __future__ import annotations

from pathlib import Path

from mimicbench.core.checkpoint import CONFIG, checkpoint_kind, checkpoint_robot, checkpoint_tasks, used_by
from mimicbench.core.errors import BadFile
from mimicbench.core.files import read_json
from mimicbench.tasks.registry import TASKS

SHIPPED = Path(__file__).parents[1] / "checkpoints"
"""`<task>/<policy>`, beside the `tracker` and the `perception` that it uses; and what serves several tasks: `tracker`,
and `<policy>`, which uses that and each task's own perception."""
TRACKER, PERCEPTION = "tracker", "perception"
BEST = "best.json"
"""Which policy has done best at each task, as `scripts/write_results.py` finds it in the rows of `runs/`."""


def shipped_folders(task: str) -> dict[str, Path]:
    """The checkpoints that come with the package for a task, by name: its own come before those of several tasks."""
    several = [path.parent for path in sorted(SHIPPED.glob(f"*/{CONFIG}")) if task in checkpoint_tasks(path.parent)]
    own = [path.parent for path in sorted(SHIPPED.glob(f"{task}/*/{CONFIG}"))]
    return {folder.name: folder for folder in (*several, *own)}


def shipped(robot: str, task: str, name: str) -> Path | None:
    """The checkpoint of that name which comes with the package for a task and a robot, if there is one."""
    folder = shipped_folders(task).get(name)
    return folder if folder is not None and checkpoint_robot(folder) == robot else None


def expert_named(robot: str, task: str, name: str) -> Path:
    """The checkpoint of a policy that demonstrates: its folder, or what is shipped. Raises BadFile without one."""
    folder = Path(name) if "/" in name else shipped(robot, task, name)
    if folder is None or not (folder / CONFIG).is_file():
        raise BadFile(
            f"demos.expert is {name!r}, where no policy is; give `tracker`, the name of a policy that is shipped for "
            f"{task}, or the folder of a checkpoint"
        )
    return folder


def best_shipped(robot: str, task: str) -> str | None:
    """The name of the policy which has done best at a task, if it comes with the package for this robot."""
    name = read_json(SHIPPED / BEST).get(task)
    return name if name is not None and shipped(robot, task, name) is not None else None


def shipped_for(name: str) -> list[str]:
    """The tasks for which a checkpoint of that name comes with the package."""
    return [task for task in sorted(TASKS) if name in shipped_folders(task)]


def shipped_names(task: str) -> list[str]:
    """The policies and trackers that come with the package for a task."""
    return [name for name, folder in shipped_folders(task).items() if checkpoint_kind(folder) != PERCEPTION]


def shipped_trackers(robot: str) -> dict[str, Path]:
    """The robot's tracker that comes with the package, for each task that one was trained for.

    A task's own, which is beside its policies, comes before that of several tasks.
    """
    found = {}
    for folder in (SHIPPED / TRACKER, *sorted(SHIPPED.glob(f"*/{TRACKER}"))):
        if (folder / CONFIG).exists() and checkpoint_robot(folder) == robot:
            notes = read_json(folder / CONFIG)["notes"]
            several = notes.get("tasks", [notes.get("task")])
            found |= dict.fromkeys([folder.parent.name] if folder.parent != SHIPPED else several, folder)
    return found


def shipped_tracker(robot: str, tasks: tuple[str, ...]) -> Path | None:
    """The robot's tracker that comes with the package for a task, or for several together, if there is one."""
    if len(tasks) == 1:
        return shipped_trackers(robot).get(tasks[0])
    folder = SHIPPED / TRACKER
    there = (folder / CONFIG).exists() and checkpoint_robot(folder) == robot
    return folder if there and set(tasks) <= set(checkpoint_tasks(folder)) else None


def networks_under(policy: Path) -> dict[str, Path]:
    """Folders of the networks that a policy runs on: its own as `checkpoint`, and those beside it that it may use; eyes
    of who learned several tasks are in folders of these tasks' names.
    """
    eyes = (f"{task}/{PERCEPTION}" for task in checkpoint_tasks(policy))
    return used_by(policy, (TRACKER, PERCEPTION, *eyes))
