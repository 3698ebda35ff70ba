"""Whom a user means by the name of a policy or tracker."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mimicbench.benchmark import keys
from mimicbench.benchmark.keys import Run
from mimicbench.benchmark.recipe import Recipe, stage_type
from mimicbench.benchmark.shipped import (
    best_shipped,
    networks_under,
    shipped,
    shipped_for,
    shipped_names,
    shipped_trackers,
)
from mimicbench.core.checkpoint import CONFIG, checkpoint_kind, checkpoint_tasks, model_file, used_by
from mimicbench.core.errors import BadFile, MimicbenchError, UnknownName
from mimicbench.core.files import digest_of
from mimicbench.core.names import typed
from mimicbench.core.settings import identity
from mimicbench.imitate.registry import LEARNERS

FILES = {".py": "a Python file with a function make_policy()", ".onnx": "an ONNX file"}
"""What policies of other people are, by the suffix of their files."""
ELSEWHERE = b"\x0a\x08location"
"""Of a tensor in an ONNX file: the name of the entry that says in which file it is."""

PROGRAM = "program"
"""What the digest of such a file is called."""
BESIDE = (keys.TRACKER, keys.PERCEPTION)
"""Folders of networks that a policy may run on, beside its own."""


def is_place(name: str) -> bool:
    """Whether a user who says this means a file or a folder, not a name."""
    return Path(name).suffix in FILES or "/" in name or name.startswith(".")


@dataclass(frozen=True)
class Who:
    """A policy or tracker to judge."""

    name: str
    """As in rows and tables."""
    folder: Path
    """Of its checkpoint; or a Python or ONNX file."""

    @property
    def is_program(self) -> bool:
        """Whether it reads what nobody knows: a Python file, or an ONNX file whose weights are in others."""
        return self.folder.suffix == ".py" or (self.folder.suffix == ".onnx" and ELSEWHERE in self.folder.read_bytes())

    @property
    def is_tracker(self) -> bool:
        """Whether it follows clips, and is judged by how many."""
        return self.folder.suffix not in FILES and checkpoint_kind(self.folder) == keys.TRACKER

    @property
    def tasks(self) -> tuple[str, ...]:
        """The tasks at which it was learned, as far as it tells; else none."""
        return () if self.folder.suffix in FILES else checkpoint_tasks(self.folder)

    @property
    def digests(self) -> dict[str, str]:
        """Digests of the networks that it runs on: its own, and those in the folders beside it that it may use."""
        if self.folder.suffix in FILES:
            return {PROGRAM: digest_of(self.folder)}
        used = used_by(self.folder, BESIDE) if self.is_tracker else networks_under(self.folder)
        return {name: digest_of(model_file(folder)) + digest_of(folder / CONFIG) for name, folder in used.items()}


def networks_of(made_from: Mapping[str, Any]) -> dict[str, Any]:
    """Of what rows say that they are made from: the digests of whom they are of, as Who has them. Empty if they do not
    say.
    """
    own = (PROGRAM, keys.CHECKPOINT, *BESIDE)
    return {name: digest for name, digest in made_from.items() if name.split("/")[-1] in own}


def who_of(run: Run, name: str) -> Who:
    """Whom the user means: `tracker`, `best`, a learner's name, another checkpoint that is shipped for the task, or the
    path of a checkpoint, a Python or an ONNX file.

    What this recipe has learned in this workdir comes before what is shipped. Nothing is made.

    Raises:
        UnknownName: There is no such learner.
        MimicbenchError: Nobody has learned that, here or for the package; the message has the command.
    """
    if Path(name).suffix in FILES:
        if not Path(name).is_file():
            raise BadFile(f"{name} does not exist; give the path of {FILES[Path(name).suffix]}")
        return Who(Path(name).stem, Path(name))
    if is_place(name):
        folder = Path(os.path.abspath(name))  # `.` has no name, and nothing beside it
        if not (folder / CONFIG).exists():
            raise BadFile(f"{Path(name) / CONFIG} does not exist; give the folder of a checkpoint")
        # in a stage all are called alike, and the stage's own name tells them apart
        return Who(folder.parent.name if folder.name in (keys.POLICY, keys.CHECKPOINT) else folder.name, folder)
    tracker = keys.tracker_folder(run)
    if name == keys.TRACKER:
        if tracker is None:
            raise _nobody(run, "track", name, sorted(shipped_trackers(run.recipe.robot)))
        return Who(name, tracker)
    task, robot = run.recipe.task, run.recipe.robot
    best = best_shipped(robot, task) if name == "best" else None
    name = best or (next(iter(LEARNERS)) if name == "best" else name)
    if name not in LEARNERS and (other := shipped(robot, task, name)) is not None:
        return Who(name, other)
    try:
        config = stage_type("imitate", {"learner": name})()
    except UnknownName as error:
        if tasks := shipped_for(name):
            told = f"no {name} is shipped for {task} (only for {', '.join(tasks)}), and none is learned by that name"
            raise MimicbenchError(f"{told}; name another, or give the folder of a checkpoint") from None
        if (Path(name) / CONFIG).is_file():
            raise BadFile(f"no policy is called {name!r}; for the folder, give --policy ./{name}") from None
        for suffix in FILES:
            if Path(f"{name}{suffix}").is_file():
                told = f"no policy is called {name!r}; for the file, give --policy {name}{suffix}"
                raise BadFile(told) from None
        names = dict.fromkeys(["best", keys.TRACKER, *error.args[2], *shipped_names(task)])
        raise UnknownName("policy", name, list(names)) from None
    if not best and (tracker is not None or not config.references):
        if run.recipe.imitate is not None and run.recipe.imitate.learner == name:
            config = run.recipe.imitate
        own = run.folder(keys.imitate_key(run.changed(imitate=config), tracker if config.references else None))
        if keys.is_complete(own):
            return Who(name, own / keys.POLICY)
    if (there := shipped(robot, task, name)) is None:
        raise _nobody(run, f"imitate --learner {name}", name, shipped_for(name))
    return Who(name, there)


def _nobody(run: Run, command: str, name: str, tasks: Sequence[str]) -> MimicbenchError:
    task, robot = run.recipe.task, run.recipe.robot
    where = f"for {task} (only for {', '.join(tasks)})" if tasks else "for any task"
    told = "" if task in tasks else f"no {name} is shipped {where}, and "
    of = "" if robot == Recipe.robot else f" --robot {robot}"
    own = any(identity(run.part(stage)) != identity(stage_type(stage)()) for stage in ("retarget", "track", "demos"))
    return MimicbenchError(
        f"{told}no {name} was made by this recipe in {run.workdir}; make it with `mimicbench {command} --task {task}"
        f"{of} --workdir {typed(run.workdir)}`" + (", and the presets and settings that are given here" if own else "")
    )
