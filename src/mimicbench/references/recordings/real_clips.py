"""Clips of the tasks, cut out of recordings of real people, each beside an object: the recorded one, or one fitted
to the person.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion, UnknownName
from mimicbench.core.motion import HumanMotion
from mimicbench.objects.shape import SceneObject
from mimicbench.references.body.body import body_of
from mimicbench.references.importers.recording import ObjectTrack, Recording
from mimicbench.references.recordings.cutting import FPS, Clip, cut, each, moved, settled, with_contacts
from mimicbench.references.recordings.fit_bed import fit_bed, lying_frame
from mimicbench.references.recordings.fit_box import PALM, BoxTrack, box_between, box_of_mesh, boxed, touched_box
from mimicbench.references.recordings.fit_object import fit_seat, nearby_distance, sample_body, seated_frame
from mimicbench.references.recordings.handling import (
    Handling,
    HandlingRules,
    find_clasps,
    find_handling,
    find_reach,
    stood_up,
)
from mimicbench.references.recordings.segments import Sitting, SittingRules, find_lyings, find_sittings

DEEPEST = 0.15
"""Deepest that trunk and legs of who lifts a fitted box may be in it [m]; people do press boxes against themselves."""
ELSEWHERE = 0.2
"""[m] A wrist that ends farther from what the other hand reaches for does not reach for it."""


def find_clips(recording: Recording, task: str) -> list[Clip]:
    """Every part of a recording in which somebody does a task, each with its object at the origin facing +x.

    Ids are `real-<file>-<n>` and `fitted-<file>-<n>`. Raises BadMotion if the task is not in it, UnknownName if there
    is no such task.
    """
    if task not in TASKS:
        raise UnknownName("task", task, list(TASKS))
    if recording.wishes.mesh is not None and task not in TRACKED:
        raise BadMotion(f"--object-mesh is of an object to be touched or lifted, not for {task}; leave that out")
    return TASKS[task](recording)


def sitting_clips(recording: Recording, task: str, rules: SittingRules | None = None) -> list[Clip]:
    """Walk-to-seated parts, each with a chair or sofa fitted under the person.

    Raises BadMotion if there is none, or none can be fitted.
    """
    pos, _ = recording.forward_kinematics()
    found = find_sittings(recording.skeleton, pos, recording.fps, rules)
    if not found:
        raise BadMotion(
            f"{recording.name} has no part in which somebody walks up and sits down ({_heights(pos)}); leave it out"
        )
    return each(recording, found, lambda part, number: _sitting_clip(recording, part, number, task))


def lying_clips(recording: Recording, task: str) -> list[Clip]:
    """Walk-to-lying parts, each with a bed or couch fitted under the person.

    Raises BadMotion if there is none, or none can be fitted.
    """
    pos, _ = recording.forward_kinematics()
    found = find_lyings(recording.skeleton, pos, recording.fps)
    if not found:
        raise BadMotion(
            f"{recording.name} has no part in which somebody walks up and lies down ({_heights(pos)}); leave it out"
        )
    return each(recording, found, lambda part, number: _lying_clip(recording, part, number, task))


def lifting_clips(recording: Recording) -> list[Clip]:
    """Reaches that end with a box lifted, the box that was recorded or one fitted between the hands.

    Raises BadMotion if there is none.
    """
    wrists, (track, sides) = _wrists(recording), _tracked(recording)
    (pos, _), body = recording.forward_kinematics(), body_of(recording.skeleton)
    ankles, fps = pos[:, [leg.end for leg in body.legs]], recording.fps
    if track is not None:
        handling = find_handling(_away(track, sides, wrists), track.pos_w[:, 2], recording.fps)
        found = [handling] if handling is not None and handling.end is not None else []
    else:
        found = find_clasps(wrists, ankles, fps)
    if not found:
        raise BadMotion(
            f"{recording.name} has no part in which both hands lift something by "
            f"{HandlingRules().lift:.2f} m; leave it out"
        )
    trunk = pos[:, body.pelvis], pos[:, body.head]
    lifts = [replace(part, end=stood_up(*trunk, ankles, part.end, fps)) for part in found if part.end is not None]
    return each(recording, lifts, lambda part, number: _lifting_clip(recording, part, number, track, sides))


def touching_clips(recording: Recording) -> list[Clip]:
    """Reaches until just before the hands touch the recorded object, or until they are out farthest.

    Raises BadMotion if there is none.
    """
    return [_touching_clip(recording)]


TASKS: dict[str, Callable[[Recording], list[Clip]]] = {
    "sit-chair": lambda recording: sitting_clips(recording, "sit-chair"),
    "sit-sofa": lambda recording: sitting_clips(recording, "sit-sofa"),
    "lie-bed": lambda recording: lying_clips(recording, "lie-bed"),
    "lie-sofa": lambda recording: lying_clips(recording, "lie-sofa"),
    "touch-points": touching_clips,
    "lift-box": lifting_clips,
}
TRACKED = ("touch-points", "lift-box")
"""Tasks in which the recorded object counts."""


def _sitting_clip(recording: Recording, sitting: Sitting, number: int, task: str) -> Clip:
    """One walk-to-seated part, moved to where its seat is at the origin facing +x."""
    motion = cut(recording, sitting.start, sitting.end, number, task)
    landing = min(motion.frames - 2, round((sitting.landing - sitting.start) * FPS / recording.fps))
    seated = slice(landing, motion.frames)
    origin, yaw, _ = seated_frame(motion, seated)
    motion = moved(motion, origin, yaw)
    fit = fit_seat(motion.object_id, motion, seated, sofa=task == "sit-sofa")
    return with_contacts(moved(motion, fit.offset, 0.0), fit.obj)


def _lying_clip(recording: Recording, lying: Sitting, number: int, task: str) -> Clip:
    """One walk-to-lying part, moved to where its bed is at the origin facing +x."""
    motion = cut(recording, lying.start, lying.end, number, task)
    landing = min(motion.frames - 2, round((lying.landing - lying.start) * FPS / recording.fps))
    lies, couch = slice(landing, motion.frames), task == "lie-sofa"
    motion = moved(motion, *lying_frame(motion, lies, couch))
    fit = fit_bed(motion.object_id, motion, lies, couch)
    return with_contacts(moved(motion, fit.offset, 0.0), fit.obj)


def _lifting_clip(
    recording: Recording, handling: Handling, number: int, whole: ObjectTrack | None, sides: np.ndarray | None
) -> Clip:
    """From before the hands touch until the person has stood up and holds the box.

    The box is at the origin facing +x in the first frame.
    """
    assert handling.end is not None
    motion = cut(recording, handling.start, handling.end, number, "lift-box")
    rate = FPS / recording.fps
    clasp = min(motion.frames - 2, round((handling.touch - handling.start) * rate))
    wrists, pelvis = (
        _wrists(recording)[handling.start : handling.end],
        recording.root_pos_w[handling.start : handling.end],
    )
    wrists, pelvis = rot.resample(wrists, recording.fps, FPS), rot.resample(pelvis, recording.fps, FPS)
    track = None
    if whole is not None:
        part = slice(handling.start, handling.end)
        pos, quat = whole.pos_w[part], whole.quat_w[part]
        track = ObjectTrack(
            rot.resample(pos, recording.fps, FPS), rot.normalize(rot.resample_quat(quat, recording.fps, FPS))
        )
    if track is not None and sides is not None:
        box = box_of_mesh(motion.object_id, track, sides, pelvis[clasp, :2])
    else:
        box = box_between(motion.object_id, wrists, pelvis, clasp, track)
    motion, obj = _beside(motion, box)
    motion = settled(motion)
    if (depth := body_depth(motion, obj)) > DEEPEST:
        raise BadMotion(
            f"{motion.id}: the box that would fit between the hands is {depth:.2f} m deep in the "
            "body; leave the clip out"
        )
    return with_contacts(motion, obj)


def _touching_clip(recording: Recording) -> Clip:
    """The reach, the object at the origin facing the person along +x; where the wrists end is their goal.

    A hand that ends farther than ELSEWHERE from the object has none.
    """
    rules, wrists = HandlingRules(), _wrists(recording)
    before = round(rules.before_touch * recording.fps)
    tracked, sides = _tracked(recording)
    if tracked is not None:
        handling = find_handling(_away(tracked, sides, wrists), tracked.pos_w[:, 2], recording.fps)
        if handling is None:
            raise BadMotion(f"{recording.name} has no part in which both hands touch the object; leave it out")
        start, end = handling.start, max(handling.touch - before, handling.start + 2)
    else:
        reach = find_reach(wrists, recording.root_pos_w, recording.fps)
        if reach is None:
            raise BadMotion(
                f"{recording.name} has no part in which somebody stands and holds a hand out "
                f"({rules.reach:.2f} m or more); leave it out"
            )
        end = reach + 1
        start = max(0, end - round(rules.before * recording.fps))
    if (end - start) / recording.fps < rules.shortest:
        raise BadMotion(f"{recording.name}: the reach takes less than {rules.shortest} s; leave it out")
    motion = settled(cut(recording, start, end, 0, "touch-points"))
    pos, _ = motion.forward_kinematics()
    body = body_of(motion.skeleton)
    ends = pos[-1, [arm.end for arm in body.arms]]
    if tracked is not None and sides is not None:
        track = ObjectTrack(tracked.pos_w[end - 1 : end], tracked.quat_w[end - 1 : end])
        box = box_of_mesh(motion.object_id, track, sides, pos[-1, 0, :2])
        obj = replace(box.obj, family="household", movable=False, mass=None)
        centre, yaw = box.pos_w[0, :2], float(rot.yaw_of(box.quat_w[0]))
    else:
        obj, centre, yaw = touched_box(motion.object_id, ends, pos[-1, 0])
    motion = moved(motion, centre, yaw)
    goal = motion.forward_kinematics()[0][-1, [arm.end for arm in body.arms]]
    if tracked is None:  # of a recorded object both hands are known to touch it
        away = obj.distance(goal)
        goal[(away > ELSEWHERE) & (away > away.min())] = np.nan
    return with_contacts(replace(motion, wrist_goal_w=goal), obj)


def _wrists(recording: Recording) -> np.ndarray:
    """(T, 2, 3) left and right [m]."""
    pos, _ = recording.forward_kinematics()
    return pos[:, [arm.end for arm in body_of(recording.skeleton).arms]]


def _tracked(recording: Recording) -> tuple[ObjectTrack | None, np.ndarray | None]:
    """The recorded object's track, of the middle of the box around its mesh if there is one, and that box's sides
    (3,) [m].
    """
    if recording.track is None or recording.wishes.mesh is None:
        return recording.track, None
    return boxed(recording.wishes.mesh, recording.track)


def _away(track: ObjectTrack, sides: np.ndarray | None, wrists: np.ndarray) -> np.ndarray:
    """(T, 2) distance of each wrist from the tracked object [m].

    Without its mesh, over that of the time when both hands hold it.
    """
    local = rot.rotate_inverse(track.quat_w[:, None], wrists - track.pos_w[:, None])
    if sides is not None:
        return np.linalg.norm(np.maximum(np.abs(local) - sides / 2, 0.0), axis=-1)
    far = np.linalg.norm(local, axis=-1)
    lifted = track.pos_w[:, 2] > track.pos_w[0, 2] + HandlingRules().lift
    return np.maximum(far - np.median(far[lifted], axis=0), 0.0) + PALM if lifted.any() else far


def body_depth(motion: HumanMotion, obj: SceneObject) -> float:
    """How deep any part of the body but arms and hands is in a box, in any frame [m]."""
    pos, quat = motion.forward_kinematics()
    body = sample_body(pos, quat, motion)
    local = rot.rotate_inverse(motion.object_quat_w[:, None], body.points - motion.object_pos_w[:, None])
    return max(0.0, -float((nearby_distance(obj, local) - body.radii)[:, ~body.arms].min()))


def _heights(pos: np.ndarray) -> str:
    return f"the pelvis is between {pos[:, 0, 2].min():.2f} and {pos[:, 0, 2].max():.2f} m high"


def _beside(motion: HumanMotion, box: BoxTrack) -> Clip:
    """The motion in the frame of where the box is at first, with the box's track."""
    yaw = float(rot.yaw_of(box.quat_w[0]))
    turn, origin = rot.from_yaw(np.array(-yaw)), np.array([*box.pos_w[0, :2], 0.0])
    beside = moved(motion, box.pos_w[0, :2], yaw)
    beside = replace(beside, style={**beside.style, "object_raised": box.raised})
    return replace(
        beside, object_pos_w=rot.rotate(turn, box.pos_w - origin), object_quat_w=rot.multiply(turn, box.quat_w)
    ), box.obj
