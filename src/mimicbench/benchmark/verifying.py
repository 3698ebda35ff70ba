"""Whether what a stage keeps is what it says."""

from __future__ import annotations

from typing import Any

from mimicbench.benchmark import keys
from mimicbench.benchmark.experts import demonstrated_gains
from mimicbench.benchmark.graph import demonstrated
from mimicbench.benchmark.keys import Run
from mimicbench.core.errors import BadFile
from mimicbench.core.names import typed
from mimicbench.core.stage import read_stage


def verify_demos(run: Run) -> dict[str, Any]:
    """How many of a recipe's stored demonstrations fulfil K and stay, by their states, which do not, and with which
    gains they were made.

    Clips that they follow are made again where they are missing, demonstrations are not. Raises BadFile if there are
    none.
    """
    from mimicbench.imitate.lerobot import DATASET, load_demos
    from mimicbench.imitate.stored.verify import unfulfilled

    tracker = keys.tracker_folder(run)
    stage = None if tracker is None else keys.demos_of(run, tracker)[1]
    if tracker is None or stage is None or not keys.is_complete(stage):
        raise BadFile(
            f"this recipe has no demonstrations in {run.workdir}; make them with `mimicbench demos --task "
            f"{run.recipe.task} --workdir {typed(run.workdir)}`"
        )
    demos = load_demos(stage / DATASET, run.recipe.robot, state=False)
    wrong = unfulfilled(demos, demonstrated(run))
    return {
        "task": run.recipe.task,
        "gains": demonstrated_gains(run, read_stage(stage), tracker),
        "demonstrations": demos.episodes,
        "fulfilled": demos.episodes - len(wrong),
        "wrong": wrong,
    }
