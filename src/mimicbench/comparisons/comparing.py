"""A comparison, carried out: each variant is learned, unless it is there, and judged on the same episodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from mimicbench.benchmark.graph import make_imitate_stage, make_track_stage, start, tracker_for_learning
from mimicbench.benchmark.judging import judge
from mimicbench.benchmark.keys import CHECKPOINT, TRACKER, Run, tracker_folder
from mimicbench.benchmark.recipe import Recipe
from mimicbench.benchmark.who import who_of
from mimicbench.comparisons.spec import Comparison, Variant
from mimicbench.core.errors import MimicbenchError
from mimicbench.core.files import digest_of_json
from mimicbench.core.run import RunContext
from mimicbench.core.settings import identity

if TYPE_CHECKING:
    from mimicbench.evaluate.rows import EpisodeRow


@dataclass(frozen=True)
class Compared:
    """A variant, judged."""

    variant: Variant
    folder: Path | None
    """Of what was learned, or of the shipped tracker."""
    rows: Sequence[EpisodeRow]
    """Empty where it could not be judged."""
    problem: str = ""
    """Why, in a sentence."""


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

    Variants that train no tracker of their own, and say nothing different of one, have the same: that of the first of
    these recipes, for another's clips would otherwise mean another one.

    A variant that cannot be learned or judged, such as one whose clips all fail, does not keep the others from it.

    Raises:
        MimicbenchError: A recipe contradicts itself, which is found out before any work, or no variant could be judged.
    """
    context = context or RunContext()
    runs = [start(recipe, workdir, context) for recipe in recipes]
    found, trackers = [], dict[str, Path]()
    for variant, begun in zip(comparison.variants, runs, strict=True):
        context.say(f"{comparison.name}: {variant.label}")
        kind = digest_of_json(identity(begun.part("track")))
        shares = comparison.of != "track" or not comparison.learns
        run = replace(begun, tracker=trackers.get(kind)) if shares else begun
        try:
            found.append(_judged(comparison, variant, run))
            if shares and (used := tracker_folder(run)) is not None:
                trackers.setdefault(kind, used)
        except MimicbenchError as error:
            context.say(f"{variant.label}: {error}")
            found.append(Compared(variant, None, (), str(error)))
    if not any(one.rows for one in found):
        raise MimicbenchError(f"no variant of {comparison.name} could be judged: {found[0].problem}")
    return found


def on_shared_clips(found: Sequence[Compared]) -> list[Compared] | None:
    """The same, with the rows of those clips alone that everybody who was judged has; None if all have the same.

    Each way to retarget keeps other clips, so that rates of all clips are not of the same people and objects.
    """
    clips = [{_clip(row) for row in one.rows} for one in found if one.rows]
    shared = set.intersection(*clips)
    if all(some == shared for some in clips):
        return None
    return [replace(one, rows=[row for row in one.rows if _clip(row) in shared]) for one in found]


def _clip(row: EpisodeRow) -> tuple[str, str]:
    return row.reference_id, row.object_id


def _judged(comparison: Comparison, variant: Variant, run: Run) -> Compared:
    if comparison.of == "track":
        # whoever learns does so here: a shipped tracker of the same recipe has learned for longer than its rivals
        folder = make_track_stage(run).folder / CHECKPOINT if comparison.learns else tracker_for_learning(run)
        name = TRACKER
    else:
        name = run.part("imitate").learner
        folder = make_imitate_stage(run).folder if comparison.learns else who_of(run, name).folder
    return Compared(variant, folder, judge(run, name))
