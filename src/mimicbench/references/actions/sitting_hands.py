"""What the hands do while somebody sits down: each goes its own way, to a support and on to where it rests."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.objects.shape import SceneObject
from mimicbench.references.actions.handholds import armrest, beside_thigh, hanging
from mimicbench.references.actions.postures import STRETCH
from mimicbench.references.actions.reaching import frames, within_reach, wrists_of
from mimicbench.references.actions.sit_styles import ARM, HANGS, LAP, SEAT, THIGH, SitStyle
from mimicbench.references.body.body import Body
from mimicbench.references.body.limbs import about_x, about_y, two_link
from mimicbench.references.body.posing import Arms, Legs, Trunk, blend, reach, shoulders, thigh_orientations
from mimicbench.references.curves import minimum_jerk
from mimicbench.references.locomotion.walking import Walk

ARRIVES = {THIGH: (-0.10, 0.45), SEAT: (0.20, 0.62), ARM: (0.02, 0.60)}
"""When a hand leaves for a support on the way down, and how long it takes, in durations of the way down."""
LEAVES = 0.92
"""When hands go on to where they rest, in durations of the way down."""
GOES = 0.95
"""So long that takes [s]."""
ARC = 0.07
"""Hands go through the air on arcs so high [m]."""
NEAR = 0.012
"""A hand bears when its wrist is so near to where it goes [m]."""

ARM_THICK = 0.035
"""Least distance of upper arm and forearm from the object [m], of body size 1: what is softer gives."""
ALONGS = (0.0, 0.25, -0.25, 0.5, 0.75)
"""How much farther forward hands look for a place to rest, one after the other."""

Supports = tuple[tuple[dict[float, np.ndarray], dict[float, np.ndarray]], SitStyle]
"""Per hand the places on the object [m] for its wrist, and the style as it can be done."""


@dataclass(frozen=True)
class Hands:
    """What the arms do in T frames."""

    arms: Arms
    bears: np.ndarray
    """(T, 2) how much each hand bears on the object, from 0 to 1."""
    touches: np.ndarray
    """(T, 2) bool, whether it is there."""


def find_supports(obj: SceneObject, body: Body, trunk: Trunk, legs: Legs, style: SitStyle) -> Supports:
    """The places that a style asks for, as they are beside who sits as trunk and legs do in their last frame.

    A hand whose place is not there, or not in reach, goes to the thigh; and none goes past an arm of the seat.
    """
    trunk, legs = frames(trunk, slice(-1, None)), frames(legs, slice(-1, None))
    found: tuple[dict[float, np.ndarray], dict[float, np.ndarray]] = ({}, {})
    for side, name in enumerate(("left", "right")):
        down, rest = style.down(side), style.rest(side)
        arm = _on_object(obj, body, trunk, style, side, ARM, 0.0)
        if arm is not None:  # no way past it
            down, rest = {SEAT: ARM, HANGS: THIGH}.get(down, down), {SEAT: ARM, HANGS: THIGH}.get(rest, rest)
            rest = THIGH if rest == ARM and down not in (ARM, THIGH) else rest
            found[side][ARM] = arm
        if down == SEAT and (wrist := _on_object(obj, body, trunk, style, side, SEAT, 0.0)) is not None:
            found[side][SEAT] = wrist
        if down in (ARM, SEAT) and down not in found[side]:
            down = THIGH if down == ARM else HANGS
        if rest in (SEAT, ARM, HANGS):
            places = (
                arm if rest == ARM and other == 0.0 else _on_object(obj, body, trunk, style, side, rest, other)
                for other in ALONGS
            )
            free = (at for at in places if at is not None and _clears(obj, body, trunk, style, at, rest, side))
            if (wrist := next(free, None)) is not None:
                found[side][rest] = wrist
            else:
                rest = THIGH
        if rest in (THIGH, LAP):
            for other in ALONGS:
                nearer = replace(style, **{f"{name}_along": float(np.clip(style.along(side) + other, 0.0, 1.0))})
                wrist = (_in_lap if rest == LAP else _on_thighs)(body, trunk, legs, nearer)[0, side]
                if _clears(obj, body, trunk, style, wrist, rest, side):
                    style = nearer
                    break
            else:  # elbows in
                style = replace(style, elbows=0.2)
        style = replace(style, **{f"{name}_down": down, f"{name}_rest": rest})
    return found, style


def tamer(style: SitStyle) -> Iterator[SitStyle]:
    """A style, and then ever plainer ones for where arms would go through the object: elbows in, hands on the thighs on
    the way down, and in the end as well.
    """
    yield style
    style = replace(style, elbows=0.2)
    yield style
    style = replace(style, left_down=THIGH, right_down=THIGH)
    yield style
    yield replace(style, left_rest=THIGH, right_rest=THIGH)


def arms_depth(obj: SceneObject, body: Body, trunk: Trunk, arms: Arms, some: np.ndarray) -> float:
    """How deep arms are in the object in some of the frames [m], negative if they are clear of it."""
    trunk, arms = frames(trunk, some), frames(arms, some)
    shoulder, upper = shoulders(body, trunk), rot.multiply(trunk.chest_quat_w[:, None], arms.upper)
    over, under = (np.array([0.0, 0.0, -length]) for length in body.length(body.arms[0]))
    elbow, lower = shoulder + rot.rotate(upper, over), rot.multiply(upper, arms.elbow)
    points = [shoulder + rot.rotate(upper, share * over) for share in (0.5, 0.85)]
    points += [elbow + rot.rotate(lower, share * under) for share in (0.15, 0.5, 0.85, 1.0)]
    return 0.042 - float(obj.distance(np.stack(points)).min())


def _on_object(
    obj: SceneObject, body: Body, trunk: Trunk, style: SitStyle, side: int, place: float, farther: float
) -> np.ndarray | None:
    """Where the wrist (3,) [m] is of a hand that is at a place on the object, `farther` in front than the style asks
    for, beside a trunk (1 frame).
    """
    pelvis, shoulder = trunk.pelvis_pos_w[0], shoulders(body, trunk)[0, side]
    against, along = style.against > 0, float(np.clip(style.along(side) + farther, 0.0, 1.0))
    if place == ARM:
        return armrest(obj, body, pelvis, shoulder, side, 0.03 + 0.06 * against + 0.20 * along)
    if place == SEAT:
        return beside_thigh(obj, body, pelvis, side, along, against)
    return hanging(obj, body, shoulder, side)


def _clears(
    obj: SceneObject, body: Body, trunk: Trunk, style: SitStyle, wrist: np.ndarray, place: float, side: int
) -> bool:
    """Whether an arm reaches a wrist (3,) [m] at a place from a trunk (1 frame) and is not in the object."""
    arm, shoulder = body.arms[side], shoulders(body, trunk)[:, side]
    axis = _elbow_axis(trunk, trunk.pelvis_quat_w, place, side, style.elbows)
    over, under, _ = two_link(shoulder, wrist[None], axis, *body.length(arm), False)
    upper, lower = (np.array([0.0, 0.0, -length]) for length in body.length(arm))
    elbow = shoulder + rot.rotate(over, upper)
    hand = elbow + rot.rotate(under, lower)
    shares = np.array([[0.4], [0.7], [1.0]])
    points = np.concatenate([shoulder + shares * (elbow - shoulder), elbow + shares[:2] * (hand - elbow)])
    near = float(np.linalg.norm(wrist - shoulder)) < STRETCH * sum(body.length(arm))
    return near and float(obj.distance(points).min()) > ARM_THICK * body.size


def move_hands(body: Body, way: Walk, trunk: Trunk, legs: Legs, clock: np.ndarray, supports: Supports) -> Hands:
    """Arms that swing while walking, go to their supports on the way down, and end where they rest; clock (T,) [s] is 0
    where the hips begin to sink.
    """
    places, style = supports
    moving = _free(body, way, trunk, clock, style)
    wrist = wrists_of(body, trunk, moving)
    axis = rot.rotate(rot.multiply(trunk.chest_quat_w[:, None], moving.upper), np.array([0.0, 1.0, 0.0]))
    gone, bears, touches = np.zeros(wrist.shape[:2]), np.zeros(wrist.shape[:2]), np.zeros(wrist.shape[:2], bool)
    thighs, lap = _on_thighs(body, trunk, legs, style), _in_lap(body, trunk, legs, style)
    for side in (0, 1):
        for place, begins, lasts in _moves(style, side):
            share = minimum_jerk((clock - begins) / lasts)
            if place == THIGH:
                goal = thighs[:, side]
            elif place == LAP:
                goal = lap[:, side]
            else:
                goal = np.broadcast_to(places[side][place], wrist[:, side].shape)
            bump = 16 * share**2 * (1 - share) ** 2
            wrist[:, side] += share[:, None] * (goal - wrist[:, side])
            wrist[:, side, 2] += ARC * bump
            axis[:, side] += share[:, None] * (
                _elbow_axis(trunk, rot.from_yaw(way.yaw), place, side, style.elbows) - axis[:, side]
            )
            gone[:, side] = np.maximum(gone[:, side], minimum_jerk((clock - begins) / (0.5 * lasts)))
            bears[:, side] += share * (float(place in (SEAT, ARM)) - bears[:, side])
    arms = blend(moving, reach(body, trunk, within_reach(body, trunk, wrist), axis), gone)
    at = wrists_of(body, trunk, arms)
    for side in (0, 1):
        for place in (SEAT, ARM):
            if place in places[side]:
                near = np.linalg.norm(at[:, side] - places[side][place], axis=-1) < NEAR
                touches[:, side] |= near & (bears[:, side] > 0.5)
    return Hands(arms, bears, touches)


def lay_flat(body: Body, quat: np.ndarray, trunk: Trunk, hands: Hands) -> None:
    """Turn the hands of local rotations (T, J, 4) flat, fingers forward, as far as they bear on something."""
    for side in np.flatnonzero(hands.bears.any(0)):
        forearm = rot.multiply(
            rot.multiply(trunk.chest_quat_w, quat[:, body.arms[side].root]), quat[:, body.arms[side].middle]
        )
        flat = rot.multiply(rot.conjugate(forearm), about_y(np.array(-1.35)))
        end = body.arms[side].end
        quat[:, end] = rot.slerp(quat[:, end], flat, hands.bears[:, side])


def _moves(style: SitStyle, side: int) -> list[tuple[float, float, float]]:
    """(place, begins [s], lasts [s]) of all that a hand does after it has swung."""
    down, rest, late = style.down(side), style.rest(side), style.late(side)
    moves = []
    if down in ARRIVES:
        begins, lasts = ARRIVES[down]
        moves.append((down, begins * style.sit_duration + 0.4 * late, lasts * style.sit_duration))
    if rest != down or down == HANGS:
        begins, lasts = (
            (LEAVES * style.sit_duration + late, GOES)
            if down in ARRIVES
            else (0.46 * style.sit_duration + 0.4 * late, 1.3)
        )
        moves.append((rest, begins, lasts))
    return moves


def _free(body: Body, way: Walk, trunk: Trunk, clock: np.ndarray, style: SitStyle) -> Arms:
    """Arms that swing with the steps, and hang from a trunk that leans."""
    swinging = way.arms(body, style.arm_swing)
    down = rot.rotate(trunk.chest_quat_w, np.array([0.0, 0.0, 1.0]))
    pitch = np.arctan2(down[:, 0] * np.cos(way.yaw) + down[:, 1] * np.sin(way.yaw), down[:, 2])
    begun = minimum_jerk(clock / style.sit_duration / 0.4 + 0.4)
    out = 0.35 * begun[:, None] * np.array([1.0, -1.0])  # arms that hang from who leans swing out
    upper = rot.multiply(swinging.upper, about_x(out))
    return Arms(
        rot.multiply(about_y(-style.hang * begun * np.maximum(pitch, 0.0))[:, None], upper),
        rot.multiply(swinging.elbow, about_y(-0.25 * begun)[:, None]),
    )


def _elbow_axis(trunk: Trunk, heading: np.ndarray, place: float, side: int, out: float) -> np.ndarray:
    """(T, 3) where the elbow's y axis points of a hand at a place: elbows stay behind it, and beside it as far as they
    point outward.

    `heading` (T, 4) is where the person faces.
    """
    sign = 1.0 - 2.0 * side
    if place in (SEAT, ARM):
        return rot.rotate(heading, np.array([sign * (0.5 if place == ARM else 0.2), 1.0, 0.0]))
    return rot.rotate(trunk.chest_quat_w, np.array([sign * out * {THIGH: 1.0, LAP: 1.2, HANGS: 0.0}[place], 1.0, 0.0]))


def _thighs(body: Body, trunk: Trunk, legs: Legs) -> tuple[np.ndarray, np.ndarray]:
    """(T, 2, 3) hips [m] and (T, 2, 4) orientations of both thighs."""
    hips = trunk.pelvis_pos_w[:, None] + rot.rotate(
        trunk.pelvis_quat_w[:, None], body.skeleton.offsets[[leg.root for leg in body.legs]]
    )
    return hips, thigh_orientations(body, trunk, legs)


def _on_thighs(body: Body, trunk: Trunk, legs: Legs, style: SitStyle) -> np.ndarray:
    """(T, 2, 3) wrists of hands that lie on the thighs [m], as far towards the knees as is wanted and as the arms reach
    in the end.
    """
    hips, thigh = _thighs(body, trunk, legs)
    above = np.array([[0.09, 0.03, 0.0], [0.09, -0.03, 0.0]]) * body.size
    along = np.array([0.0, 0.0, -body.length(body.legs[0])[0]])
    last = shoulders(body, frames(trunk, slice(-1, None)))[0]
    shares = np.arange(0.0, 0.55, 0.03)[:, None]
    nearest = 0.38 if style.against > 0 else 0.26  # elbows stay in front of the back
    wanted = [nearest + (0.82 - nearest) * style.along(side) for side in (0, 1)]
    shares = np.maximum(np.array(wanted) - shares, 0.2)  # (S, 2)
    places = hips[-1] + rot.rotate(thigh[-1], above + shares[..., None] * along)  # (S, 2, 3)
    near = np.linalg.norm(places - last, axis=-1) < STRETCH * sum(body.length(body.arms[0]))
    share = np.where(near.any(0), shares[near.argmax(0), [0, 1]], shares[-1])
    return hips + rot.rotate(thigh, above + share[:, None] * along)


def _in_lap(body: Body, trunk: Trunk, legs: Legs, style: SitStyle) -> np.ndarray:
    """(T, 2, 3) wrists of hands that lie over each other between the thighs [m]."""
    hips, thigh = _thighs(body, trunk, legs)
    share = np.array([0.36 + 0.20 * style.along(side) for side in (0, 1)])[:, None]
    along = np.array([0.0, 0.0, -body.length(body.legs[0])[0]])
    over = hips + rot.rotate(thigh, np.array([0.10 * body.size, 0.0, 0.0]) + share * along)
    middle = over.mean(1, keepdims=True)
    return middle + 0.42 * (over - middle)
