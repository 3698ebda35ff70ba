"""More clips from a clip: mirrored, at another speed, from another start, on an object of another size.

Contacts stay what they were.

Each function gives the clip, and the object that it is on, under ids that end in `~` and what was done to them.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.interpolate import CubicSpline

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion, MimicbenchError
from mimicbench.core.motion import HumanMotion
from mimicbench.core.parallel import map_items
from mimicbench.core.run import RunContext
from mimicbench.core.seeds import rng
from mimicbench.core.settings import identity
from mimicbench.core.skeleton import Skeleton
from mimicbench.core.stage import Stage, StageKey, opened
from mimicbench.objects.make import object_ids, read_objects
from mimicbench.objects.shape import SceneObject, load_object, save_object
from mimicbench.objects.stretch import stretched
from mimicbench.references.checks.quality import Fulfils, check_clip, gate
from mimicbench.references.warp import approach_end, rescaled, turned_approach
from mimicbench.robots.mirror import SPECULAR, SPECULAR_QUAT, mirrored_labels, other_side, toggled

Kind = Literal["mirror", "speed", "start", "size"]
LATERAL = ("turn", "seat_y", "twist", "tilt", "askew", "first", "habits", "uneven", "later_hand", "later_leg")
"""Choices of a clip's style that change their sign in a mirror."""


@dataclass(frozen=True)
class AugmentConfig:
    """What is made of every clip."""

    kinds: tuple[Kind, ...] = ("mirror", "speed", "start", "size")
    copies: int = 1
    """Variants of each kind; there is one mirror image, whose own variants come as well if this is more than one."""
    speed: tuple[float, float] = (0.85, 1.15)
    """Times as fast."""
    turn: float = 0.3
    """The way to the object comes from so much farther around it, to either side [rad]."""
    shift: float = 0.12
    """And from so much farther to any side [m]."""
    size: tuple[float, float] = (0.94, 1.06)
    """Times as large is the object."""


def mirrored_joints(skeleton: Skeleton) -> list[int]:
    """For each joint the one on the other side. Raises BadMotion if it has none.

    How long its bones are may differ by side, as people's do.
    """
    names = list(skeleton.joint_names)
    found = []
    for name in names:
        other = name
        for left, right in (("left", "right"), ("Left", "Right")):
            if left in name:
                other = name.replace(left, right)
            elif right in name:
                other = name.replace(right, left)
        found.append(names.index(other) if other in names else -1)
    above = np.array(skeleton.parents)
    if -1 in found or (above[found] != np.where(above < 0, -1, np.array(found)[above])).any():
        raise BadMotion(
            f"skeleton {skeleton.name} has other joints on its left than on its right: it has no mirror image"
        )
    return found


def mirror(motion: HumanMotion, obj: SceneObject) -> tuple[HumanMotion, SceneObject]:
    """Left and right exchanged, of the person, the object and the goals. Twice gives the same clip again."""
    columns = mirrored_labels(motion.id, motion.contact_names)
    joints = mirrored_joints(motion.skeleton)
    quat = motion.local_quat[:, joints] * SPECULAR_QUAT
    other = mirrored_object(obj)
    return replace(
        motion,
        id=toggled(motion.id),
        object_id=other.id,
        skeleton=replace(motion.skeleton, offsets=motion.skeleton.offsets[joints] * SPECULAR),
        root_pos_w=motion.root_pos_w * SPECULAR,
        local_quat=quat,
        contacts=motion.contacts[:, columns] if columns else motion.contacts,
        style={other_side(name): -value if name in LATERAL else value for name, value in motion.style.items()},
        object_pos_w=motion.object_pos_w * SPECULAR,
        object_quat_w=motion.object_quat_w * SPECULAR_QUAT,
        wrist_goal_w=motion.wrist_goal_w[::-1] * SPECULAR,
    ), other


def mirrored_object(obj: SceneObject) -> SceneObject:
    """The object with its left on its right. Twice gives the same object again."""
    return replace(
        obj,
        id=toggled(obj.id),
        box_pos=obj.box_pos * SPECULAR,
        box_quat=obj.box_quat * SPECULAR_QUAT,
        seat_polygon=obj.seat_polygon[::-1] * SPECULAR[:2],
        head_xy=obj.head_xy * SPECULAR[: len(obj.head_xy)],
        touch_points=obj.touch_points * SPECULAR,
        touch_normals=obj.touch_normals * SPECULAR,
        hulls=tuple(hull * SPECULAR for hull in obj.hulls),
    )


def retime(motion: HumanMotion, factor: float) -> HumanMotion:
    """The same motion, so many times as fast, at the same frame rate. First and last frame stay what they are."""
    frames = round((motion.frames - 1) / factor) + 1
    if frames < 2:
        raise BadMotion(f"clip {motion.id} is too short to be {factor:.2g} times as fast")
    times = np.linspace(0, motion.frames - 1, frames)
    nearest = np.round(times).astype(int)

    def smoothly(values: np.ndarray) -> np.ndarray:
        return CubicSpline(np.arange(len(values)), values, axis=0)(times) if len(values) else values

    return replace(
        motion,
        id=f"{motion.id}~speed",
        root_pos_w=smoothly(motion.root_pos_w),
        local_quat=_smooth_quat(motion.local_quat, smoothly),
        contacts=motion.contacts[nearest] if motion.contact_names else motion.contacts,
        style={**motion.style, "retimed": factor},
        object_pos_w=smoothly(motion.object_pos_w),
        object_quat_w=_smooth_quat(motion.object_quat_w, smoothly),
    )


def restart(motion: HumanMotion, turn: float, shift: np.ndarray) -> HumanMotion:
    """The same action after a way that begins elsewhere: turned about where it ends by `turn` [rad], and shifted by
    (2,) [m].

    Feet stand as still as before, and legs reach them as far as they are long. Raises BadMotion if nobody walks up to
    the object.
    """
    return replace(turned_approach(motion, approach_end(motion), turn, shift), id=f"{motion.id}~start")


def resize(motion: HumanMotion, obj: SceneObject, factor: float) -> tuple[HumanMotion, SceneObject]:
    """The object so many times as large.

    What touched it touches the same place of it, and the way there is moved along.
    """
    other = resized_object(obj, factor)
    return replace(rescaled(motion, obj, factor), id=f"{motion.id}~size", object_id=other.id), other


def resized_object(obj: SceneObject, factor: float) -> SceneObject:
    """The object so many times as large, and as heavy as it was."""
    return stretched(obj, f"{obj.id}~x{factor:.4f}", np.full(3, factor))


def variant(
    motion: HumanMotion, obj: SceneObject, kind: Kind, config: AugmentConfig, seed: int, copy: int = 0
) -> tuple[HumanMotion, SceneObject]:
    """A variant of a clip; depends on the clip's id, the kind, the seed and the number of the copy alone.

    Raises BadMotion if there is none.
    """
    random = rng(seed, motion.id, kind, *((copy,) if copy else ()))
    if kind == "mirror":
        return mirror(motion, obj)
    if kind == "speed":
        return retime(motion, random.uniform(*config.speed)), obj
    if kind == "start":
        away = config.shift * np.sqrt(random.uniform())
        angle = random.uniform(-np.pi, np.pi)
        return restart(
            motion, random.uniform(-config.turn, config.turn), away * np.array([np.cos(angle), np.sin(angle)])
        ), obj
    return resize(motion, obj, random.uniform(*config.size))


@dataclass(frozen=True)
class ClipSource:
    """The clips that variants are made of, and their objects."""

    objects: Stage
    references: Stage
    clips: Sequence[Path]


def make_augmented(
    workdir: Path, name: str, source: ClipSource, config: AugmentConfig, fulfils: Fulfils, context: RunContext
) -> Stage:
    """The clips of a stage and good variants of them: the set `name` of objects and of references.

    Killed and started again, it makes what is missing. Raises MimicbenchError if that is the name of the set that they
    are made of.
    """
    header = source.references.header
    task, seed = header["task"], header["seed"]
    if source.references.folder == workdir / task / "references" / name:
        raise MimicbenchError(f"the variants of {name!r} need a name of their own; give one with --to")
    made_from = {"objects": source.objects.fingerprint, "references": source.references.fingerprint}
    key = StageKey("objects", task, seed, identity(config), made_from, reads={"objects": source.objects.folder})
    with opened(workdir / task / "objects" / name, key) as there:
        made_from = {"objects": there.fingerprint, "references": source.references.fingerprint}
        key = StageKey("references", task, seed, identity(config), made_from, reads={"objects": there.folder})
        with opened(workdir / task / "references" / name, key) as stage:
            if stage.complete and there.complete:
                return stage
            for obj in read_objects(source.objects.folder).values():
                save_object(there.folder, obj)
            places = (there.folder, stage.folder, source.objects.folder)
            work = partial(_augment_one, places, fulfils, config, seed)
            kept = map_items(work, source.clips, context.workers, "variants of clips", context.quiet)
            there.finish(count=len(object_ids(there.folder)))
            if stage.complete:
                return stage  # only objects of its clips were gone
            added = {kind: sum(names.count(kind) for names in kept) for kind in config.kinds}
            return stage.finish(clips=len(source.clips) + sum(added.values()), originals=len(source.clips), **added)


def _augment_one(
    places: tuple[Path, Path, Path], fulfils: Fulfils, config: AugmentConfig, seed: int, path: Path
) -> list[str]:
    """Save a clip and those of its good variants that are not there yet; which kinds are good."""
    objects_to, references_to, objects = places
    motion = HumanMotion.load(path)
    obj = load_object(objects, motion.object_id)
    original, good = check_clip(motion, obj), []
    for one, on, kind, copy in _variants_of(motion, obj, config):
        name = _variant_id(one.id, kind, copy)
        if (there := references_to / f"{name}.npz").exists() and _has_object(objects_to, there):
            good.append(kind)
            continue
        try:
            other, other_obj = variant(one, on, kind, config, seed, copy)
        except BadMotion:
            continue
        if not gate(other, other_obj, fulfils, original=original):
            save_object(objects_to, other_obj)
            replace(other, id=name).save(there)
            good.append(kind)
    if not (references_to / path.name).exists():
        motion.save(references_to / path.name)
    return good


def _has_object(objects: Path, clip: Path) -> bool:
    """Whether the object of a clip is there."""
    return (objects / f"{HumanMotion.load(clip).object_id}.json").exists()


def _variant_id(name: str, kind: str, copy: int) -> str:
    """Of a variant of the clip that is called so."""
    return f"{toggled(name) if kind == 'mirror' else f'{name}~{kind}'}{copy + 1 if copy else ''}"


def _variants_of(
    motion: HumanMotion, obj: SceneObject, config: AugmentConfig
) -> Iterator[tuple[HumanMotion, SceneObject, Kind, int]]:
    """What variants are made of: clip, object, kind, and number of the copy."""
    if "mirror" in config.kinds:
        yield motion, obj, "mirror", 0
    sides = [(motion, obj)]
    if config.copies > 1 and "mirror" in config.kinds:
        with suppress(BadMotion):
            sides.append(mirror(motion, obj))
    for one, on in sides:
        for kind in config.kinds:
            if kind != "mirror":
                for copy in range(config.copies):
                    yield one, on, kind, copy


def _smooth_quat(quat: np.ndarray, smoothly: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
    """Quaternions (T, ..., 4) between frames: a curve through each component, kept on one side and of unit length."""
    if len(quat) < 2:
        return quat
    same = (quat[1:] * quat[:-1]).sum(-1, keepdims=True) >= 0
    signs = np.cumprod(np.concatenate([np.ones_like(same[:1], float), np.where(same, 1.0, -1.0)]), axis=0)
    return rot.normalize(smoothly(quat * signs))
