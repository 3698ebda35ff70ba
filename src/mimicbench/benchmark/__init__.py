"""What a run is, as data, and the stages that follow from it.

from mimicbench.benchmark import Recipe, run_stage
run_stage("retarget", Recipe(task="sit-chair"), "work")
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from mimicbench.benchmark.recipe import Recipe as Recipe
from mimicbench.core.errors import UnknownName

if TYPE_CHECKING:
    from mimicbench.core.run import RunContext
    from mimicbench.core.stage import Stage


def run_stage(stage: str, recipe: Recipe, workdir: Path | str, context: RunContext | None = None) -> Stage:
    """Make a stage of a recipe, and what is missing before it. Does nothing where everything is there.

    Args:
        stage: objects, references, retarget, track, demos, perception or imitate.
        recipe: What is to be made.
        workdir: Where: each stage goes to `<workdir>/<task>/<stage>/<words>-<digest>`.
        context: How to run.

    Raises:
        MimicbenchError: The recipe contradicts itself, or a stage cannot be made.
    """
    from mimicbench.benchmark.graph import STAGES, start  # with all that makes stages

    if stage not in STAGES:
        raise UnknownName("stage", stage, list(STAGES))
    return STAGES[stage](start(recipe, workdir, context))
