"""Demonstrations that somebody else has made: a data set in a workdir, beside the clips and objects that it follows."""

from __future__ import annotations

from pathlib import Path

from mimicbench.benchmark.keys import Run
from mimicbench.core.stage import read_stage
from mimicbench.envs.clips import ClipSet
from mimicbench.objects.make import MADE, read_objects
from mimicbench.retarget.make import read_retargeted


def published_clips(run: Run) -> ClipSet | None:
    """The clips that the recipe's named demonstrations follow; None if its demonstrations are made. Raises BadFile if
    they are not beside them.

    Headers may come from anywhere: of what they name only the last part counts, so that nothing leads out of the
    workdir.
    """
    if run.part("demos").source == MADE:
        return None
    place = run.workdir / run.recipe.task
    demos = run.named("demos", run.part("demos").source)
    clips = read_stage(place / "retarget" / _last(demos.header["reads"].get("retarget")))
    objects = read_objects(place / "objects" / _last(clips.header["reads"].get("objects")))
    motions = read_retargeted(clips.folder, run.robot.name, len(list(clips.folder.glob("*.npz"))))
    trimmed = [run.task.trimmed(motion, objects[motion.object_id], run.robot) for motion in motions]
    return ClipSet(run.task, run.robot, trimmed, objects)


def _last(folder: object) -> str:
    return Path(str(folder)).name
