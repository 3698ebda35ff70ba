"""Sitting down: what a person who stands in front of a seat does from there on, in any of several styles.

The trunk leans forward, the hips go back and down, the arms come forward for balance or reach for a support, the trunk
comes up
again; perhaps the pelvis slides back and the trunk leans against the back. Then the person rests: breathes, and looks
around.
"""

from dataclasses import dataclass, replace

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.curves import minimum_jerk
from mimicbench.core.motion import HumanMotion
from mimicbench.objects.shape import SceneObject
from mimicbench.references.actions.seats import (
    Leaning,
    Place,
    armrest,
    beside_thigh,
    feet_allowed,
    lean_against,
    place_at,
)
from mimicbench.references.body.body import Body
from mimicbench.references.body.hands import keep_off, lay_on_body
from mimicbench.references.body.limbs import about_y
from mimicbench.references.body.liveliness import Rest, enliven
from mimicbench.references.body.posing import Arms, Legs, Trunk, blend, pose, reach, shoulders, thigh_orientations
from mimicbench.references.locomotion.course import Course
from mimicbench.references.locomotion.gait import Gait, Route, around_box, last_turn
from mimicbench.references.locomotion.walking import FPS, Walk, walk

CONTACTS = ("left_foot", "right_foot", "pelvis", "back", "left_hand", "right_hand")
PAUSE = 0.35
"""From the last touch-down to the first bend [s]."""
UPRIGHT = 1.61
"""When the trunk is upright again, in durations of the way to the seat."""
FALL = 0.34
"""Time in which who drops falls the last centimeters [s]."""
NEAR = 0.012
"""A hand bears when its wrist is so near to where it goes [m]."""
SLIDE, LEAN_BACK = 1.1, 1.7
"""Time to slide back on the seat, and to lean against its back [s]."""
FEET_COME_OUT = (1.02, 1.30)
"""When the left and the right foot of who gets comfortable leave the floor, in durations of the way to the seat."""
FOOT_LIFTS = 0.03
"""How high they are lifted [m]."""
SLUMP = 0.10
"""How far the chest of who leans back is bent forward [rad]."""

Supports = tuple[tuple[np.ndarray | None, ...], "SitStyle"]
"""Where both wrists go [m], None for a hand that goes nowhere, and the style as it can be done."""


@dataclass(frozen=True)
class SitStyle:
    """What a clip chooses beyond its start and its seat; stored with it. What is chosen or not is 1 or -1."""

    body_scale: float
    """Size of the body."""
    speed: float
    """Walking speed [m/s]."""
    sit_duration: float
    """From the first bend to the seat [s]."""
    lean: float
    """How far pelvis and trunk pitch forward on the way down [rad]."""
    recline: float
    """How far they lean back in the end, without support [rad]."""
    seat_x: float
    """Offset of the seated pelvis [m], forward."""
    seat_y: float
    """Offset of the seated pelvis and of the feet from the middle of the seat [m], to the left."""
    arm_swing: float
    """Swing of the arms, as a share of the usual."""
    duration: float = 0.0
    """Length of the clip, with a rest at its end, at least [s]."""
    on_thighs: float = -1.0
    """Whether the hands push on the thighs on the way down. They end there unless they are on the seat or on its
    arms."""
    on_seat: float = -1.0
    """Whether the hands go to the seat beside the thighs."""
    on_arms: float = -1.0
    """Whether the hands go to the arms of the seat that are in reach."""
    drop: float = 0.0
    """How much of the way down ends in a fall [m]."""
    against: float = -1.0
    """Whether the pelvis slides back in the end, and the trunk leans against the back."""
    lean_back: float = 0.0
    """How far it then leans [rad], or a little more or less, as the back allows."""
    lead: float = 0.0
    """How much of the walk is left out, so that the clip begins in motion [s]."""
    habits: float = 0.0
    """A whole number that names the small motions of who rests (`body.liveliness`); the negative one is the same in a
    mirror."""


@dataclass(frozen=True)
class LoungeStyle(SitStyle):
    """Of who gets comfortable once the seat bears: the feet come out, one after the other, as far as the thighs
    clear the seat's edge.
    """

    left_foot: float = 0.0
    """How far the left foot goes forward [m], at most."""
    right_foot: float = 0.0
    """And the right one."""
    apart: float = 0.0
    """How much farther apart they come [m]."""
    hands_back: float = 0.0
    """How much nearer to the hips than to the knees hands rest on the thighs, as a share of the thigh."""


def sit_down(
    clip_id: str,
    task: str,
    body: Body,
    obj: SceneObject,
    start_xy: np.ndarray,
    start_yaw: float,
    style: SitStyle,
    gait: Gait,
    clear: bool = False,
) -> HumanMotion:
    """The clip that follows from a start, a seat and a style, in closed form. Raises BadObject if there is no seat.

    The point between the ankles starts at `start_xy` (2,) [m] with heading `start_yaw` [rad]. A support that is out of
    reach is not
    used, and the style that is stored with the clip says so. Hands that keep `clear` never are in the thighs.
    """
    course = sit_course(task, body, obj, style, gait, clear)
    way = walk(
        body, course.route(start_xy), start_yaw, course.stop_xy, 0.0, gait, course.after, style.duration, style.lead
    )
    return course.act(clip_id, way)


def sit_course(task: str, body: Body, obj: SceneObject, style: SitStyle, gait: Gait, clear: bool = False) -> Course:
    """Where to stand before a seat, and how to sit down from there, perhaps with hands `clear` of the thighs.

    Raises BadObject if there is no seat.
    """
    middle = float(obj.seat_polygon[:, 1].min() + obj.seat_polygon[:, 1].max()) / 2 if len(obj.seat_polygon) else 0.0
    place = place_at(obj, body, middle + style.seat_y, style.seat_x)
    leaning = lean_against(obj, body, place, style.lean_back, 0.05 + SLUMP) if style.against > 0 else None
    after = PAUSE + style.sit_duration + (0.5 + LEAN_BACK if leaning else 1.5)

    supports: list[
        Supports
    ] = []  # every walk ends in the same pose: the places for the hands that the first finds are good for all

    def act(clip_id: str, way: Walk) -> HumanMotion:
        return _sit(clip_id, task, body, obj, place, leaning, style, way, supports, clear)

    return Course(body, gait, place.ankles, 0.0, lambda start_xy: route_to(obj, start_xy, place), after, act)


def _sit(
    clip_id: str,
    task: str,
    body: Body,
    obj: SceneObject,
    place: Place,
    leaning: Leaning | None,
    style: SitStyle,
    way: Walk,
    supports: list[Supports],
    clear: bool,
) -> HumanMotion:
    """The clip that follows from a walk to in front of a place; finds `supports` unless they are known."""
    clock = way.time - way.end - PAUSE
    trunk = _trunk(way, clock, place, leaning, style)
    legs, stands = _legs(body, obj, way, clock, place, leaning, style)
    if not supports:
        supports.append(_supports(obj, body, trunk, replace(style, against=1.0 if leaning else -1.0)))
    hands, style = supports[0]
    arms, bears = _arms(body, way, trunk, legs, clock, hands, style)
    if clear:
        arms = keep_off(body, trunk, legs, arms, np.array([float(hand is None) for hand in hands]))
    quat = pose(body, trunk, legs, arms)
    if clear:
        quat = lay_on_body(body, trunk, quat)
    _lay_hands(body, quat, trunk, arms, hands, bears)
    at_rest = max(UPRIGHT * style.sit_duration, style.sit_duration + 0.3 + LEAN_BACK if leaning else 0.0)
    rest = Rest(clock - at_rest + 0.5, (1.0, 1.0), 0.25 if leaning else 1.0, 1.0, None)
    root, quat = enliven(body, trunk.pelvis_pos_w, quat, rest, style.habits)
    seated = clock >= 0.9 * style.sit_duration
    rests = clock >= style.sit_duration + 0.3 + 0.85 * LEAN_BACK
    at = _wrists(body, trunk, arms)
    touching = [
        np.zeros_like(seated) if hand is None else np.linalg.norm(at[:, side] - hand, axis=-1) < NEAR
        for side, hand in enumerate(hands)
    ]
    contacts = np.stack([*stands.T, seated, rests & (leaning is not None), *touching], -1)
    return HumanMotion(
        clip_id,
        task,
        body.skeleton,
        FPS,
        root,
        quat,
        obj.id,
        CONTACTS,
        contacts,
        {**{name: float(value) for name, value in vars(style).items()}, "turn": last_turn(way.steps)},
    )


def route_to(obj: SceneObject, start_xy: np.ndarray, place: Place) -> Route:
    """The way around the object to in front of a place."""
    low, high = obj.bounds()
    margin = 0.40
    before = np.array([max(place.ankles[0] + 0.25, high[0] + margin), place.ankles[1]])
    return around_box(start_xy, before, low[:2], high[:2], margin)


def _trunk(way: Walk, clock: np.ndarray, place: Place, leaning: Leaning | None, style: SitStyle) -> Trunk:
    """Pelvis, chest and head; clock (T,) [s] is 0 at the first bend."""
    progress = clock / style.sit_duration
    # the hips go back a little before they go down
    back, down = minimum_jerk(progress / 0.95), minimum_jerk((progress - 0.06) / 0.94)
    standing = way.pelvis_pos_w[-1]
    goal = place.pelvis + [0.0, 0.0, style.drop]
    pelvis_pos = way.pelvis_pos_w + np.stack([back, back, down], -1) * (goal - standing)
    pelvis_pos[:, 2] -= style.drop * minimum_jerk((clock - 0.92 * style.sit_duration) / FALL + 1)
    lean, upright = minimum_jerk(progress / 0.7), minimum_jerk((progress - 0.86) / 0.75)
    pitch = 0.03 + (style.lean - 0.03) * lean - (style.lean + style.recline) * upright
    spine, nod = 0.02 + 0.10 * lean - 0.07 * upright, 0.12 - 0.30 * lean + 0.22 * upright
    if leaning is not None:
        share = (clock - style.sit_duration - 0.2) / SLIDE
        # the weight is taken off the seat a little while sliding
        pelvis_pos += minimum_jerk(share)[:, None] * (leaning.pelvis - place.pelvis)
        pelvis_pos[:, 2] += 0.012 * minimum_jerk(3 * share) * minimum_jerk(3 * (1 - share))
        leans = minimum_jerk((clock - style.sit_duration - 0.3) / LEAN_BACK)
        pitch = pitch - (leaning.pitch - style.recline) * leans
        spine, nod = spine + SLUMP * leans, nod + (0.75 * leaning.pitch - SLUMP) * leans
    pelvis = way.pelvis_quat(pitch)
    chest = rot.multiply(pelvis, way.chest_turn(spine))
    head = rot.multiply(chest, way.head_turn(nod))
    return Trunk(pelvis_pos, pelvis, chest, head)


def _legs(
    body: Body, obj: SceneObject, way: Walk, clock: np.ndarray, place: Place, leaning: Leaning | None, style: SitStyle
) -> tuple[Legs, np.ndarray]:
    """The legs, and (T, 2) where each foot stands."""
    legs, stands = way.legs(), way.feet.contact
    if not isinstance(style, LoungeStyle):
        return legs, stands
    ankle, stands = legs.ankle_pos_w.copy(), stands.copy()
    for side, (forward, begins) in enumerate(zip((style.left_foot, style.right_foot), FEET_COME_OUT, strict=True)):
        u = (clock / style.sit_duration - begins) / (FEET_COME_OUT[1] - FEET_COME_OUT[0])
        share = minimum_jerk(u)
        there = np.array([forward * feet_allowed(obj, body, place, leaning, forward), (0.5 - side) * style.apart, 0.0])
        ankle[:, side] += share[:, None] * there
        ankle[:, side, 2] += FOOT_LIFTS * 16 * share**2 * (1 - share) ** 2
        stands[:, side] &= (u <= 0) | (u >= 1)
    return replace(legs, ankle_pos_w=ankle), stands


def _supports(obj: SceneObject, body: Body, trunk: Trunk, style: SitStyle) -> Supports:
    """Where the wrists of both hands rest on the object [m], None for a hand that stays on the thigh.

    And the style as it can be done.
    """
    pelvis = trunk.pelvis_pos_w[-1]
    hands: tuple[np.ndarray | None, ...] = (None, None)
    if style.on_arms > 0:
        at = shoulders(body, _last(trunk))[0]
        hands = tuple(armrest(obj, body, pelvis, at[side], side) for side in (0, 1))
    elif style.on_seat > 0:
        hands = tuple(beside_thigh(obj, body, pelvis, side) for side in (0, 1))
    if all(hand is None for hand in hands):
        style = replace(style, on_arms=-1.0, on_seat=-1.0)
    return hands, style


def _arms(
    body: Body,
    way: Walk,
    trunk: Trunk,
    legs: Legs,
    clock: np.ndarray,
    hands: tuple[np.ndarray | None, ...],
    style: SitStyle,
) -> tuple[Arms, np.ndarray]:
    """Arms that swing while walking, come forward on the way down, and end on thighs, seat or its arms.

    And how much (T, 2) they bear on the object.
    """
    progress = clock / style.sit_duration
    forward = minimum_jerk(progress / 0.65)
    swinging = way.arms(body, style.arm_swing)
    moving = Arms(
        rot.multiply(about_y(-1.15 * forward)[:, None], swinging.upper),
        rot.multiply(swinging.elbow, about_y(-0.25 * forward)[:, None]),
    )
    free = _wrists(body, trunk, moving)
    goals = _on_thighs(body, trunk, legs, 0.69 - style.hands_back if isinstance(style, LoungeStyle) else 0.69)
    side_w = rot.rotate(trunk.chest_quat_w[:, None], np.array([[0.30, 1.0, 0.0], [-0.30, 1.0, 0.0]]))
    share = np.stack([minimum_jerk(progress / 0.55 if style.on_thighs > 0 else (progress - 0.70) / 0.85)] * 2, -1)
    turned = share.copy()
    for side, hand in enumerate(hands):
        if hand is not None:  # through the air on an arc, whatever the shoulders do meanwhile
            arrives = (progress - 0.30) / (0.70 if style.on_arms > 0 else 0.80)
            share[:, side], turned[:, side] = minimum_jerk(arrives), minimum_jerk(arrives / 0.5)
            goals[:, side] = free[:, side] + share[:, side, None] * (hand - free[:, side])
            goals[:, side, 2] += 0.10 * minimum_jerk(2 * arrives) * minimum_jerk(2 * (1 - arrives))
            # elbows stay behind and beside the hands, also while the chest is over them
            side_w[:, side] = rot.rotate(
                rot.from_yaw(way.yaw), np.array([(1 - 2 * side) * (0.5 if style.on_arms > 0 else 0.2), 1.0, 0.0])
            )
    if style.on_thighs < 0 and all(hand is None for hand in hands):  # free hands come to where the thighs will be
        frames = np.maximum(np.arange(len(clock)), np.argmax(clock >= UPRIGHT * style.sit_duration))
        trunk, goals = Trunk(*(values[frames] for values in vars(trunk).values())), goals[frames]
    reached = reach(body, trunk, _within_reach(body, trunk, goals), side_w)
    return blend(moving, reached, turned), share * [hand is not None for hand in hands]


def _wrists(body: Body, trunk: Trunk, arms: Arms) -> np.ndarray:
    """(T, 2, 3) where the wrists of these arms are [m]."""
    upper = rot.multiply(trunk.chest_quat_w[:, None], arms.upper)
    lower = rot.multiply(upper, arms.elbow)
    over, under = body.length(body.arms[0])
    return (
        shoulders(body, trunk)
        + rot.rotate(upper, np.array([0.0, 0.0, -over]))
        + rot.rotate(lower, np.array([0.0, 0.0, -under]))
    )


def _within_reach(body: Body, trunk: Trunk, wrists: np.ndarray) -> np.ndarray:
    """Wrists (T, 2, 3) [m] drawn towards the shoulders where the arms would be nearly straight or longer, so gently
    that no elbow snaps straight.
    """
    at, whole = shoulders(body, trunk), sum(body.length(body.arms[0]))
    away = wrists - at
    length = np.linalg.norm(away, axis=-1, keepdims=True) / whole
    drawn = np.where(length > 0.92, 0.92 + 0.07 * np.tanh((length - 0.92) / 0.07), length)
    return at + away * drawn / length


def _on_thighs(body: Body, trunk: Trunk, legs: Legs, farthest: float) -> np.ndarray:
    """(T, 2, 3) wrists of hands that lie on the thighs [m], as far towards the knees, up to a share of the thigh, as
    the arms reach in the end.
    """
    thigh = thigh_orientations(body, trunk, legs)
    hips = trunk.pelvis_pos_w[:, None] + rot.rotate(
        trunk.pelvis_quat_w[:, None], body.skeleton.offsets[[leg.root for leg in body.legs]]
    )
    above = np.array([[0.09, 0.03, 0.0], [0.09, -0.03, 0.0]]) * body.size
    along = np.array([0.0, 0.0, -body.length(body.legs[0])[0]])
    last = shoulders(body, _last(trunk))[0]
    shares = np.arange(farthest, 0.2, -0.04)
    places = hips[-1] + rot.rotate(thigh[-1], above + shares[:, None, None] * along)  # (S, 2, 3)
    near = (np.linalg.norm(places - last, axis=-1) < 0.98 * sum(body.length(body.arms[0]))).all(-1)
    share = shares[np.argmax(near)] if near.any() else shares[-1]
    return hips + rot.rotate(thigh, above + share * along)


def _lay_hands(
    body: Body, quat: np.ndarray, trunk: Trunk, arms: Arms, hands: tuple[np.ndarray | None, ...], bears: np.ndarray
) -> None:
    """Turn the hands of local rotations (T, J, 4) flat, fingers forward, as far as `bears` (T, 2) says that they
    bear on something.
    """
    for side, hand in enumerate(hands):
        if hand is not None:
            forearm = rot.multiply(rot.multiply(trunk.chest_quat_w, arms.upper[:, side]), arms.elbow[:, side])
            flat = rot.multiply(rot.conjugate(forearm), about_y(np.array(-1.35)))
            quat[:, body.arms[side].end] = rot.slerp(np.broadcast_to(rot.IDENTITY, flat.shape), flat, bears[:, side])


def _last(trunk: Trunk) -> Trunk:
    """The trunk's last frame."""
    return Trunk(*(values[-1:] for values in vars(trunk).values()))
