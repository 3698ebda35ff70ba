"""Stages for tests: small ones of a recipe, and ones with what a test puts into them."""

from contextlib import contextmanager
from pathlib import Path

from mimicbench.benchmark import Recipe, run_stage
from mimicbench.core.run import RunContext
from mimicbench.core.stage import StageKey, opened
from mimicbench.objects.make import ObjectsConfig
from mimicbench.references.make import Places, make_references, used_objects
from mimicbench.references.settings import ReferencesConfig
from mimicbench.retarget.settings import RetargetConfig

QUIET = RunContext(workers=1, quiet=True)
QUICK = RetargetConfig(method="copy-rotation")
"""Ten times as fast as the method that is used unless another is asked for."""


def small(task="sit-chair", objects=3, clips=4, seed=0, **parts):
    """A small recipe, retargeted the quick way."""
    made = {"objects": ObjectsConfig(count=objects), "references": ReferencesConfig(count=clips), "retarget": QUICK}
    return Recipe(task, seed=seed, **{**made, **parts})


def make(stage, workdir, recipe=None):
    """A stage of a small recipe."""
    return run_stage(stage, recipe or small(), workdir, QUIET)


@contextmanager
def by_hand(folder, stage="references", task="sit-chair", settings=None, **more):
    """A stage in a folder that the test fills."""
    with opened(Path(folder), StageKey(stage, task, 0, settings or {}, **more)) as one:
        yield one


def references_by(folder, objects, fulfils, count):
    """Human clips on the objects of a stage, of which `fulfils` holds."""
    settings = {"objects_used": None, "test_only": False}
    with by_hand(folder, settings=settings, amounts={"count": count}) as stage:
        if stage.complete:
            return stage
        ids = used_objects(objects.folder, ReferencesConfig())
        return make_references(stage, ids, Places(objects.folder, fulfils), count, QUIET)
