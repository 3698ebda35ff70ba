"""Joining a planned clip from the midst of a motion: what differs at first fades, and the feet that stand stay where
they are.
"""

from dataclasses import replace

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.motion import HumanMotion
from mimicbench.references.body.body import Body
from mimicbench.references.body.limbs import about_y, ease, two_link
from mimicbench.references.curves import minimum_jerk, smooth_below
from mimicbench.references.locomotion.feet import rolled
from mimicbench.references.locomotion.states import BodyState

JOINS = 0.45
"""Within so many seconds a body joins its plan."""
FLAT = 0.15
"""Within so many seconds a foot that stands lies down flat."""
FARTHEST = 0.995
"""Share of its length to which a leg may be stretched meanwhile."""
ROLLS = 0.9
"""A foot on the floor that is pitched by more does not roll: it is lying on something [rad]."""
ASIDE = 0.5
"""Sine of the roll from which on a foot lies on its side."""
HINGE = np.array([0.0, 1.0, 0.0])


def join(body: Body, plan: HumanMotion, state: BodyState, feet_go_on: bool) -> HumanMotion:
    """The plan, beginning at the state's pose and going on with its velocity.

    `feet_go_on` says that the plan's feet go on from those of the state already, as those of `replan.walk_from` do.
    """
    fps, some = plan.fps, min(plan.frames, int(np.ceil(JOINS * plan.fps)) + 1)
    root = ease(plan.root_pos_w, state.pelvis_pos_w, state.pelvis_vel_w, fps, JOINS)
    quat = plan.local_quat.copy()
    pose, stands = state.pose, _stands(plan)
    if pose is not None:
        known = np.flatnonzero(pose.known)
        quat[:some, known] = turned(plan.local_quat[:some, known], pose.local_quat[known], pose.rate[known], fps, JOINS)
        for side, toe in enumerate(body.toes or ()):  # they lie on the floor while their foot is pitched
            lands = int(np.argmax(stands[:, side])) / fps
            if pose.known[toe]:
                quat[:some, toe] = turned(
                    plan.local_quat[:some, toe],
                    pose.local_quat[toe],
                    pose.rate[toe],
                    fps,
                    max(2 / fps, lands) if lands else FLAT,
                )
    ankle, foot = feet_of(body, plan.root_pos_w, plan.local_quat)
    planned = ankle
    if feet_go_on:
        ankle, foot = ankle.copy(), foot.copy()
        for side in np.flatnonzero(~stands[0]):
            _fade(state, body, ankle, foot, int(side), fps, max(2, int(np.argmax(stands[:, side]))) / fps)
    else:
        ankle, foot, stands = _keep_feet(body, plan, state, ankle, foot)
    # as long as anything differs from the plan
    moved = np.flatnonzero((np.abs(ankle - planned) > 1e-5).any((1, 2)))
    some = max(some, int(moved[-1]) + 1 if len(moved) else 0)
    root[:, 2] += _sunk(body, root[:some], quat[:some], ankle[:some], stands[:some], fps, plan.frames)
    _solve_legs(body, root, quat, ankle, foot, some)
    contacts = plan.contacts.copy()
    contacts[:, _feet_columns(plan)] = stands
    box_pos, box_quat = plan.object_pos_w, plan.object_quat_w
    if state.box is not None and len(box_pos):
        box_pos = ease(box_pos, state.box.pos_w, state.box.vel_w, fps, JOINS)
        box_quat = turned(box_quat, state.box.quat_w, state.box.rate, fps, JOINS)
    return replace(
        plan,
        root_pos_w=root,
        local_quat=rot.normalize(quat),
        contacts=contacts,
        object_pos_w=box_pos,
        object_quat_w=box_quat,
    )


def turned(quat: np.ndarray, first: np.ndarray, rate: np.ndarray, fps: float, lasts: float) -> np.ndarray:
    """Rotations (T, ..., 4) that begin at `first` (..., 4), turn by `rate` (..., 3) [rad/s] in their own frame
    there, and join the given ones.
    """
    if len(quat) < 3:
        return quat
    away = [rot.to_rotvec(rot.multiply(rot.conjugate(quat[0]), quat[i])) for i in (1, 2)]
    own = 2 * away[0] - 0.5 * away[1]
    now = rot.to_rotvec(rot.multiply(rot.conjugate(quat[0]), first))
    ahead = rot.multiply(first, rot.from_rotvec(rate / fps))
    soon = rot.to_rotvec(rot.multiply(rot.conjugate(rot.multiply(quat[0], rot.from_rotvec(own))), ahead))
    return rot.multiply(
        quat, rot.from_rotvec(ease(np.zeros((*quat.shape[:-1], 3)), now, (soon - now) * fps, fps, lasts))
    )


def feet_of(body: Body, root_pos_w: np.ndarray, local_quat: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Ankles (..., 2, 3) [m] and world orientations of the feet (..., 2, 4)."""
    ankles, feet = [], []
    for leg in body.legs:
        pos, quat = root_pos_w, local_quat[..., body.pelvis, :]
        for joint in leg:
            pos = pos + rot.rotate(quat, body.skeleton.offsets[joint])
            quat = rot.multiply(quat, local_quat[..., joint, :])
        ankles.append(pos)
        feet.append(quat)
    return np.stack(ankles, -2), np.stack(feet, -2)


def _feet_columns(plan: HumanMotion) -> list[int]:
    return [plan.contact_names.index(name) for name in ("left_foot", "right_foot")]


def _stands(plan: HumanMotion) -> np.ndarray:
    return plan.contacts[:, _feet_columns(plan)].astype(bool)


def _foot(state: BodyState, body: Body, side: int, planned: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Orientation (4,) of a foot of the state in the world, and how fast it turns (3,) in its own frame [rad/s].

    Of a foot that lies on its side heading and pitch say little: without a pose it is as planned (4,).
    """
    pose, feet = state.pose, state.feet
    if pose is not None and pose.known[[body.pelvis, *body.legs[side]]].all():
        moment = 1e-3
        soon = rot.multiply(pose.local_quat, rot.from_rotvec(pose.rate * moment))
        first, then = (feet_of(body, state.pelvis_pos_w, quat)[1][side] for quat in (pose.local_quat, soon))
        return first, rot.to_rotvec(rot.multiply(rot.conjugate(first), then)) / moment
    if abs(rot.rotate(planned, np.array([0.0, 1.0, 0.0]))[2]) > ASIDE:
        return planned, np.zeros(3)
    quat = rot.multiply(rot.from_yaw(feet.yaw[side]), about_y(feet.pitch[side]))
    return quat, np.array([0.0, feet.pitch_rate[side], 0.0]) + rot.rotate_inverse(
        quat, np.array([0.0, 0.0, feet.yaw_rate[side]])
    )


def _fade(
    state: BodyState, body: Body, ankle: np.ndarray, foot: np.ndarray, side: int, fps: float, lasts: float
) -> None:
    """Let one foot of ankles (T, 2, 3) and feet (T, 2, 4) begin as it is and join the plan within some time [s]."""
    feet = state.feet
    ankle[:, side] = ease(ankle[:, side], feet.pos_w[side], feet.vel_w[side], fps, lasts)
    foot[:, side] = turned(foot[:, side], *_foot(state, body, side, foot[0, side]), fps, lasts)


def _keep_feet(
    body: Body, plan: HumanMotion, state: BodyState, ankle: np.ndarray, foot: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ankles (T, 2, 3), feet (T, 2, 4) and whether they stand (T, 2), given those of the plan: what stands stays
    until the plan lifts it.
    """
    ankle, foot, stands, fps, start = ankle.copy(), foot.copy(), _stands(plan), plan.fps, state.feet
    for side in (0, 1):
        if not (start.bears[side] and stands[0, side]):
            _fade(state, body, ankle, foot, side, fps, JOINS)
            stands[: round(JOINS * fps), side] = False  # it has to come down first
            continue
        end = len(stands) if stands[:, side].all() else int(np.argmin(stands[:, side]))
        pitch = start.pitch[side]
        if start.pos_w[side, 2] < 2.5 * body.sole and abs(pitch) < ROLLS:
            track = ease(np.zeros(end), pitch, start.pitch_rate[side], fps, FLAT)
            yaw, pivot = np.full(end, start.yaw[side]), np.full(end, float(pitch < 0))
            flat = start.pos_w[side] - rolled(body, pitch, start.yaw[side], np.array(float(pitch < 0)))
            places, turns = flat + rolled(body, track, yaw, pivot), rot.multiply(rot.from_yaw(yaw), about_y(track))
        else:
            off = rot.multiply(rot.conjugate(foot[0, side]), _foot(state, body, side, foot[0, side])[0])
            places, turns = ankle[:end, side] + start.pos_w[side] - ankle[0, side], rot.multiply(foot[:end, side], off)
        if end < len(stands):
            left = 1.0 - minimum_jerk(np.arange(1, len(stands) - end + 1) / (JOINS * fps))[:, None]
            off = rot.to_rotvec(rot.multiply(rot.conjugate(foot[end - 1, side]), turns[-1]))
            ankle[end:, side] += left * (places[-1] - ankle[end - 1, side])
            foot[end:, side] = rot.multiply(foot[end:, side], rot.from_rotvec(left * off))
        ankle[:end, side], foot[:end, side] = places, turns
    return ankle, foot, stands


def _sunk(
    body: Body, root: np.ndarray, quat: np.ndarray, ankle: np.ndarray, stands: np.ndarray, fps: float, frames: int
) -> np.ndarray:
    """(frames,) how much the pelvis sinks [m], from none, so that the legs reach the feet that stand."""
    spare, most = np.zeros(len(root)), FARTHEST * sum(body.length(body.legs[0]))
    for side, leg in enumerate(body.legs):
        hip = root + rot.rotate(quat[:, body.pelvis], body.skeleton.offsets[leg.root])
        away = ((hip - ankle[:, side])[:, :2] ** 2).sum(-1)
        highest = ankle[:, side, 2] + np.sqrt(np.maximum(most**2 - away, 0.25 * most**2))
        spare = np.where(stands[:, side], np.minimum(spare, highest - hip[:, 2]), spare)
    sunk = np.zeros(frames)
    if (spare < 0).any():
        sunk[: len(root)] = minimum_jerk(np.arange(len(root)) / 4) * smooth_below(spare, 3)
    return sunk


def _solve_legs(body: Body, root: np.ndarray, quat: np.ndarray, ankle: np.ndarray, foot: np.ndarray, some: int) -> None:
    """Turn hips, knees and ankles of the first frames so that the feet are where they should.

    Knees keep the plane that they are in.
    """
    pelvis = quat[:some, body.pelvis]
    for side, leg in enumerate(body.legs):
        hip = root[:some] + rot.rotate(pelvis, body.skeleton.offsets[leg.root])
        axis = rot.rotate(rot.multiply(pelvis, quat[:some, leg.root]), HINGE)
        thigh, shin, _ = two_link(hip, ankle[:some, side], axis, *body.length(leg), True)
        quat[:some, leg.root] = rot.multiply(rot.conjugate(pelvis), thigh)
        quat[:some, leg.middle] = rot.multiply(rot.conjugate(thigh), shin)
        quat[:some, leg.end] = rot.multiply(rot.conjugate(shin), foot[:some, side])
