"""Demonstrations that somebody else has made: a data set in a workdir, beside the clips and objects that it follows."""

from __future__ import annotations

from pathlib import Path

from mimicbench.benchmark.finding import training_objects
from mimicbench.benchmark.keys import Run
from mimicbench.core.errors import BadFile
from mimicbench.core.stage import Stage, read_stage
from mimicbench.envs.clips import ClipSet
from mimicbench.objects.make import MADE, read_objects
from mimicbench.retarget.make import read_retargeted

MAX_STARTS = 1_000_000
"""More than anybody can simulate."""


def published_clips(run: Run) -> ClipSet | None:
    """The clips that the recipe's named demonstrations follow, or in whose first frames they begin; None if its
    demonstrations are made. Raises BadFile if what they were made from is not beside them.

    Headers may come from anywhere: of what they name only the last part counts, so that nothing leads out of the
    workdir.
    """
    if run.part("demos").source == MADE:
        return None
    demos = run.named("demos", run.part("demos").source)
    return _followed(run, demos.header["reads"].get("retarget")) if follow_clips(demos) else _stood(run, demos)


def follow_clips(demos: Stage) -> bool:
    """Whether demonstrations with a name follow clips, and do not only begin where starts were drawn."""
    return "objects" not in demos.header["reads"]


def _stood(run: Run, demos: Stage) -> ClipSet:
    """Robots where starts were drawn, for demonstrations that follow no clip: drawn again, by the same seed."""
    from mimicbench.envs.rule_starts import standing

    place, reads, count = run.workdir / run.recipe.task, demos.header["reads"], demos.header["settings"].get("clips")
    if not isinstance(count, int) or not 0 < count <= MAX_STARTS:
        raise BadFile(f"{demos.folder} does not say from how many starts it was made; make it again")
    objects = training_objects(read_stage(place / "objects" / _last(reads["objects"])))
    people = _followed(run, reads["retarget"]).split("train").motions if "retarget" in reads else ()
    poses = [motion.joint_pos[0] for motion in people]
    return standing(run.task, run.robot, objects, count, demos.header["seed"], poses)


def _followed(run: Run, folder: object) -> ClipSet:
    """The clips in a stage's folder."""
    place = run.workdir / run.recipe.task
    clips = read_stage(place / "retarget" / _last(folder))
    objects = read_objects(place / "objects" / _last(clips.header["reads"].get("objects")))
    motions = read_retargeted(clips.folder, run.robot.name, len(list(clips.folder.glob("*.npz"))))
    trimmed = [run.task.trimmed(motion, objects[motion.object_id], run.robot) for motion in motions]
    return ClipSet(run.task, run.robot, trimmed, objects)


def _last(folder: object) -> str:
    return Path(str(folder)).name
