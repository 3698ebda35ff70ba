"""Stages that are in a workdir, for whoever knows their clips but not their recipe; and the objects of a stage."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from mimicbench.core.errors import BadFile, BadObject, MimicbenchError
from mimicbench.core.names import typed
from mimicbench.core.stage import HEADER, Stage, read_stage
from mimicbench.objects.make import object_ids, read_objects
from mimicbench.objects.shape import SceneObject


def stages_of(workdir: Path, task: str, stage: str) -> list[Stage]:
    """The finished stages of a kind, in order of their folders' names."""
    found = []
    for path in sorted((workdir / task / stage).glob(f"*/{HEADER}")):
        try:
            found.append(read_stage(path.parent))
        except BadFile:
            continue
    return found


def is_made(stage: Stage) -> bool:
    """Whether a stage is called by what determines it; sets that were imported or augmented have a name instead."""
    return stage.folder.name.endswith(stage.digest)


def stage_with(workdir: Path, task: str, stage: str, file: str, folder: Path | None, made_alone: bool = False) -> Stage:
    """The stage in `folder`, or else the only one that has a file; or, if none has it, the only one there is. With
    `made_alone`, named sets are none of them where there are others.

    Raises BadFile or MimicbenchError if it is not clear which one is meant.
    """
    if folder is not None:
        return read_stage(folder)
    found = stages_of(workdir, task, stage)
    found = [one for one in found if made_alone and is_made(one)] or found
    if not found:
        raise BadFile(
            f"{workdir} holds no {stage} of {task}; run `mimicbench {stage} --task {task} --workdir "
            f"{typed(workdir)}` first"
        )
    having = [one for one in found if (one.folder / file).exists()] or found
    if len(having) > 1:
        raise MimicbenchError(f"say which one with --stage: {', '.join(map(_told, having))}")
    return having[0]


def _told(stage: Stage) -> str:
    """Its folder, and what it was made from: a folder's digest tells nobody which one it is."""
    made_from = [Path(place).name for place in stage.header.get("reads", {}).values()]
    return f"{stage.folder} (from {' and '.join(made_from)})" if made_from else str(stage.folder)


def read_by(stage: Stage, kind: str) -> Path:
    """Folder of the stage of a kind that a stage was made from: beside it, in whichever workdir that is. Raises
    BadFile if it was made from none.
    """
    place = stage.header.get("reads", {}).get(kind)
    if place is None:
        raise BadFile(f"{stage.folder} is a stage {stage.header['stage']!r}, made from no {kind}; give another --stage")
    return (
        Path(os.path.abspath(stage.folder)).parents[1] / place
    )  # not resolved: a folder may be a link to another disk


def largest(workdir: Path, tasks: Sequence[str], stage: str, name: str | None) -> dict[str, Stage]:
    """The made stage with most clips of each task that has any; or the set called `name`, if given. Raises BadFile if
    none has.
    """
    found, sets = {}, set[str]()
    for task in tasks:
        there = stages_of(workdir, task, stage)
        sets |= {one.folder.name for one in there if not is_made(one)}
        wanted = [one for one in there if (is_made(one) if name is None else one.folder.name == name)]
        if wanted:
            found[task] = max(wanted, key=lambda one: sum(1 for _ in one.folder.glob("*.npz")))
    if not found:
        which = "that are made" if name is None else f"called {name!r}"
        first = [f"run `mimicbench {stage} --task {tasks[0]} --workdir {typed(workdir)}` first"] if name is None else []
        first += [f"name a set that is there (--source {' or '.join(sorted(sets))})"] if sets else []
        advice = ", or ".join(first) or "`mimicbench import` makes one"
        raise BadFile(f"{workdir} holds no {stage} {which} of {', '.join(tasks)}; {advice}")
    return found


def objects_of_split(objects: Stage, split: str) -> dict[str, SceneObject]:
    """The objects of a split that are wanted of a stage, by id."""
    ids = object_ids(objects.folder)[: objects.header["amounts"].get("count")]
    return {name: obj for name, obj in read_objects(objects.folder, ids).items() if obj.split == split}


def training_objects(objects: Stage) -> dict[str, SceneObject]:
    """The objects of the training split. Raises BadObject if there is none."""
    found = objects_of_split(objects, "train")
    if not found:
        raise BadObject(f"no object in {objects.folder} is of the training split; make more (--objects.count)")
    return found
