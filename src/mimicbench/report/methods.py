"""The same clips retargeted by every method: recipes side by side, which share all that comes before."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from mimicbench.benchmark.graph import clips_of, make_object_stage, make_reference_stage, make_retarget_stage, start
from mimicbench.benchmark.keys import Run
from mimicbench.benchmark.recipe import Recipe
from mimicbench.core.errors import BadMotion
from mimicbench.core.motion import HumanMotion, RobotMotion
from mimicbench.core.run import RunContext
from mimicbench.drawing.opengl import NoPictures, draw_apart
from mimicbench.objects.shape import load_object
from mimicbench.report.retargeting import Comparison, MethodResult, SideBySide, draw_side_by_side, write_comparison
from mimicbench.retarget.baselines.speed import frames_per_second
from mimicbench.retarget.clip import Clip
from mimicbench.retarget.registry import METHODS
from mimicbench.retarget.settings import RetargetConfig


def compare_methods(
    recipes: Sequence[Recipe], variant: str, workdir: Path, folder: Path, pictures: bool, context: RunContext
) -> Comparison:
    """The clips of each recipe by every method, in the variant where a method has it, with a page in `folder`.

    How many clips, a recipe's `references.count` says.
    """
    results, sides = [], {}
    for recipe in recipes:
        run = start(recipe, workdir, context)
        found, sides[recipe.task] = _compared(run, variant)
        results += found
    drawn = {}
    if pictures:
        try:
            shown = draw_apart(draw_side_by_side, list(sides.values()), context.workers, "drawing", context.quiet)
            drawn = dict(zip(sides, shown, strict=True))
        except NoPictures as error:
            context.say(str(error))
    comparison = Comparison(tuple(results))
    write_comparison(folder, comparison, {slug: (sides[slug].caption(), picture) for slug, picture in drawn.items()})
    return comparison


def _compared(run: Run, variant: str) -> tuple[list[MethodResult], SideBySide]:
    """What each method came to on a recipe's clips, and the first clip by all of them."""
    paths = clips_of(make_reference_stage(run))
    if not paths:
        raise BadMotion(f"there are no clips of {run.recipe.task} to compare methods on")
    human = HumanMotion.load(paths[0])
    obj = load_object(make_object_stage(run).folder, human.object_id)
    results, shown = [], {}
    for method in METHODS.all():
        used = method.preset(variant if variant in method.presets else None)  # pyright: ignore[reportArgumentType]
        config = replace(run.part("retarget") or RetargetConfig(), method=method.name, variant=used)
        stage = make_retarget_stage(run.changed(retarget=config))
        rate = frames_per_second([Clip(human, obj, run.robot)], method, used)
        results.append(MethodResult(run.recipe.task, method.name, used, dict(stage.summary), rate))
        shown[method.titled(used)] = RobotMotion.load(stage.folder / paths[0].name, run.robot.name)
    return results, SideBySide(obj, human, shown)
