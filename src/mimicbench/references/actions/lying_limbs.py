"""What legs and arms do while somebody lies down: one leg after the other swings up, the hands bear the trunk down,
and all come to rest, one later than the other.
"""

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.references.actions.berths import lifted_share, resting_foot
from mimicbench.references.actions.lying_style import TURNING_TIME, Lying, ease
from mimicbench.references.actions.reaching import wrists_of
from mimicbench.references.actions.resting_hands import BESIDE, HEAD, UP, Bedding
from mimicbench.references.body.body import Body
from mimicbench.references.body.hands import lay_on_body, point_hands
from mimicbench.references.body.limbs import about_y, two_link
from mimicbench.references.body.posing import Arms, Legs, Trunk, blend, reach, shoulders, thigh_orientations
from mimicbench.references.curves import minimum_jerk

LOWER = 0.07
"""The second leg swings up so much less high [m], at body size 1."""
WIDE = {UP, HEAD}
"""Spots to which an arm goes through the air, not along the bed."""
FORWARD = (0.30, 0.48)
"""How far the arm at the pillow's side and the other one swing forward while somebody sits down [rad]: people hold
their hands 14 cm in front of the hips, not out."""
REPLANTS = (0.7, 2.4)
"""When on the clock the hand that bears behind who sits goes to where it bears who lies."""
SHIFT = 1.6
"""A hand or a leg that changes its place takes so long [s]."""


def move_legs(act: Lying, trunk: Trunk, scoot: np.ndarray) -> tuple[Legs, np.ndarray]:
    """The legs, and (T, 2) where each foot stands or lies still.

    `scoot` (T,) is the share of its way that the pelvis has gone from the seat's edge to where it lies.
    """
    walking, body, berth = act.way.legs(), act.body, act.berth
    base = berth.seat_xy + scoot[:, None] * (berth.pelvis_xy - berth.seat_xy)
    axis = rot.rotate(trunk.pelvis_quat_w, np.array([0.0, 1.0, 0.0]))
    facing = np.arctan2(berth.out[1], berth.out[0])
    ankle, foot, still, hinge = [], [], [], []
    for side, sign in enumerate((1.0, -1.0)):
        late, swing = act.late(side), berth.turn * act.swing(side)
        lift, land = (ease(act.clock, 0.05 + late, 1.5 + late), ease(act.clock, 1.75 + late, 2.8 + late))
        stretch = _stretched(act, side)
        (r, across, z), pitch = _seen_from_above(act, side, walking.ankle_pos_w[-1, side], lift, land, stretch)
        forward = np.stack([r, sign * across, np.zeros_like(r)], -1)
        heading = rot.from_yaw(swing + facing)
        off = lift > 0
        swung = np.concatenate([base, z[:, None]], -1) + rot.rotate(heading, forward)
        place = np.where(off[:, None], swung, walking.ankle_pos_w[:, side])
        hip = trunk.pelvis_pos_w + rot.rotate(trunk.pelvis_quat_w, body.skeleton.offsets[body.legs[side].root])
        shin = two_link(hip, place, axis, *body.length(body.legs[side]), True)[1]
        hanging = rot.multiply(shin, about_y(0.15 * ease(act.clock, 0.6, 1.8)))
        laid = rot.multiply(heading, about_y(-pitch))
        raised = rot.slerp(walking.foot_quat_w[:, side], hanging, ease(act.clock, 0.1 + late, 1.2 + late))
        ankle.append(place)
        foot.append(rot.slerp(raised, laid, land))
        moves = np.abs(np.gradient(stretch)) > 0
        still.append(np.where(off, (land >= 1) & (scoot >= 1) & ~moves, act.way.feet.contact[:, side]))
        # a knee that is up leans out, or both to one side
        askew = act.style.askew if act.berth.wide else abs(act.style.askew) * (1.0 if act.near == 0 else -1.0)
        splay = (act.style.splay * sign + askew) * land * (1.0 - stretch) * ease(act.clock, 2.4 + late, 4.4 + late)
        hinge.append(rot.rotate(rot.from_rotvec(splay[:, None] * _along(place - hip)), axis))
    share = ease(act.clock, -0.6, 0.4)[:, None, None]
    knee_axis = walking.knee_axis_w * (1 - share) + share * np.stack(hinge, 1)
    return Legs(np.stack(ankle, 1), np.stack(foot, 1), knee_axis, walking.toe_bend), np.stack(still, -1)


def _along(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def _stretched(act: Lying, side: int) -> np.ndarray:
    """(T,) how far a leg that lies is stretched, from 0, foot flat and knee up, to 1; once more it changes at rest."""
    late, up = act.late(side), (act.style.left_up, act.style.right_up)[side]
    stretch = (1.0 - up) * ease(act.clock, 3.1 + late, 4.9 + late)
    if act.style.later_leg == 1.0 - 2.0 * side and act.style.side < 0.5:
        other = minimum_jerk((act.rest - act.style.later) / SHIFT)
        stretch = stretch + (2.0 * up - 1.0) * other
    return stretch


def _seen_from_above(
    act: Lying, side: int, standing: np.ndarray, lift: np.ndarray, land: np.ndarray, stretch: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(3, T) distance and side of an ankle as seen from a pelvis that faces it, and its height [m]; and (T,) how far
    the toes of the laid foot point up [rad].
    """
    body, berth, sign = act.body, act.berth, 1.0 - 2.0 * side
    left = np.array([-berth.out[1], berth.out[0]])
    final, final_pitch = resting_foot(body, berth, act.style.stretch)
    final = final + [0.0, act.style.apart * body.size * berth.wide, 0.0]
    knees_up, landed_pitch = resting_foot(body, berth, min(act.style.bent, act.style.stretch))
    aloft, full = lifted_share(body, berth), sum(body.length(body.legs[0]))
    lifted = np.array(
        [
            aloft * full,
            body.hip_half_width + 0.03,
            berth.height + body.sole + (0.10 + 0.40 * (0.66 - aloft)) * body.size,
        ]
    )
    # the second leg, for which the pelvis already leans back, less high
    high = lifted - [0.0, 0.0, LOWER * body.size * (act.late(side) > 0)]
    away = standing[:2] - berth.seat_xy
    first = np.array([away @ berth.out, sign * (away @ left), standing[2]])
    places = (
        first
        + lift[:, None] * (high - first)
        + land[:, None] * (knees_up - high)
        + stretch[:, None] * (final - knees_up)
    )
    return places.T, landed_pitch + stretch * (final_pitch - landed_pitch)


def move_arms(act: Lying, trunk: Trunk, legs: Legs) -> tuple[Arms, np.ndarray]:
    """Arms that come forward to sit, bear the trunk while it goes down, and rest; and (T, 2) where the hands bear."""
    body, berth, style, clock = act.body, act.berth, act.style, act.clock
    # who is late comes forward a little sooner than to the thigh, or the hand would meet the edge
    later, farther, thigh = act.hands()
    forward = minimum_jerk((act.sitting[:, None] - 0.8 * later) / 0.65)
    swinging = act.way.arms(body, style.arm_swing)
    # the hand that is to bear the trunk comes forward less
    amount = farther * np.where(np.arange(2) == act.near, FORWARD[0], FORWARD[1]) * forward
    moving = Arms(
        rot.multiply(about_y(-amount), swinging.upper), rot.multiply(swinging.elbow, about_y(-0.25 * forward))
    )
    goal = _support(act)
    planted = _within_reach(body, trunk, goal)
    # the elbows point backward under a raised trunk, and outward beside a lying one
    lowered = ease(clock, 1.6, 4.0)[:, None, None]
    outward = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    axis = (1 - lowered) * (0.35 * outward + [0.0, 1.0, 0.0]) + lowered * (outward + [0.0, 0.1, 0.0])
    support = reach(body, trunk, planted, rot.rotate(trunk.chest_quat_w[:, None], axis))
    start, rest = np.zeros((len(clock), 2)), np.zeros((len(clock), 2))
    bearing = np.zeros((len(clock), 2), bool)
    for side in range(2):
        begin, late = (-1.0, 0.0) if side == act.near else (-0.9, 0.35)
        if side == act.near or berth.wide:
            start[:, side] = ease(clock, begin, begin + 1.0)
            bearing[:, side] = (clock >= begin + 1.0) & (clock < 2.4)
            wide = act.spots[0][side] in WIDE
            rest[:, side] = ease(clock, 3.6 + late - 0.5 * wide, 5.3 + late + 0.4 * wide)
        else:
            rest[:, side] = ease(clock, 1.8, 4.0)
    on_thighs = thigh * minimum_jerk((act.sitting[:, None] - 0.65 - later) / 0.55)
    arms = blend(moving, _on_thighs(body, trunk, legs), on_thighs)
    bearing &= np.linalg.norm(planted - goal, axis=-1) < 0.01
    bearing[:, 1 - act.near] &= (clock < REPLANTS[0]) | (clock >= REPLANTS[1])
    return _go_to_rest(act, trunk, legs, blend(arms, support, start), rest), bearing


def _go_to_rest(act: Lying, trunk: Trunk, legs: Legs, arms: Arms, share: np.ndarray) -> Arms:
    """Arms that go on with share (T, 2) to where they rest first, and later to where they do then: over the body, or
    through the air beside it where the bed would be in the way.
    """
    body, style = act.body, act.style
    bedding = Bedding(body, act.berth, trunk, legs, (style.left_farther, style.right_farther))
    before, raised = (BESIDE, BESIDE), _raised(act, trunk)
    for spots, shares in zip(act.spots, (share, _later(act)), strict=True):
        goes = shares * (np.array(spots) != before) if shares is not share else shares
        rested = [bedding.rest(spot, side) for side, spot in enumerate(spots)]
        wrists, poles = (np.stack([getattr(rest, name) for rest in rested], 1) for name in ("wrist_w", "pole_w"))
        there = _bent_to(body, trunk, _within_reach(body, trunk, wrists), poles)
        high = [
            bool({bedding.possible(spots[side], side), bedding.possible(before[side], side)} & WIDE) for side in (0, 1)
        ]
        free = [side == act.near or act.berth.wide for side in (0, 1)]
        straight = blend(_over_the_body(act, trunk, arms, (wrists, poles), goes), there, (goes >= 1.0).astype(float))
        # beside a sofa's back the elbow goes along it; to beside the head the arm is raised first
        wide = blend(blend(arms, raised, goes), blend(raised, there, goes), goes)
        arms = _choose(blend(arms, there, goes), _choose(straight, wide, high), free)
        before = spots
    return arms


def _choose(first: Arms, second: Arms, sides: list[bool]) -> Arms:
    """The second arm on some sides (2,), the first on the others."""
    mask = np.array(sides)[:, None]
    return Arms(np.where(mask, second.upper, first.upper), np.where(mask, second.elbow, first.elbow))


def _over_the_body(
    act: Lying, trunk: Trunk, arms: Arms, goal: tuple[np.ndarray, np.ndarray], share: np.ndarray
) -> Arms:
    """Arms that go to wrists and poles (T, 2, 3) each with share (T, 2), a little raised on the way."""
    body, wrists = act.body, wrists_of(act.body, trunk, arms)
    elbows = body.skeleton.offsets[[arm.middle for arm in body.arms]]
    roots = shoulders(body, trunk)
    bent = roots + rot.rotate(rot.multiply(trunk.chest_quat_w[:, None], arms.upper), elbows) - 0.5 * (roots + wrists)
    way, poles = share[..., None], _along(bent)
    moved = wrists + way * (goal[0] - wrists) + 4.0 * way * (1.0 - way) * [0.0, 0.0, 0.04 * body.size]
    return blend(
        arms,
        _bent_to(body, trunk, _within_reach(body, trunk, moved), poles + way * (_along(goal[1]) - poles)),
        (share > 0).astype(float),
    )


def _bent_to(body: Body, trunk: Trunk, wrists: np.ndarray, poles: np.ndarray) -> Arms:
    """Arms with wrists (T, 2, 3) [m] whose elbows point to poles (T, 2, 3)."""
    return reach(body, trunk, wrists, np.cross(wrists - shoulders(body, trunk), poles))


def _raised(act: Lying, trunk: Trunk) -> Arms:
    """Arms raised beside the shoulders, on the way to beside the head."""
    out, head = np.array([*act.berth.out, 0.0]), np.array([*act.berth.head, 0.0])
    away = np.array([[1.0], [-1.0]]) * (1.0 if act.near == 0 else -1.0) * out
    wrists = shoulders(act.body, trunk) + act.body.size * (0.26 * away + 0.10 * head + [0.0, 0.0, 0.26])
    return _bent_to(act.body, trunk, wrists, np.broadcast_to(away - 0.3 * head, wrists.shape))


def _later(act: Lying) -> np.ndarray:
    """(T, 2) the share of the posture that hands take later."""
    return np.repeat(minimum_jerk((act.rest - act.style.later) / SHIFT)[:, None], 2, 1)


def _support(act: Lying) -> np.ndarray:
    """(T, 2, 3) places on the bed on which the hands bear the trunk while it goes down [m]."""
    berth, size = act.berth, act.body.size
    out, head = np.array([*berth.out, 0.0]), np.array([*berth.head, 0.0])
    lying, near = np.array([*berth.pelvis_xy, berth.height + 0.05]), act.near
    edge = float((berth.seat_xy - berth.pelvis_xy) @ berth.out)
    behind, beside = np.empty((2, 3)), np.empty((2, 3))
    behind[near] = lying + min(edge, 0.30 * size) * out + 0.145 * size * head
    behind[1 - near] = lying - 0.27 * size * out + 0.14 * size * head
    beside[near], beside[1 - near] = (lying + sign * 0.30 * size * out + 0.02 * size * head for sign in (1, -1))
    # behind who sits, and then where the pelvis goes: the hand on that side is put down twice
    first, moved = behind.copy(), ease(act.clock, *REPLANTS)[:, None]
    first[1 - near, :2] = berth.seat_xy - 0.12 * size * berth.out - 0.20 * size * berth.head
    places = first + moved[..., None] * (behind - first)
    places[:, 1 - near] += 0.06 * size * np.sin(np.pi * moved) * np.array([0.0, 0.0, 1.0])
    # the hands slide down beside the hips while the trunk goes down
    return places + ease(act.clock, 2.4, 4.4)[:, None, None] * (beside - behind)


def _on_thighs(body: Body, trunk: Trunk, legs: Legs) -> Arms:
    """Arms whose hands lie on the thighs of who sits, until they go to the mattress."""
    thigh = thigh_orientations(body, trunk, legs)
    roots = body.skeleton.offsets[[leg.root for leg in body.legs]]
    hips = trunk.pelvis_pos_w[:, None] + rot.rotate(trunk.pelvis_quat_w[:, None], roots)
    on_thigh = hips + rot.rotate(thigh, np.array([[0.10, 0.03, -0.25], [0.10, -0.03, -0.25]]) * body.size)
    axis = rot.rotate(trunk.chest_quat_w[:, None], np.array([[0.30, 1.0, 0.0], [-0.30, 1.0, 0.0]]))
    return reach(body, trunk, _within_reach(body, trunk, on_thigh), axis)


def lay_hands_down(act: Lying, trunk: Trunk, legs: Legs, quat: np.ndarray) -> np.ndarray:
    """Local rotations (T, J, 4) with hands that lie flat: on the thighs, where they rest, and in the end on the bed in
    front of who lies on the side.
    """
    body, berth, style = act.body, act.berth, act.style
    quat = lay_on_body(body, trunk, quat)
    bedding = Bedding(body, berth, trunk, legs, (style.left_farther, style.right_farther))
    shares = (ease(act.clock, 4.0, 5.6), minimum_jerk((act.rest - style.later) / SHIFT))
    for spots, share in zip(act.spots, shares, strict=True):
        fingers = np.stack([bedding.rest(spot, side).fingers_w for side, spot in enumerate(spots)], 1)
        flat = point_hands(body, trunk, quat, _along(fingers), np.ones((len(quat), 2)))
        quat = _blended(body, quat, flat, share)
    if style.side > 0.5:
        front, head = np.array([*berth.out, 0.0]), np.array([*berth.head, 0.0])
        flat = point_hands(body, trunk, quat, 0.8 * front + 0.6 * head, np.ones((len(quat), 2)))
        quat = _blended(body, quat, flat, ease(act.clock, style.turns + 0.8, style.turns + TURNING_TIME))
    return quat


def rests_beside(act: Lying) -> np.ndarray:
    """(T, 2) where hands rest beside the hips, and bear."""
    first, last = act.spots
    moved = act.rest > act.style.later
    sides = [np.where(moved, later == BESIDE, spot == BESIDE) for spot, later in zip(first, last, strict=True)]
    moving = moved & (act.rest < act.style.later + SHIFT)
    wide = [side == act.near or act.berth.wide for side in range(2)]
    return np.stack(sides, -1) & wide & ((act.clock >= 5.65) & ~moving)[:, None]


def _blended(body: Body, quat: np.ndarray, other: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Local rotations (T, J, 4) with hands that turn to those of other ones with share (T,)."""
    quat, ends = quat.copy(), [arm.end for arm in body.arms]
    quat[:, ends] = rot.slerp(quat[:, ends], other[:, ends], share[:, None])
    return quat


def _within_reach(body: Body, trunk: Trunk, wrist_pos_w: np.ndarray) -> np.ndarray:
    """Wrists (T, 2, 3) [m] pulled smoothly towards the shoulders where the arms would have to be straight: elbows do
    not snap.
    """
    roots, most, soft = shoulders(body, trunk), 0.95 * sum(body.length(body.arms[0])), 0.02 * body.size
    delta = wrist_pos_w - roots
    length = np.linalg.norm(delta, axis=-1, keepdims=True)
    return roots + delta / length * (most - soft * np.logaddexp(0.0, (most - length) / soft))
