"""Opening an item: what it is made of is read, and nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from mimicbench.core.errors import BadFile
from mimicbench.core.motion import HumanMotion, RobotMotion
from mimicbench.objects.shape import SceneObject, load_object
from mimicbench.robots.description import Robot
from mimicbench.robots.registry import DEFAULT_ROBOT, ROBOTS
from mimicbench.sim.timing import CONTROL_DT
from mimicbench.tasks.registry import TASKS
from mimicbench.tasks.task import Task
from mimicbench.viewer.catalog import Catalog, ItemSet, outcome
from mimicbench.viewer.methods import TRACKER, gains_of
from mimicbench.viewer.tracks import Recording, StoredTrack, human_track, recorded_track, robot_track

if TYPE_CHECKING:
    from mimicbench.evaluate.rows import EpisodeRow

EXPERT = "expert_checkpoint"
"""What demonstrations call the policy that made them, if none of the recipe's trackers did."""


@dataclass(frozen=True)
class Opened:
    """An item, and what belongs to it."""

    name: str
    task: Task
    robot: Robot
    obj: SceneObject
    facts: tuple[str, ...]
    """What is worth knowing of it, a line each."""
    details: tuple[str, ...]
    """What else is known of it."""
    tracks: dict[str, StoredTrack]
    """By what they are: `human`, `retargeted`, `robot`."""
    wrist_goal_w: np.ndarray
    """(2, 3) where wrists are to go, NaN for one without a goal [m]; (0, 3) if neither has one."""
    clip: RobotMotion | None = None
    """What a tracker can follow, and in whose first frame a policy can begin."""
    policy: str | None = None
    """Whose episode it is: to be acted out again, for its states are not stored."""
    made_from: Mapping[str, Any] = field(default_factory=dict)
    """Of an episode: what its row depends on, as far as the file says."""


def open_item(catalog: Catalog, one: ItemSet, item: str) -> Opened:
    """Read an item of a set. Raises BadFile, BadMotion or BadObject."""
    return _OPENERS[one.kind](catalog, one, item)


def _open_object(catalog: Catalog, one: ItemSet, item: str) -> Opened:
    return _object(one, item, item, ROBOTS.get(DEFAULT_ROBOT))


def _object(one: ItemSet, object_id: str, name: str, robot: Robot) -> Opened:
    """One of a set of objects, beside which there is no clip."""
    one.file(object_id)  # the name may come from a file: it must be one of those that there are
    obj = load_object(one.path, object_id)
    return Opened(name, TASKS.get(one.task), robot, obj, object_facts(obj), (), {}, np.zeros((0, 3)))


def _open_reference(catalog: Catalog, one: ItemSet, item: str) -> Opened:
    human = HumanMotion.load(one.file(item))
    for made in catalog.sets(one.task, "retarget"):
        with suppress(BadFile):  # a set whose people are gone says nothing of these
            if item in made.places and catalog.read_by(made, "references") is one:
                return _clip(catalog, made, human, RobotMotion.load(made.file(item)), item)
    return _clip(catalog, one, human, None, item)


def _open_retargeted(catalog: Catalog, one: ItemSet, item: str) -> Opened:
    motion = RobotMotion.load(one.file(item))
    return _clip(catalog, one, _human_of(catalog, one, motion), motion, item)


def _open_demonstration(catalog: Catalog, one: ItemSet, item: str) -> Opened:
    from mimicbench.imitate.lerobot import DATASET, load_episode

    number = one.places.get(item)
    if number is None:
        raise BadFile(f"{one.path} has no {item!r}; open the page anew if it was just made")
    demo, row = load_episode(one.path / DATASET, number)
    if "objects" in one.header.get("reads", {}):  # a start was drawn beside one of them, for who follows no clip
        robot = ROBOTS.get(one.header.get("recipe", {}).get("robot", DEFAULT_ROBOT))
        found = _object(catalog.read_by(one, "objects"), row["object_id"], item, robot)
    else:
        clips = catalog.read_by(one, "retarget")
        motion = RobotMotion.load(clips.file(row["reference_id"]))
        found = _clip(catalog, clips, _human_of(catalog, clips, motion), motion, item)
    gains, told_gains = _gains_of(catalog, one, found)
    recording = Recording(demo["qpos"], demo["qvel"], demo["executed_action"], gains)
    track = recorded_track("demonstration", found.task, found.obj, found.robot, recording, found.wrist_goal_w)
    told = "fulfills K" if row["success"] else "does not fulfill K"
    told = f"demonstration {number}: {told}, {row['length'] * CONTROL_DT:.1f} s"
    return _with(found, {"robot": track}, told, *told_gains)


def _open_episode(catalog: Catalog, one: ItemSet, item: str) -> Opened:
    if item not in one.places:
        raise BadFile(f"{one.path} has no {item!r}; open the page anew if it was just made")
    row = one.rows[one.places[item]]
    clips, motion = _beginning(catalog, one, row)
    found = _clip(catalog, clips, _human_of(catalog, clips, motion), motion, item)
    told = f"as judged: {outcome(row)}; largest e {row.max_energy:.3g} W²"
    # of some episodes the motion was kept; a row comes from a file, and could name one anywhere
    file = one.path.with_suffix("") / f"{row.id}.npz"
    tracks = {}
    if row.task == one.task and file.is_file():
        done = RobotMotion.load(file, found.robot.name)
        tracks["robot"] = robot_track(found.task, done, found.obj, found.robot, f"{row.policy}, as judged")
    return replace(_with(found, tracks, told), policy=row.policy, made_from=one.made_from)


def _beginning(catalog: Catalog, one: ItemSet, row: EpisodeRow) -> tuple[ItemSet, RobotMotion]:
    """The clip in whose first frame an episode began, and its set. Raises BadFile if it is gone.

    Clips to learn from, to be judged on, and of every method have the same names, and not the same objects. Rows say by
    digest which clips they are of, and a stage's folder ends in its own; where none does, it is one with that object.
    """
    digest = f"-{one.made_from.get('clips')}"
    having = [made for made in catalog.sets(one.task, "retarget") if row.reference_id in made.places]
    for made in sorted(having, key=lambda made: not made.name.endswith(digest)):
        motion = RobotMotion.load(made.file(row.reference_id))
        if (motion.object_id, motion.robot) == (row.object_id, row.robot):
            return made, motion
    raise BadFile(
        f"no clip {row.reference_id} beside {row.object_id} is left to begin {row.id} from; run `mimicbench evaluate` "
        "again"
    )


_OPENERS = {
    "objects": _open_object,
    "references": _open_reference,
    "retarget": _open_retargeted,
    "demos": _open_demonstration,
    "evaluate": _open_episode,
}


def _with(found: Opened, tracks: dict[str, StoredTrack], *facts: str) -> Opened:
    return replace(found, tracks={**found.tracks, **tracks}, facts=(*facts, *found.facts))


def _clip(
    catalog: Catalog, one: ItemSet, human: HumanMotion | None, robot_clip: RobotMotion | None, name: str
) -> Opened:
    """A human clip and what was made of it, either of which may be missing."""
    motion = robot_clip or human
    assert motion is not None
    task, objects = TASKS.get(one.task), catalog.read_by(one, "objects")
    objects.file(motion.object_id)  # the name comes from a file: it must be one of those that there are
    obj = load_object(objects.path, motion.object_id)
    robot = ROBOTS.get(robot_clip.robot if robot_clip else DEFAULT_ROBOT)
    facts, details, tracks = [f"clip: {motion.duration:.1f} s, {motion.frames} frames"], [], {}
    if human is not None:
        tracks["human"] = human_track(task, human, obj)
        facts.append(f"person: {human.source}")
        details.append(f"the clip's choices: {_told(human.style)}")
    if robot_clip is not None:
        tracks["retargeted"] = robot_track(task, robot_clip, obj, robot)
        facts.append(f"retargeted: {'kept' if robot_clip.success else 'left out'}")
        details.append(f"what retargeting measured: {_told(robot_clip.measures)}")
    facts += object_facts(obj)
    return Opened(name, task, robot, obj, tuple(facts), tuple(details), tracks, motion.wrist_goal_w, robot_clip)


def _human_of(catalog: Catalog, one: ItemSet, motion: RobotMotion) -> HumanMotion | None:
    """The human clip of a robot's, if it is still there."""
    try:
        return HumanMotion.load(catalog.read_by(one, "references").file(motion.reference_id))
    except BadFile:
        return None


def _gains_of(catalog: Catalog, one: ItemSet, found: Opened) -> tuple[str, tuple[str, ...]]:
    """Gains that demonstrations were made with, and what has to be told of that.

    Where they do not say them: those of who demonstrated; where that is not here, of the design of the recipe's
    tracker, which a policy need not have.
    """
    from mimicbench.imitate.lerobot import DATASET, recorded_gains
    from mimicbench.track.registry import TRACKERS

    recorded = recorded_gains(one.path / DATASET)
    if recorded is not None and recorded in found.robot.gains:
        return recorded, ()
    made_from = one.header.get("made_from", {})
    policy = made_from.get(EXPERT)
    gains = gains_of(policy or made_from.get(TRACKER, ""), found.task, found.robot, catalog.workdir)
    if gains is not None:
        return gains, ()
    name = one.header.get("recipe", {}).get("track", {}).get("tracker", next(iter(TRACKERS)))
    told = () if policy is None else (f"who demonstrated is not here: torques are by the gains of tracker {name}",)
    return TRACKERS.get(name).gains, told


def object_facts(obj: SceneObject) -> tuple[str, ...]:
    """What is worth knowing of an object."""
    low, high = obj.bounds()
    size = " x ".join(f"{100 * length:.0f}" for length in high - low)
    told = [f"object {obj.id}: {obj.kind}, {size} cm (length, width, height), {obj.split} split"]
    if obj.seat_height is not None:
        told.append(f"surface {100 * obj.seat_height:.0f} cm above the floor")
    if obj.movable:
        told.append(f"{obj.mass:.1f} kg, friction {obj.friction:.2f}")
    return tuple(told)


def _told(numbers: Mapping[str, float]) -> str:
    """Named numbers in words."""
    return ", ".join(f"{name.replace('_', ' ')} {value:.3g}" for name, value in numbers.items()) or "nothing"
