"""Stage `references`: human clips on objects, made or imported, each one checked."""

import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from mimicbench.core.errors import BadFile, BadMotion
from mimicbench.core.motion import HumanMotion
from mimicbench.core.names import printable
from mimicbench.core.parallel import map_items
from mimicbench.core.stage import HEADER, Stage, open_stage
from mimicbench.objects.shape import SceneObject, load_object, save_object, split_of
from mimicbench.references.checks.quality import METRIC, Fulfils, check_clip, faults, gate, told
from mimicbench.references.importers.recording import Wishes
from mimicbench.references.importers.registry import import_recording
from mimicbench.references.recordings.real_clips import Clip, find_clips
from mimicbench.references.synthesis.registry import clip_id, synthesize

MOST_TRIES = 3
"""Times as many clips as wanted that are tried before the stage makes do with what it has."""


@dataclass(frozen=True)
class ReferencesConfig:
    """How many clips to make."""

    count: int = 2000
    """Good clips to have, spread evenly over the objects: what fails the quality gate is replaced by further clips."""
    test_only: bool = False
    """Use the objects of the test split alone: for an evaluation without training."""


def make_references(
    folder: Path,
    objects: Stage,
    task: str,
    fulfils: Fulfils,
    config: ReferencesConfig,
    seed: int,
    workers: int,
    quiet: bool = False,
) -> Stage:
    """Make human clips on the objects of an earlier stage, one `<id>.npz` each, and keep those that pass the gate
    and fulfil the task's K.

    Killed and started again, it makes only the clips that are missing. The summary counts by name what was wrong with
    the others.
    Raises BadMotion if none is good.
    """
    stage = open_stage(folder, "references", task, seed, asdict(config), {"objects": objects.fingerprint})
    if stage.complete:
        return stage
    ids = object_ids(objects.folder, config)
    tried, kept, wrong = 0, 0, Counter[str]()
    while kept < config.count and tried < MOST_TRIES * config.count:
        missing = min(config.count - kept, MOST_TRIES * config.count - tried)
        jobs = [(index, ids[index % len(ids)]) for index in range(tried, tried + missing)]
        found = map_items(
            partial(_make_one, folder, objects.folder, task, seed, fulfils), jobs, workers, "human clips", quiet
        )
        tried, kept = tried + missing, kept + found.count([])
        wrong.update(name for names in found for name in names)
        if not kept:
            break
    if not kept:
        raise BadMotion(
            f"none of {tried} clips passed the quality gate ({_counted(wrong)}); make more objects or clips"
        )
    return stage.finish(tried=tried, kept=kept, rate=kept / max(tried, 1), rejected_for=_counted(wrong) or "nothing")


def object_ids(objects: Path, config: ReferencesConfig) -> list[str]:
    """Objects that clips are made on, in the order in which they take turns: clip number i is on object i modulo
    their number.
    """
    ids = sorted(path.stem for path in objects.glob("*.json") if path.name != HEADER)
    return [object_id for object_id in ids if split_of(object_id) == "test" or not config.test_only]


def remake(references: Stage, objects: Path, name: str, fulfils: Fulfils) -> tuple[HumanMotion, list[str]]:
    """The clip of a stage that an id names, made again from nothing but the id, and what the gate says about it.

    Raises BadMotion if the stage does not make such a clip.
    """
    header = references.header
    match = re.fullmatch(rf"{re.escape(header['task'])}-{header['seed']}-(\d{{5}}|[1-9]\d{{5,8}})", name)
    if match is None or "count" not in header["config"]:
        example = clip_id(header["task"], 42, header["seed"])
        raise BadMotion(f"{name!r} names no synthetic clip of {references.folder}; its ids look like {example}")
    ids = object_ids(objects, ReferencesConfig(**header["config"]))
    index = int(match[1])
    obj = load_object(objects, ids[index % len(ids)])
    motion = synthesize(header["task"], index, obj, header["seed"])
    return motion, gate(motion, obj, fulfils)


def _make_one(folder: Path, objects: Path, task: str, seed: int, fulfils: Fulfils, job: tuple[int, str]) -> list[str]:
    """What is wrong with a clip, which is on disk if that is nothing."""
    index, object_id = job
    path = folder / f"{clip_id(task, index, seed)}.npz"
    if path.exists():
        return []
    obj = load_object(objects, object_id)
    motion = synthesize(task, index, obj, seed)
    wrong = gate(motion, obj, fulfils)
    if not wrong:
        motion.save(path)
    return wrong


def _counted(wrong: Counter[str]) -> str:
    """Such as `object_depth 12, K 3`."""
    return ", ".join(
        f"{name} {count}" for name, count in sorted(wrong.items(), key=lambda entry: (-entry[1], entry[0]))
    )


@dataclass(frozen=True)
class ImportConfig:
    """How to import recordings."""

    form: str = "auto"
    """One of the formats in references/importers, or `auto`."""
    wishes: Wishes = field(default_factory=Wishes)
    """What the user knows of the files."""
    gated: bool = False
    """Leave out clips that the gate would not let pass from a synthetic person."""


def import_references(
    objects_folder: Path,
    folder: Path,
    task: str,
    fulfils: Fulfils,
    files: Sequence[Path],
    say: Callable[[str], None],
    config: ImportConfig | None = None,
) -> tuple[Stage, Stage]:
    """Import recordings of people who do a task: stages `objects` and `references` made from files of the formats in
    references/importers.

    Each clip has the recorded object, or one fitted to the person. `say` hears what was assumed about every file, and
    what the gate would not let pass from a synthetic person. A file that cannot be read, or without the task in it, is
    left out, and `say` hears why. Raises BadMotion if nothing is left, before anything is written.
    """
    config = config or ImportConfig()
    clips: dict[str, Clip] = {}
    beyond = Counter[str]()
    for path in files:
        try:
            recording = import_recording(path, config.form, config.wishes)
            found = find_clips(recording, task)
        except (BadFile, BadMotion) as error:
            if len(files) == 1:
                raise
            say(f"left out: {error}")
            continue
        if set(clips) & {motion.id for motion, _ in found}:
            say(f"left out: {printable(str(path))} has the name of another file; rename it")
            continue
        say(
            f"{printable(path.name)}: {len(found)} {task} {'clip' if len(found) == 1 else 'clips'} of "
            f"{recording.frames / recording.fps:.1f} s"
        )
        for line in recording.assumed:
            say(f"  {line}")
        for motion, obj in found:
            wrong = _say_clip(motion, obj, fulfils, say)
            beyond.update(wrong)
            if not (wrong and config.gated):
                clips[motion.id] = (motion, obj)
    if not clips:
        raise BadMotion(
            f"none of the {len(files)} files holds a person who does {task}, see above; give other "
            f"files, or another task (--task){', or leave --gate out' if config.gated and beyond else ''}"
        )
    source = {
        "imported": [path.name for path in files],
        "format": config.form,
        "wishes": asdict(config.wishes) | {"mesh": str(config.wishes.mesh)},
    } | ({"gated": True} if config.gated else {})
    objects = open_stage(objects_folder, "objects", task, 0, source)
    references = open_stage(folder, "references", task, 0, source, {"objects": objects.fingerprint})
    for motion, obj in clips.values():
        save_object(objects_folder, obj)
        motion.save(folder / f"{motion.id}.npz")
    seconds = sum(motion.duration for motion, _ in clips.values())
    return objects.finish(count=len(clips)), references.finish(
        kept=len(clips), seconds=seconds, beyond_gate=_counted(beyond) or "nothing"
    )


def _say_clip(motion: HumanMotion, obj: SceneObject, fulfils: Fulfils, say: Callable[[str], None]) -> list[str]:
    """Tell what a real clip is and what the gate has against it; its names."""
    size = np.ptp(obj.corners().reshape(-1, 3), axis=0)
    say(f"  {motion.id}: {motion.duration:.1f} s with a {obj.kind} of {size[0]:.2f} x {size[1]:.2f} x {size[2]:.2f} m")
    measures = check_clip(motion, obj)
    wrong = [*faults(measures), *([] if fulfils(motion, obj) else [METRIC])]
    if wrong:
        say(f"    the gate would not let this pass from a synthetic person: {told(measures, wrong)}")
    return wrong
