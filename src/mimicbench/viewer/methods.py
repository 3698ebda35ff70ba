"""Who can act: checkpoints by what they are called on the page, and which of them it was that acted."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mimicbench.benchmark import keys
from mimicbench.benchmark.shipped import shipped_folders, shipped_trackers
from mimicbench.benchmark.who import Who, networks_of
from mimicbench.core.checkpoint import CONFIG, checkpoint_digest, checkpoint_kind, checkpoint_robot
from mimicbench.core.errors import BadFile
from mimicbench.policies.registry import LOADERS
from mimicbench.robots.description import Robot
from mimicbench.tasks.task import Task

if TYPE_CHECKING:
    from mimicbench.viewer.opened import Opened

TRACKER = "tracker"
"""The kind of checkpoint that follows clips; all others are policies."""
LEARNED = {"track": keys.CHECKPOINT, "imitate": keys.POLICY}
"""Stage -> the folder in it that has what was learned."""


def methods(task: str, robot: str, workdir: Path) -> dict[str, Path]:
    """Checkpoints that can act on a task, by what they are called on the page.

    What comes with the package, and what a workdir has learned; what is damaged there is no reason not to look at all
    else.
    """
    found: dict[str, Path] = {}
    tracker = shipped_trackers(robot).get(task)
    if tracker is not None:
        found[TRACKER] = tracker
    for name, folder in shipped_folders(task).items():
        found[f"{name} ({task})" if name in found else name] = folder
    for stage, learned in LEARNED.items():  # beside a policy are copies of what it runs on, which nobody learned there
        for path in sorted(workdir.glob(f"{task}/{stage}/*/{learned}/{CONFIG}")):
            found[f"{path.parents[1].name} (workdir)"] = path.parent
    return {name: folder for name, folder in found.items() if _acts(folder, robot)}


def _acts(folder: Path, robot: str) -> bool:
    """Whether there is a checkpoint that can drive a robot."""
    try:
        return checkpoint_robot(folder) == robot and checkpoint_kind(folder) in (TRACKER, *LOADERS)
    except BadFile:
        return False


def named(paths: Sequence[str], found: Mapping[str, Path]) -> dict[str, Path]:
    """Those of a user, beside others that were found, by as much of the ends of their paths as tells them from all
    others.
    """
    own: dict[str, Path] = {}
    for path in dict.fromkeys(Path(os.path.abspath(path)) for path in paths):  # `.` has no name
        parts = path.with_suffix("").parts if path.is_file() else path.parts
        names = ["/".join(parts[-count:]) for count in range(1, len(parts))]
        own[next((name for name in names if name not in found and name not in own), str(path))] = path
    return own


def whose(found: Mapping[str, Path], opened: Opened) -> str | None:
    """Who of these acted in an episode, if it is one: whose networks it was judged with.

    Where its rows do not say that, who is called as they say. None if it is nobody of these.
    """
    told = networks_of(opened.made_from)
    if not told:
        return opened.policy if opened.policy in found else None
    return next((name for name, folder in found.items() if Who(name, folder).digests == told), None)


def gains_of(digest: str, task: Task, robot: Robot, workdir: Path) -> str | None:
    """Which of the robot's gains a checkpoint of this digest drives, if it is one of those that can act here."""
    from mimicbench.policies.loading import load_policy
    from mimicbench.track.checkpoint import load_tracker

    for folder in methods(task.name, robot.name, workdir).values():
        if checkpoint_digest(folder) == digest:
            is_tracker = checkpoint_kind(folder) == TRACKER
            return load_tracker(folder, robot).spec.gains if is_tracker else load_policy(folder, robot, task).gains
    return None
