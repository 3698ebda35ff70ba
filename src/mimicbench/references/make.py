"""Stage `references`: human clips on objects, made or imported, each one checked."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

from mimicbench.core.errors import BadMotion
from mimicbench.core.motion import HumanMotion
from mimicbench.core.parallel import map_items
from mimicbench.core.stage import Stage, open_stage
from mimicbench.objects.make import read_objects
from mimicbench.objects.shape import SceneObject, load_object, save_object
from mimicbench.references.quality import check_clip, is_good
from mimicbench.references.synthesis import clip_id, synthesize
from mimicbench.references.unihsi import import_sitting


@dataclass(frozen=True)
class ReferencesConfig:
    """How many clips to make."""

    count: int = 2000
    """Clips to try, spread evenly over the objects; those that fail the quality gate are left out."""
    test_only: bool = False
    """Use the objects of the test split alone: for an evaluation without training."""


def make_references(folder: Path, objects: Stage, task: str, config: ReferencesConfig, seed: int, workers: int, quiet: bool = False) -> Stage:
    """Make human clips on the objects of an earlier stage, one `<id>.npz` each.

    Killed and started again, it makes only the clips that are missing. Raises BadMotion if none passes the gate.
    """
    stage = open_stage(folder, "references", task, seed, asdict(config), {"objects": objects.fingerprint})
    if stage.complete:
        return stage
    ids = [obj.id for obj in read_objects(objects.folder).values() if obj.split == "test" or not config.test_only]
    jobs = [(index, ids[index % len(ids)]) for index in range(config.count)]
    kept = map_items(partial(_make_one, folder, objects.folder, task, seed), jobs, workers, "human clips", quiet)
    if not any(kept):
        raise BadMotion(f"none of {len(jobs)} clips passed the quality gate; make more objects or clips")
    return stage.finish(tried=len(jobs), kept=sum(kept), rate=sum(kept) / len(jobs))


def _make_one(folder: Path, objects: Path, task: str, seed: int, job: tuple[int, str]) -> bool:
    index, object_id = job
    path = folder / f"{clip_id(task, index, seed)}.npz"
    if path.exists():
        return True
    obj = load_object(objects, object_id)
    motion = synthesize(task, index, obj, seed)
    if not is_good(check_clip(motion, obj)):
        return False
    motion.save(path)
    return True


def import_references(objects_folder: Path, folder: Path, task: str, files: Sequence[Path], say: Callable[[str], None]) -> tuple[Stage, Stage]:
    """Import recordings of people who sit down, with a chair fitted under each: stages `objects` and `references` made from files.

    A recording without the task in it is left out, and `say` hears why. Raises BadMotion if nothing is left, before
    anything is written.
    """
    clips: list[tuple[HumanMotion, SceneObject]] = []
    for path in files:
        try:
            found = import_sitting(path)
        except BadMotion as error:
            say(f"left out: {error}")
            continue
        clips += found
        say(f"{path.name}: {len(found)} sitting {'clip' if len(found) == 1 else 'clips'}")
    if not clips:
        raise BadMotion(f"none of the {len(files)} files holds a person who walks to a seat and sits down")
    source = {"imported": [path.name for path in files]}
    objects = open_stage(objects_folder, "objects", task, 0, source)
    references = open_stage(folder, "references", task, 0, source, {"objects": objects.fingerprint})
    for motion, obj in clips:
        save_object(objects_folder, obj)
        motion.save(folder / f"{motion.id}.npz")
    return objects.finish(count=len(clips)), references.finish(kept=len(clips), seconds=sum(motion.duration for motion, _ in clips))
