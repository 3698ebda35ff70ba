"""Stage `references`: human clips on objects, made or imported, each one checked."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

from mimicbench.core.errors import BadMotion
from mimicbench.core.motion import HumanMotion
from mimicbench.core.parallel import map_items
from mimicbench.core.stage import Stage, open_stage
from mimicbench.objects.make import read_objects
from mimicbench.objects.shape import SceneObject, load_object, save_object
from mimicbench.references.synthesis import check_clip, clip_id, is_good, synthesize


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


def keep_imported(folder: Path, objects_folder: Path, task: str, clips: Sequence[tuple[HumanMotion, SceneObject]], source: Mapping[str, str]) -> Stage:
    """Store imported clips and their fitted objects as a stage of their own; `source` says which files they came from."""
    stage = open_stage(folder, "references", task, 0, {"imported": dict(source)})
    if stage.complete:
        return stage
    for motion, obj in clips:
        save_object(objects_folder, obj)
        motion.save(folder / f"{motion.id}.npz")
    return stage.finish(kept=len(clips))


def clip_paths(folder: Path) -> list[Path]:
    """Files of all clips of a stage, in order of their ids."""
    return sorted(folder.glob("*.npz"))
