"""A comparison, carried out: each variant is learned, unless it is there, and judged on the same episodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mimicbench.benchmark.graph import make_imitate_stage, start, tracker_for_learning
from mimicbench.benchmark.judging import judge
from mimicbench.benchmark.keys import TRACKER
from mimicbench.benchmark.recipe import Recipe
from mimicbench.comparisons.spec import Comparison, Variant
from mimicbench.core.run import RunContext

if TYPE_CHECKING:
    from mimicbench.evaluate.rows import EpisodeRow


@dataclass(frozen=True)
class Compared:
    """A variant, judged."""

    variant: Variant
    folder: Path
    """Of what was learned, or of the shipped tracker."""
    rows: Sequence[EpisodeRow]


def compare(
    comparison: Comparison, recipes: Sequence[Recipe], workdir: Path | str, context: RunContext | None = None
) -> list[Compared]:
    """Learn and judge the variants of a comparison, one after the other.

    What is there already, of this or another comparison or run in the same folder, is not made again: killed, the same
    call goes on.

    Args:
        comparison: Whose variants.
        recipes: One for each of them (`comparisons.spec.recipe_of`).
        workdir: Where all stages go.
        context: How to run.

    Raises:
        MimicbenchError: A recipe contradicts itself, which is found out before any work, or a stage cannot be made.
    """
    context = context or RunContext()
    runs = [start(recipe, workdir, context) for recipe in recipes]
    found = []
    for variant, run in zip(comparison.variants, runs, strict=True):
        context.say(f"{comparison.name}: {variant.label}")
        if comparison.of == "track":
            folder, name = tracker_for_learning(run), TRACKER
        else:
            folder, name = make_imitate_stage(run).folder, run.part("imitate").learner
        found.append(Compared(variant, folder, judge(run, name)))
    return found
