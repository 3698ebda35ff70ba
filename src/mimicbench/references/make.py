"""Stage `references`: human clips on objects, made or imported, each one checked."""

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from mimicbench.core.errors import BadFile, BadMotion, BadObject
from mimicbench.core.files import digest_of
from mimicbench.core.motion import HumanMotion
from mimicbench.core.names import LONGEST, printable, safe_name
from mimicbench.core.parallel import map_items
from mimicbench.core.run import RunContext
from mimicbench.core.stage import Stage, StageKey, opened
from mimicbench.objects.make import object_ids
from mimicbench.objects.shape import SceneObject, load_object, save_object, split_of
from mimicbench.references.checks.quality import METRIC, Fulfils, check_clip, faults, gate, told
from mimicbench.references.importers.recording import Wishes
from mimicbench.references.importers.registry import files_read, import_recording
from mimicbench.references.recordings.cutting import Clip
from mimicbench.references.recordings.real_clips import find_clips
from mimicbench.references.settings import ReferencesConfig
from mimicbench.references.synthesis.registry import clip_id, synthesize

MOST_TRIES = 3
"""Times as many clips as wanted that are tried before the stage makes do with what it has."""
TRIED_OFTEN = 4
"""Clips on each object, after which one without any good clip is told of."""


@dataclass(frozen=True)
class Recordings:
    """Files of recorded people, and how to read them."""

    files: tuple[Path, ...]
    form: str = "auto"
    """Their format; `auto` finds it out."""
    wishes: Wishes = field(default_factory=Wishes)
    """What the user knows of the files."""
    gated: bool = False
    """Leave out clips that the gate would not let pass from a synthetic person."""


@dataclass(frozen=True)
class Places:
    """Where a stage of clips reads and writes, and by what it judges a clip."""

    objects: Path
    fulfils: Fulfils
    """Whether a person does the task in a clip."""


def make_references(stage: Stage, ids: Sequence[str], places: Places, count: int, context: RunContext) -> Stage:
    """Make human clips, one `<id>.npz` each, and keep those that pass the gate and fulfil the task's K.

    Clip number i is on the object i modulo their number of `ids`. Killed and started again, or asked for more, it makes
    only the clips that are missing. The summary counts by name what was wrong with the others. Raises BadMotion if
    none is good.
    """
    tried, kept, wrong, bare = 0, 0, Counter[str](), dict.fromkeys(ids)
    while kept < count and tried < MOST_TRIES * count:
        missing = min(count - kept, MOST_TRIES * count - tried)
        jobs = [(index, ids[index % len(ids)]) for index in range(tried, tried + missing)]
        work = partial(_make_one, stage.folder, places, stage.header)
        found = map_items(work, jobs, context.workers, "human clips", context.quiet)
        tried, kept = tried + missing, kept + found.count([])
        wrong.update(name for names in found for name in names)
        for (_, name), names in zip(jobs, found, strict=True):
            if not names:
                bare.pop(name, None)
        if not kept:
            break
    if not kept:
        raise BadMotion(
            f"none of {tried} clips passed the quality gate ({_counted(wrong)}); make more objects or clips, and of "
            "meshes of your own look whether their fronts are right (`mimicbench objects draw`)"
        )
    if bare and tried >= TRIED_OFTEN * len(ids):
        more = f" and {len(bare) - 5} more" if len(bare) > 5 else ""
        context.say(
            f"no clip on {', '.join(list(bare)[:5])}{more} was good; look whether their fronts are right "
            "(`mimicbench objects draw`)"
        )
    return stage.finish(tried=tried, kept=kept, rate=kept / max(tried, 1), rejected_for=_counted(wrong) or "nothing")


def used_objects(objects: Path, config: ReferencesConfig, count: int | None = None) -> list[str]:
    """Ids of the objects that clips are made on, in the order in which they take turns.

    Of the first `count` objects of a stage, or of all. Raises BadObject if there is none.
    """
    ids = [name for name in object_ids(objects)[:count] if split_of(name) == "test" or not config.test_only]
    if not ids:
        raise BadObject(
            f"{objects} has no object of the test split; make or import more, or judge beside all (--split all)"
        )
    return ids


def remake(references: Stage, objects: Path, name: str, fulfils: Fulfils) -> tuple[HumanMotion, list[str]]:
    """The clip of a stage that an id names, made again from nothing but the id, and what the gate says about it.

    Raises BadMotion if the stage does not make such a clip.
    """
    header = references.header
    match = re.fullmatch(rf"{re.escape(header['task'])}-{header['seed']}-(\d{{5}}|[1-9]\d{{5,8}})", name)
    if match is None or "objects_used" not in header["settings"]:
        example = clip_id(header["task"], 42, header["seed"])
        raise BadMotion(f"{name!r} names no synthetic clip of {references.folder}; its ids look like {example}")
    settings = header["settings"]
    ids = used_objects(objects, ReferencesConfig(test_only=settings["test_only"]), settings["objects_used"])
    index = int(match[1])
    obj = load_object(objects, ids[index % len(ids)])
    motion = synthesize(header["task"], index, obj, header["seed"], settings.get("alike", False))
    return motion, gate(motion, obj, fulfils)


def _make_one(folder: Path, places: Places, header: Mapping[str, Any], job: tuple[int, str]) -> list[str]:
    """What is wrong with a clip, which is on disk if that is nothing."""
    (index, object_id), task, seed = job, header["task"], header["seed"]
    path = folder / f"{clip_id(task, index, seed)}.npz"
    if path.exists():
        return []
    obj = load_object(places.objects, object_id)
    motion = synthesize(task, index, obj, seed, header["settings"].get("alike", False))
    wrong = gate(motion, obj, places.fulfils)
    if not wrong:
        motion.save(path)
    return wrong


def _counted(wrong: Counter[str]) -> str:
    """Such as `object_depth 12, K 3`."""
    return ", ".join(
        f"{name} {count}" for name, count in sorted(wrong.items(), key=lambda entry: (-entry[1], entry[0]))
    )


def import_references(
    workdir: Path, name: str, task: str, recordings: Recordings, fulfils: Fulfils, say: Callable[[str], None]
) -> tuple[Stage, Stage]:
    """Import recordings of people who do a task: the set `name` of objects and of references, made from files of the
    formats in references/importers.

    Each clip has the recorded object, or one fitted to the person. `say` hears what was assumed about every file, and
    what the gate would not let pass from a synthetic person. A file that cannot be read, or without the task in it, is
    left out, and `say` hears why. Raises BadMotion if nothing is left, before anything is written.
    """
    if not recordings.files:
        raise BadMotion("there is nothing to import; give at least one file of a recorded person")
    clips, beyond = _found_clips(recordings, task, fulfils, say)
    if not clips:
        raise BadMotion(
            f"none of the {len(recordings.files)} files holds a person who does {task}, see above; give other "
            f"files, or another task (--task){', or leave --gate out' if recordings.gated and beyond else ''}"
        )
    wishes = recordings.wishes
    read = {f"{i} {one.name}": one for i, path in enumerate(recordings.files) for one in files_read(path, wishes)}
    files = {name: digest_of(one) for name, one in read.items()}
    source = {"imported": files, "format": recordings.form, "wishes": asdict(wishes) | {"mesh": str(wishes.mesh)}}
    source |= {"gated": True} if recordings.gated else {}
    key = StageKey("objects", task, 0, source)
    with opened(workdir / task / "objects" / name, key) as objects:
        for _, obj in clips.values():
            save_object(objects.folder, obj)
        objects = objects.finish(count=len(clips))
    key = StageKey("references", task, 0, source, {"objects": objects.fingerprint}, reads={"objects": objects.folder})
    with opened(workdir / task / "references" / name, key) as references:
        for motion, _ in clips.values():
            motion.save(references.folder / f"{motion.id}.npz")
        seconds = sum(motion.duration for motion, _ in clips.values())
        summary = {"kept": len(clips), "seconds": seconds, "beyond_gate": _counted(beyond) or "nothing"}
        return objects, references.finish(**summary)


def _found_clips(
    recordings: Recordings, task: str, fulfils: Fulfils, say: Callable[[str], None]
) -> tuple[dict[str, Clip], Counter[str]]:
    """The clips in recordings by id, and what the gate has against them; says what was assumed about each file, and why
    one is left out.
    """
    clips: dict[str, Clip] = {}
    beyond = Counter[str]()
    for path, apart in zip(recordings.files, _told_apart(recordings.files), strict=True):
        try:
            recording = import_recording(path, recordings.form, recordings.wishes)
            recording = replace(recording, name=f"{recording.name[: LONGEST - len(apart)]}{apart}")
            found = find_clips(recording, task)
        except (BadFile, BadMotion) as error:
            if len(recordings.files) == 1:
                raise
            say(f"left out: {error}")
            continue
        if set(clips) & {motion.id for motion, _ in found}:
            say(f"left out: {printable(str(path))} is given twice, or is a copy of another file; give it once")
            continue
        say(
            f"{printable(path.name)}: {len(found)} {task} {'clip' if len(found) == 1 else 'clips'} of "
            f"{recording.frames / recording.fps:.1f} s"
        )
        for line in recording.assumed:
            say(f"  {line}")
        for motion, obj in found:
            wrong = _say_clip(motion, obj, fulfils, recordings.gated, say)
            beyond.update(wrong)
            if not (wrong and recordings.gated):
                clips[motion.id] = (motion, obj)
    return clips, beyond


def _told_apart(files: Sequence[Path]) -> list[str]:
    """What to put behind each recording's name: some digits of its content where others are called the same, as all of
    CORE4D's are, and all whose names have no Latin letters; nothing elsewhere.
    """
    names = [safe_name(path.stem) for path in files]
    return [
        f"-{digest_of(path)[:8]}" if names.count(name) > 1 and path.is_file() else ""
        for path, name in zip(files, names, strict=True)
    ]


def _say_clip(
    motion: HumanMotion, obj: SceneObject, fulfils: Fulfils, gated: bool, say: Callable[[str], None]
) -> list[str]:
    """Tell what a real clip is and what the gate has against it; its names."""
    size = np.ptp(obj.corners().reshape(-1, 3), axis=0)
    sides = " x ".join(f"{side:.2f}" for side in size)
    say(f"  {motion.id}: {motion.duration:.1f} s with a {obj.family} ({obj.kind}) of {sides} m")
    measures = check_clip(motion, obj)
    wrong = [*faults(measures), *([] if fulfils(motion, obj) else [METRIC])]
    if wrong:
        then = "left out" if gated else "kept; --gate leaves such clips out"
        say(f"    the gate would not let this pass from a synthetic person: {told(measures, wrong)}; {then}")
    return wrong
