"""Bends a clip so that its contacts are elsewhere: limbs are solved again, so that feet and hands stay where they
bear.
"""

from dataclasses import replace

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion
from mimicbench.core.motion import HumanMotion
from mimicbench.core.skeleton import forward_kinematics
from mimicbench.objects.shape import SceneObject
from mimicbench.references.body.body import Body, Limb, body_of
from mimicbench.references.body.limbs import two_link
from mimicbench.references.curves import minimum_jerk

FEET, HANDS = ("left_foot", "right_foot"), ("left_hand", "right_hand")
ON_FLOOR = 0.14
"""An ankle lower than this above its standing height [m] stands on the floor, or rolls over its toes there."""


def contact(motion: HumanMotion, name: str) -> np.ndarray:
    """(T,) whether a body bears; never if the clip has no such label."""
    return (
        motion.contacts[:, motion.contact_names.index(name)].astype(bool)
        if name in motion.contact_names
        else np.zeros(motion.frames, bool)
    )


def approach_end(motion: HumanMotion) -> int:
    """The frame in which the first of both feet comes to stand where it stands when something else bears.

    Raises BadMotion without such a walk.
    """
    feet = [contact(motion, foot) for foot in FEET]
    others = [contact(motion, name) for name in motion.contact_names if name not in FEET]
    bears = np.flatnonzero(np.any(others, axis=0)) if others else np.zeros(0, int)
    action = int(bears[0]) if len(bears) else motion.frames - 1
    ends = []
    for stands in feet:
        lifted = np.flatnonzero(~stands[: action + 1])
        ends.append(int(lifted[-1]) + 1 if len(lifted) else 0)
    end = min(ends)
    if end < 2 or action == 0:
        raise BadMotion(f"clip {motion.id}: nobody walks up to the object in it")
    return end


def turned_approach(motion: HumanMotion, end: int, turn: float, shift: np.ndarray) -> HumanMotion:
    """The way up to frame `end` turned by `turn` [rad] about where it ends, and shifted by (2,) [m], at its beginning.

    Less and less later.
    """
    body = body_of(motion.skeleton)
    pos, quat = motion.forward_kinematics()
    share = 1.0 - minimum_jerk(np.arange(motion.frames) / end)
    pivot = np.array([*motion.root_pos_w[end, :2], 0.0])
    away = np.array([*shift, 0.0])

    def moved(places: np.ndarray, part: np.ndarray) -> np.ndarray:
        return pivot + rot.rotate(rot.from_yaw(turn * part), places - pivot) + part[:, None] * away

    ankles, soles = [], []
    for side, leg in enumerate(body.legs):
        own = _held(share, contact(motion, FEET[side]))
        ankles.append(moved(pos[:, leg.end], own))
        soles.append(rot.multiply(rot.from_yaw(turn * own), quat[:, leg.end]))
    pelvis = rot.multiply(rot.from_yaw(turn * share), motion.local_quat[:, 0])
    return _solved(
        motion, body, quat, moved(motion.root_pos_w, share), pelvis, np.stack(ankles, 1), np.stack(soles, 1), None
    )


def rescaled(motion: HumanMotion, obj: SceneObject, factor: float) -> HumanMotion:
    """On the object `factor` times as large: what bears on it moves with its surface, the way there moves along,
    feet on the floor stay on it.
    """
    body = body_of(motion.skeleton)
    pos, quat = motion.forward_kinematics()
    end = approach_end(motion)
    grow = factor - 1.0
    # in the world's frame, a place of the object grows away from its origin, however it is turned
    origin = motion.object_pos_w if len(motion.object_pos_w) else np.zeros((motion.frames, 3))
    ankles = pos[:, [leg.end for leg in body.legs]]
    along = grow * np.array([*ankles[end].mean(0)[:2], 0.0])
    walks = np.arange(motion.frames) <= end

    def with_surface(places: np.ndarray) -> np.ndarray:
        return grow * (places - origin)

    sits = contact(motion, "pelvis") | contact(motion, "back")
    seat = np.column_stack([motion.root_pos_w[:, :2], np.full(motion.frames, obj.seat_height or 0.0)])
    pelvis_move = _filled(
        walks | sits | (not sits.any()), np.where((sits & ~walks)[:, None], with_surface(seat), along)
    )
    ankle_pos = []
    for side in (0, 1):
        floor = ankles[:, side, 2] < body.sole + ON_FLOOR
        rests = contact(motion, FEET[side]) & ~floor
        fixed = walks | floor | rests
        ankle_pos.append(
            ankles[:, side] + _filled(fixed, np.where(rests[:, None], with_surface(ankles[:, side]), along))
        )
    wrists = None
    if any(contact(motion, hand).any() for hand in HANDS):
        wrists = []
        for side, arm in enumerate(body.arms):
            bears, place = contact(motion, HANDS[side]), pos[:, arm.end]
            # the pelvis's way until a moment before, then that of the place that the hand goes to
            soon = np.convolve(bears, np.ones(2 * round(0.7 * motion.fps) + 1), "same") > 0
            move = _filled(bears | ~soon, np.where(bears[:, None], with_surface(place), pelvis_move))
            wrists.append(place + move if bears.any() else None)
    soles = quat[:, [leg.end for leg in body.legs]]
    bent = _solved(
        motion,
        body,
        quat,
        motion.root_pos_w + pelvis_move,
        motion.local_quat[:, 0],
        np.stack(ankle_pos, 1),
        soles,
        wrists,
    )
    return replace(bent, wrist_goal_w=motion.wrist_goal_w * factor)


def _solved(
    motion: HumanMotion,
    body: Body,
    quat: np.ndarray,
    root_pos: np.ndarray,
    root_quat: np.ndarray,
    ankles: np.ndarray,
    feet: np.ndarray,
    wrists: list[np.ndarray | None] | None,
) -> HumanMotion:
    """The motion with its pelvis, ankles, feet and, where given, wrists elsewhere.

    Knees and elbows point where they did, seen from the pelvis.
    """
    local = motion.local_quat.copy()
    local[:, 0] = root_quat
    turn = rot.multiply(root_quat, rot.conjugate(quat[:, 0]))
    for side, leg in enumerate(body.legs):
        hip = root_pos + rot.rotate(root_quat, body.skeleton.offsets[leg.root])
        shin = _limb(local, body, leg, hip, ankles[:, side], _axis(turn, quat[:, leg.root]), root_quat, True)
        local[:, leg.end] = rot.multiply(rot.conjugate(shin), feet[:, side])
    for side, arm in enumerate(body.arms):
        place = wrists[side] if wrists is not None else None
        if place is not None:
            new_pos, new_quat = forward_kinematics(body.skeleton, root_pos, local)
            parent = body.skeleton.parents[arm.root]
            _limb(
                local,
                body,
                arm,
                new_pos[:, arm.root],
                place,
                _axis(turn, quat[:, arm.root]),
                new_quat[:, parent],
                False,
            )
    return replace(motion, root_pos_w=root_pos, local_quat=local)


def _axis(turn: np.ndarray, link: np.ndarray) -> np.ndarray:
    """(T, 3) where a hinge's axis points after a turn, from its upper link's orientation before."""
    return rot.rotate(turn, rot.rotate(link, np.array([0.0, 1.0, 0.0])))


def _limb(
    local: np.ndarray,
    body: Body,
    limb: Limb,
    root: np.ndarray,
    end: np.ndarray,
    axis: np.ndarray,
    parent: np.ndarray,
    backward: bool,
) -> np.ndarray:
    """Write the two links of a limb into local rotations; the orientation of the lower one."""
    upper, lower, _ = two_link(root, end, axis, *body.length(limb), backward)
    local[:, limb.root] = rot.multiply(rot.conjugate(parent), upper)
    local[:, limb.middle] = rot.multiply(rot.conjugate(upper), lower)
    return lower


def _held(share: np.ndarray, stands: np.ndarray) -> np.ndarray:
    """(T,) the share of a foot: that of the middle of each stance all through it, and from one to the next in
    between.
    """
    values = share.copy()
    edges = np.flatnonzero(np.diff(np.concatenate([[0], stands.astype(int), [0]])))
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        # who stands at the beginning or the end has to be there, all the others are in the middle of their step
        frame = 0 if start == 0 else (start + stop - 1) // 2
        values[start:stop] = share[-1] if stop == len(share) else share[frame]
    return _filled(stands, values[:, None])[:, 0]


def _filled(fixed: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(T, D) values where `fixed` (T,), and a smooth way from the last to the next of them in between."""
    filled = values.copy()
    frames = np.flatnonzero(fixed)
    if not len(frames):
        return filled
    filled[: frames[0]], filled[frames[-1] + 1 :] = values[frames[0]], values[frames[-1]]
    for start, stop in zip(frames[:-1], frames[1:], strict=True):
        if stop > start + 1:
            share = minimum_jerk(np.arange(1, stop - start) / (stop - start))[:, None]
            filled[start + 1 : stop] = values[start] + share * (values[stop] - values[start])
    return filled
