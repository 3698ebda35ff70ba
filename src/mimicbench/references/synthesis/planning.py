"""Planning a task from anywhere: the whole clip from what a body does at one moment to the task's end, in milliseconds.

Who is still on the way walks on from there. Who is in the midst of sitting down, lying down, reaching or lifting goes
on with the action from the moment that is most like theirs. Either way the plan begins at the pose and with the
velocity of the state.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.motion import HumanMotion
from mimicbench.core.skeleton import forward_kinematics
from mimicbench.objects.shape import SceneObject
from mimicbench.references.actions.reaching import cut
from mimicbench.references.locomotion.course import AXES, Course, landmarks
from mimicbench.references.locomotion.joining import join
from mimicbench.references.locomotion.replan import walk_from
from mimicbench.references.locomotion.route import Route, ahead_of
from mimicbench.references.locomotion.states import BodyState
from mimicbench.references.synthesis.registry import courses

LOW = 0.8
"""Whoever has the pelvis lower than this share of its height in standing does not walk on."""
AT_STOP = 0.04
"""Feet that both stand so near to where the task wants them need no further step [m]."""
AT_STOP_TURN = 0.25
"""And turned by no more than that [rad]."""
LEAST = 1.6
"""A plan lasts so many seconds at least."""
AHEAD = 0.15
"""Weight of velocities in finding what is most alike: where a body would be so many seconds later [s]."""
FACES = 2.6
"""Who is turned farther from the heading of the stop than that has not begun to turn round [rad]."""
ASIDE = 0.6
"""Who walks up to something does so within this angle of the heading there, or steps sideways [rad]."""


def plan(
    task: str,
    obj: SceneObject,
    state: BodyState,
    style: Mapping[str, float],
    clip_id: str = "plan",
    wrist_goal_w: np.ndarray | None = None,
) -> HumanMotion:
    """The clip of a task from a state to the task's end, on an object at the origin, in a style as it is stored with
    clips.

    What does not depend on the state is kept for the next plan on the same object in the same style.

    Args:
        task: One of `synthesis.registry.SYNTHESES`.
        obj: With what.
        state: Where the body is now, and how it moves.
        style: `HumanMotion.style` of a clip of the task.
        clip_id: Name of the plan.
        wrist_goal_w: (2, 3) where the wrists are to go [m], for tasks that tell it.

    Raises:
        UnknownName: There is no such task.
        BadMotion: The style is not one of the task.
        BadObject: The object is not one for the task.
    """
    return plan_on(courses(task, obj, style, wrist_goal_w), state, clip_id)


def plan_on(ways: Sequence[Course], state: BodyState, clip_id: str = "plan") -> HumanMotion:
    """The clip from a state to the end of the nearest of some ways to do a task."""
    shift = _shift(ways[0], state)
    here = _shifted(state, shift)
    begun = [way for way in ways if _acts(way, here)]
    if begun:
        alike = [_most_alike(way, here) for way in begun]
        nearest = int(np.argmin([cost for _, cost in alike]))
        course, moment = begun[nearest], alike[nearest][0]
        clip = cut(replace(course.action, id=clip_id), moment, course.action.frames)
    else:
        routes = [_route(way, here) for way in ways]
        shortest = int(np.argmin([route.length for route in routes]))
        course = ways[shortest]
        clip = course.act(
            clip_id,
            walk_from(course.body, here, routes[shortest], course.stop_xy, course.stop_yaw, course.gait, course.after),
        )
    return _placed(join(course.body, clip, here, feet_go_on=not begun), shift)


def _acts(course: Course, state: BodyState) -> bool:
    """Whether the person has left off walking: low already, or both feet where the task wants them."""
    if state.pelvis_pos_w[2] < LOW * course.body.standing_height:
        return True
    feet = state.feet
    away = np.linalg.norm(feet.pos_w[:, :2] - course.feet_xy, axis=-1)
    return bool(
        feet.bears.all()
        and (away < AT_STOP).all()
        and (np.abs(rot.wrap_angle(feet.yaw - course.stop_yaw)) < AT_STOP_TURN).all()
    )


def _route(course: Course, state: BodyState) -> Route:
    """The way that is left; none for who has begun to turn round before the stop, or stands beside it."""
    place, route = state.place, course.route(state.place)
    away = float(np.linalg.norm(place - course.stop_xy))
    back = float(np.linalg.norm(route.points[-1] - course.stop_xy))
    if back > 0.05:
        near = away < back + 0.1 and abs(rot.wrap_angle(state.yaw - course.stop_yaw)) < FACES
    else:
        aside = (course.stop_xy - place) @ ahead_of(course.stop_yaw) < np.cos(ASIDE) * away
        near = away < 0.1 or (away < 0.6 and bool(aside))
    return Route(np.stack([place, place + 1e-6])) if near else route


def _shift(course: Course, state: BodyState) -> np.ndarray:
    """(x, y, yaw) where the box was when it was put there, [m] and [rad]: it takes the whole plan with it.

    Zeros without a box.
    """
    box, action = state.box, course.action if state.box is not None else None
    if box is None or action is None or not len(action.object_pos_w):
        return np.zeros(3)
    moment = int(np.argmin(np.abs(action.object_pos_w[:, 2] - box.pos_w[2])))
    turn = float(rot.wrap_angle(rot.yaw_of(box.quat_w) - rot.yaw_of(action.object_quat_w[moment])))
    carried = rot.rotate(rot.from_yaw(np.array(turn)), action.object_pos_w[moment])
    return np.array([*(box.pos_w - carried)[:2], turn])


def _most_alike(course: Course, state: BodyState) -> tuple[int, float]:
    """The moment of the action that is most like the state, and how unlike it is [m^2]."""
    action, joints = course.action, len(course.body.skeleton.joint_names)
    last = action.frames - round(LEAST * action.fps)
    pose = state.pose
    if pose is not None and pose.known.all():
        quat = np.stack([pose.local_quat, rot.multiply(pose.local_quat, rot.from_rotvec(pose.rate / action.fps))])
        root = np.stack([state.pelvis_pos_w, state.pelvis_pos_w + state.pelvis_vel_w / action.fps])
        now, soon = landmarks(*forward_kinematics(course.body.skeleton, root, quat))
        seen, rate, used = now, (soon - now) * action.fps, slice(None)
    else:
        turn = rot.from_yaw(np.array(state.yaw)) if pose is None or not pose.known[0] else pose.local_quat[0]
        seen = np.concatenate([state.pelvis_pos_w[None], state.feet.pos_w, state.pelvis_pos_w + rot.rotate(turn, AXES)])
        rate = np.concatenate([state.pelvis_vel_w[None], state.feet.vel_w, np.tile(state.pelvis_vel_w, (2, 1))])
        used = [0, *(leg.end for leg in course.body.legs), joints, joints + 1]
    places, velocities = course.marks
    unlike = ((places[:last, used] - seen) ** 2).sum(-1) + AHEAD**2 * ((velocities[:last, used] - rate) ** 2).sum(-1)
    cost = unlike.mean(-1)
    return int(np.argmin(cost)), float(cost.min())


def _shifted(state: BodyState, shift: np.ndarray) -> BodyState:
    """The state as seen from an origin that is elsewhere, at `shift` (x, y, yaw)."""
    if not np.abs(shift).max() > 1e-9:
        return state
    turn = rot.from_yaw(np.array(-shift[2]))
    return state.moved(rot.rotate(turn, np.append(state.place - shift[:2], 0.0))[:2], state.yaw - shift[2])


def _placed(motion: HumanMotion, shift: np.ndarray) -> HumanMotion:
    """The clip as seen from the world, of a clip around an origin at `shift`."""
    if not np.abs(shift).max() > 1e-9:
        return motion
    turn, there = rot.from_yaw(np.array(shift[2])), np.array([shift[0], shift[1], 0.0])
    quat = motion.local_quat.copy()
    quat[:, 0] = rot.multiply(turn, quat[:, 0])
    return replace(
        motion,
        root_pos_w=rot.rotate(turn, motion.root_pos_w) + there,
        local_quat=quat,
        object_pos_w=rot.rotate(turn, motion.object_pos_w) + there,
        object_quat_w=rot.multiply(turn, motion.object_quat_w),
    )
