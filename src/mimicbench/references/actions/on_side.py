"""Turning from the back onto the side: pelvis and chest roll as one piece, the knees draw up together, the hands go
in front of the chest.
"""

from dataclasses import replace

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.references.actions.lying_style import TURNING_TIME, Lying
from mimicbench.references.actions.reaching import within_reach, wrists_of
from mimicbench.references.actions.resting_hands import skull_of
from mimicbench.references.body.limbs import about_x, about_y, two_link
from mimicbench.references.body.posing import Arms, Legs, Trunk, reach, shoulders
from mimicbench.references.curves import minimum_jerk

SHIN = -0.55
"""How far shins point forward in the end [rad]; thighs as far as the style says."""
SHOULDER = 0.062
"""Height of the lower shoulder above the bed, at body size 1 [m]."""
UPPER = 0.22
"""The upper thigh is drawn up so much farther [rad]."""
FRONT = ((0.27, -0.22, 0.055), (0.25, 0.0, 0.08))
"""Where the lower and the upper wrist lie, from their shoulders to the front and to the head, and above the bed, at
body size 1 [m]."""
EDGE = 0.04
"""Hands lie so far in front of the place where somebody sat on the edge, at most, at body size 1 [m]."""
LEAVE = ((0.05, 0.80), (0.25, 1.0))
"""Between which parts of the turn the lower and the upper hand go there."""


def turn_over(act: Lying, trunk: Trunk, legs: Legs, arms: Arms) -> tuple[Trunk, Legs, Arms]:
    """Who lies on the back, with stretched legs and resting arms, rolls onto the side that is at the free edge."""
    body, out, side, clock = act.body, act.berth.out, act.near, act.clock
    sign, progress = 1.0 - 2.0 * side, (clock - act.style.turns) / TURNING_TIME
    share = minimum_jerk(progress)
    roll = sign * act.style.roll * share
    # the hip below bears the weight, and the shoulder, which is wider, raises the chest
    rise = (body.hip_half_width + 0.07 * body.size - body.back) * np.sin(np.abs(roll))
    pos = trunk.pelvis_pos_w + np.stack(
        [-0.10 * body.size * share * out[0], -0.10 * body.size * share * out[1], rise], -1
    )
    pelvis = rot.multiply(trunk.pelvis_quat_w, rot.from_yaw(roll))
    chest_turn, head_turn = (
        rot.multiply(rot.conjugate(below), above)
        for below, above in ((trunk.pelvis_quat_w, trunk.chest_quat_w), (trunk.chest_quat_w, trunk.head_quat_w))
    )
    straight = rot.multiply(pelvis, chest_turn)
    trunk = Trunk(pos, pelvis, straight, rot.multiply(straight, head_turn))
    chest = _on_shoulder(act, trunk, share)
    rolled = replace(trunk, chest_quat_w=chest, head_quat_w=rot.multiply(chest, head_turn))
    rolled = replace(rolled, head_quat_w=_on_pillow(act, rolled, share))
    return (
        rolled,
        _knees_drawn_up(act, minimum_jerk(1.08 * progress + 0.11), rolled, legs),
        _hands_in_front(act, rolled, arms, progress),
    )


def _on_shoulder(act: Lying, trunk: Trunk, share: np.ndarray) -> np.ndarray:
    """(T, 4) the chest, which bends aside with share (T,) until the lower shoulder lies on the bed."""
    body, sign, bends = act.body, 1.0 - 2.0 * act.near, np.array([0.0, 0.35])
    tried = replace(_last(trunk), chest_quat_w=rot.multiply(_last(trunk).chest_quat_w, about_x(sign * bends)))
    height = shoulders(body, tried)[:, act.near, 2]
    bend = _between(act.berth.height + SHOULDER * body.size, height, bends)
    return rot.multiply(trunk.chest_quat_w, about_x(sign * bend * share))


def _on_pillow(act: Lying, trunk: Trunk, share: np.ndarray) -> np.ndarray:
    """(T, 4) the head, which bends aside with share (T,) until it lies on the pillow."""
    body, sign, bends = act.body, 1.0 - 2.0 * act.near, np.array([-0.65, 0.45])
    tried = replace(_last(trunk), head_quat_w=rot.multiply(_last(trunk).head_quat_w, about_x(sign * bends)))
    radius = next(part.radius for part in body.parts if part.role == "head")
    bend = _between(act.berth.height + act.berth.pillow + radius - 0.01, skull_of(body, tried)[:, 2], bends)
    return rot.multiply(trunk.head_quat_w, rot.multiply(about_x(sign * bend * share), about_y(0.12 * share)))


def _last(trunk: Trunk) -> Trunk:
    """The last frame, twice."""
    return Trunk(*(np.repeat(value[-1:], 2, 0) for value in vars(trunk).values()))


def _between(wanted: float, values: np.ndarray, at: np.ndarray) -> float:
    """Where between two places (2,) a value is as wanted that is (2,) there; at one of them if it is beyond."""
    order = np.argsort(values)
    return float(np.interp(wanted, values[order], at[order]))


def _knees_drawn_up(act: Lying, share: np.ndarray, trunk: Trunk, legs: Legs) -> Legs:
    """Both knees bent, the lower leg on the bed and the upper one on it, drawn up a little farther."""
    body, height, side = act.body, act.berth.height, act.near
    upper, lower = body.length(body.legs[0])
    axis = rot.rotate(trunk.pelvis_quat_w, np.array([0.0, 1.0, 0.0]))
    ankle, foot = [], []
    for i, leg in enumerate(body.legs):
        # from the hip, forward, to the left, up; the upper leg comes down to the lower one
        thigh, shin = (act.style.curl, SHIN) if i == side else (act.style.curl + UPPER, SHIN + UPPER)
        aside = 0.0 if i == side else (1 - 2 * side) * 0.045 * body.size
        ahead, down = upper * np.sin(thigh) + lower * np.sin(shin), upper * np.cos(thigh) + lower * np.cos(shin)
        bent = np.array([ahead, aside, -down])
        goal = trunk.pelvis_pos_w[-1] + rot.rotate(trunk.pelvis_quat_w[-1], body.skeleton.offsets[leg.root] + bent)
        goal[2] = height + (0.045 if i == side else 0.13) * body.size
        place = legs.ankle_pos_w[:, i] + share[:, None] * (goal - legs.ankle_pos_w[:, i])
        hip = trunk.pelvis_pos_w + rot.rotate(trunk.pelvis_quat_w, body.skeleton.offsets[leg.root])
        calf = two_link(hip, place, axis, upper, lower, True)[1]
        ankle.append(place)
        foot.append(rot.slerp(legs.foot_quat_w[:, i], rot.multiply(calf, about_y(np.full(len(share), 0.25))), share))
    blended = legs.knee_axis_w + share[:, None, None] * (axis[:, None] - legs.knee_axis_w)
    return Legs(np.stack(ankle, 1), np.stack(foot, 1), blended, legs.toe_bend)


def _hands_in_front(act: Lying, trunk: Trunk, arms: Arms, progress: np.ndarray) -> Arms:
    """Both hands come down onto the bed in front of the chest, close to the body all the way."""
    body, height, out, side = act.body, act.berth.height, act.berth.out, act.near
    # as far as the bed reaches
    most = float((act.berth.seat_xy - trunk.pelvis_pos_w[-1, :2]) @ out) / body.size + EDGE
    chest = rot.rotate(trunk.chest_quat_w, np.array([0.0, 0.0, 1.0]))[-1]
    front, head = np.array([*out, 0.0]), np.array([*chest[:2], 0.0]) / np.hypot(*chest[:2])
    up, offset = np.array([0.0, 0.0, 1.0]), body.skeleton.offsets[[arm.middle for arm in body.arms]]
    wrists, roots = wrists_of(body, trunk, arms), shoulders(body, trunk)
    poles = roots + rot.rotate(rot.multiply(trunk.chest_quat_w[:, None], arms.upper), offset) - 0.5 * (roots + wrists)
    poles /= np.linalg.norm(poles, axis=-1, keepdims=True)
    for i in range(2):
        (ahead, along, above), (begin, end) = FRONT[int(i != side)], LEAVE[int(i != side)]
        goal = roots[-1, i] + body.size * (min(ahead, most) * front + along * head)
        goal[2] = height + above * body.size
        share = minimum_jerk((progress - begin) / (end - begin))[:, None]
        wrists[:, i] += share * (goal - wrists[:, i])
        # the lower elbow stays where it lies, and is on the front's side in the end
        turned, pole = (
            (minimum_jerk((progress + 0.35) / 0.35)[:, None], front + 0.3 * head + 0.3 * up)
            if i == side
            else (share, -head)
        )
        poles[:, i] += turned * (pole / np.linalg.norm(pole) - poles[:, i])
    wrists = within_reach(body, trunk, wrists)
    return reach(body, trunk, wrists, np.cross(wrists - roots, poles))
