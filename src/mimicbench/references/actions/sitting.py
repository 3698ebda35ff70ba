"""Sitting down: what a person who stands in front of a seat does from there on, in any of several styles.

The trunk leans forward while the hips go back and sink, slowly first; hands look for a support; the trunk comes up as
the seat bears. Then the pelvis may slide back, the trunk lean against the back, the feet come out, hands go where
they rest; and the person goes on breathing, looking around and shifting.
"""

from dataclasses import dataclass, replace

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.motion import HumanMotion
from mimicbench.objects.shape import SceneObject
from mimicbench.references.actions.seats import Place, Seated, foot_allowed, lean_against, place_at, sit_free
from mimicbench.references.actions.sit_styles import HANGS, THIGH, SitStyle
from mimicbench.references.actions.sitting_hands import (
    Hands,
    Supports,
    arms_depth,
    find_supports,
    lay_flat,
    move_hands,
    tamer,
)
from mimicbench.references.body.body import Body
from mimicbench.references.body.hands import keep_off, lay_on_body
from mimicbench.references.body.limbs import about_x, about_y
from mimicbench.references.body.liveliness import Rest, enliven, unrest
from mimicbench.references.body.posing import Legs, Trunk, pose, shoulders
from mimicbench.references.curves import minimum_jerk
from mimicbench.references.locomotion.course import Course
from mimicbench.references.locomotion.gait import Gait, last_turn
from mimicbench.references.locomotion.route import Route, around_box
from mimicbench.references.locomotion.walking import FPS, Excerpt, Walk, walk

CONTACTS = ("left_foot", "right_foot", "pelvis", "back", "left_hand", "right_hand")
BEARS = 0.84
"""When the seat bears, in durations of the way to it."""
FALL = 0.34
"""Time in which who drops falls the last centimeters [s]."""
SLIDES, SLIDE = 0.92, 1.0
"""When the pelvis begins to slide back, in durations of the way down, and how long it does [s]."""
LEANS, LEAN_BACK = 0.80, 1.8
"""The same of the trunk that goes on to the back of the seat."""
FEET_COME_OUT = (0.98, 1.24)
"""When the first and the second foot leave the floor, in durations of the way down."""
FOOT_GOES, FOOT_LIFTS = 0.70, 0.03
"""How long that takes [s], and how high they are lifted [m]."""
AT_REST = 1.12
"""When all that is left is to settle, in durations of the way down."""
TOUCHES = 0.015
"""Deepest that arms may be in the object on their way [m]: flesh gives."""
PITCHED = 0.5
"""Share of the trunk's lean that is the pelvis's; the spine bends for the rest."""
WOBBLE = np.array([0.008, 0.014, 0.012])
"""How far the head tilts, nods and turns without a reason until somebody rests [rad]."""
LOOKS, FARTHEST = 2.6, 1.0
"""So long before the last step somebody begins to look at the seat [s], over the shoulder by so much at most [rad]."""
HEAD = 0.65
"""Of that the head turns so much against the chest; the eyes do the rest."""


def sinking(progress: np.ndarray) -> np.ndarray:
    """Share of the way down (T,) at a share of its time: slow at first while the knees give way, then fast.

    Of real people 5 to 95 % of the way take two thirds of it.
    """
    return 0.13 * minimum_jerk(progress / 0.44) + 0.87 * minimum_jerk((progress - 0.23) / 0.77)


def leaning(progress: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far (T,) the trunk has leaned forward, and how far it has come up again: farthest half-way down."""
    return minimum_jerk((progress + 0.16) / 0.70), minimum_jerk((progress - 0.51) / 0.66)


@dataclass(frozen=True)
class _Seat:
    """What a course finds once: one body on one seat in one style."""

    body: Body
    obj: SceneObject
    place: Place
    seated: Seated
    style: SitStyle


def sit_down(
    clip_id: str,
    task: str,
    body: Body,
    obj: SceneObject,
    start_xy: np.ndarray,
    start_yaw: float,
    style: SitStyle,
    gait: Gait,
) -> HumanMotion:
    """The clip that follows from a start, a seat and a style, in closed form. Raises BadObject if there is no seat.

    The point between the ankles starts at `start_xy` (2,) [m] with heading `start_yaw` [rad]. A support that is out of
    reach is not used, and the style that is stored with the clip says so.
    """
    course = sit_course(task, body, obj, style, gait)
    excerpt = Excerpt(style.duration, style.lead)
    way = walk(body, course.route(start_xy), start_yaw, course.stop_xy, 0.0, gait, course.after, excerpt)
    return course.act(clip_id, way)


def sit_course(task: str, body: Body, obj: SceneObject, style: SitStyle, gait: Gait) -> Course:
    """Where to stand before a seat, and how to sit down from there. Raises BadObject if there is no seat."""
    middle = float(obj.seat_polygon[:, 1].min() + obj.seat_polygon[:, 1].max()) / 2 if len(obj.seat_polygon) else 0.0
    place = place_at(obj, body, middle + style.seat_y, style.seat_x)
    seated = lean_against(obj, body, place, style.lean_back, style.slump) if style.against > 0 else None
    style = replace(style, against=-1.0 if seated is None else 1.0)
    seat = _Seat(body, obj, place, seated or sit_free(obj, body, place, style.back, style.recline, style.slump), style)
    # every walk ends in the same pose: the places for the hands that the first finds are good for all
    supports: list[Supports] = []

    def act(clip_id: str, way: Walk) -> HumanMotion:
        return _sit(clip_id, task, seat, way, supports)

    return Course(body, gait, place.ankles, 0.0, lambda start_xy: route_to(obj, start_xy, place), settled(style), act)


def settled(style: SitStyle) -> float:
    """From the last touch-down until the person is at rest [s]."""
    leans = LEANS * style.sit_duration + LEAN_BACK if style.against > 0 else 0.0
    hands = style.sit_duration + max(style.left_late, style.right_late) + 0.8
    return style.pause + max(leans, hands, 1.2 * style.sit_duration)


def _sit(clip_id: str, task: str, seat: _Seat, way: Walk, supports: list[Supports]) -> HumanMotion:
    """The clip that follows from a walk to in front of a place; finds `supports` unless they are known."""
    body, style = seat.body, seat.style
    clock = way.time - way.end - style.pause
    trunk = _trunk(seat, way, clock)
    legs, stands = _legs(seat, way, clock, trunk)
    if supports:
        hands = move_hands(body, way, trunk, legs, clock, supports[0])
    else:
        found, hands = _free_supports(seat, way, trunk, legs, clock)
        supports.append(found)
    style = supports[0][1]
    arms = keep_off(body, trunk, legs, hands.arms, 1.0 - hands.bears)
    quat = lay_on_body(body, trunk, pose(body, trunk, legs, arms))
    lay_flat(body, quat, trunk, hands)
    root, quat = enliven(body, trunk.pelvis_pos_w, quat, _rest(seat, style, clock, quat), style.habits)
    bears = clock >= BEARS * style.sit_duration
    back = (clock >= LEANS * style.sit_duration + 0.85 * LEAN_BACK) & seat.seated.bears
    return HumanMotion(
        clip_id,
        task,
        body.skeleton,
        FPS,
        root,
        quat,
        seat.obj.id,
        CONTACTS,
        np.concatenate([stands, np.stack([bears, back], -1), hands.touches], -1),
        {**{name: float(value) for name, value in vars(style).items()}, "turn": last_turn(way.steps)},
    )


def _free_supports(seat: _Seat, way: Walk, trunk: Trunk, legs: Legs, clock: np.ndarray) -> tuple[Supports, Hands]:
    """Supports to which the arms get without going through the object, of a style as like the wanted one as may be, and
    how they get there.
    """
    best, least = None, np.inf
    acts = np.flatnonzero((clock > -0.2) & (clock < 1.2 * seat.style.sit_duration + 2.0))[::3]
    for style in tamer(seat.style):
        found = find_supports(seat.obj, seat.body, trunk, legs, style)
        hands = move_hands(seat.body, way, trunk, legs, clock, found)
        deep = arms_depth(seat.obj, seat.body, trunk, hands.arms, acts) if len(acts) else -np.inf
        if best is None or deep < least - 0.003:
            best, least = (found, hands), deep
        if deep < TOUCHES:
            break
    assert best is not None
    return best


def _rest(seat: _Seat, style: SitStyle, clock: np.ndarray, quat: np.ndarray) -> Rest:
    """What goes on at rest: hands on the thighs settle along them, others stay, those that hang go with the chest."""
    hips = [rot.multiply(quat[-1, 0], quat[-1, leg.root]) for leg in seat.body.legs]
    along = [0.05 * (style.rest(side) == THIGH) * rot.rotate(hips[side], np.array([0.0, 0.0, -1.0])) for side in (0, 1)]
    held = tuple(float(style.rest(side) != HANGS) for side in (0, 1))
    return Rest(
        clock - AT_REST * style.sit_duration,
        (held[0], held[1]),
        0.25 if seat.seated.bears else 0.8,
        1.0,
        np.stack(along),
    )


def route_to(obj: SceneObject, start_xy: np.ndarray, place: Place) -> Route:
    """The way around the object to in front of a place."""
    low, high = obj.bounds()
    margin = 0.40
    before = np.array([max(place.ankles[0] + 0.25, high[0] + margin), place.ankles[1]])
    return around_box(start_xy, before, low[:2], high[:2], margin)


def _trunk(seat: _Seat, way: Walk, clock: np.ndarray) -> Trunk:
    """Pelvis, chest and head; clock (T,) [s] is 0 where the hips begin to sink."""
    style, place, seated = seat.style, seat.place, seat.seated
    progress = clock / style.sit_duration
    # the hips go back a little before they go down
    back, down = minimum_jerk((progress + 0.10) / 1.08), sinking(progress)
    goal = place.pelvis + [0.0, 0.0, style.drop]
    pelvis_pos = way.pelvis_pos_w + np.stack([back, back, down], -1) * (goal - way.pelvis_pos_w[-1])
    pelvis_pos[:, 2] -= style.drop * minimum_jerk((clock - 0.92 * style.sit_duration) / FALL + 1)
    slides = (clock - SLIDES * style.sit_duration) / SLIDE
    pelvis_pos += minimum_jerk(slides)[:, None] * (seated.pelvis - place.pelvis)
    # the weight is taken off the seat a little while sliding
    moved = min(1.0, float(np.linalg.norm(seated.pelvis - place.pelvis)) / 0.05)
    pelvis_pos[:, 2] += 0.012 * moved * minimum_jerk(3 * slides) * minimum_jerk(3 * (1 - slides))
    lean, upright = leaning(progress)
    settles = minimum_jerk((clock - LEANS * style.sit_duration) / LEAN_BACK) if seated.bears else upright
    pelvis_lean = PITCHED * style.lean
    chest_lean = (style.lean - pelvis_lean) / _bent_share(seat.body)
    upright_pitch = -min(seated.pitch, 0.06) if seated.bears else -seated.pitch
    pitch = 0.03 + (pelvis_lean - 0.03) * lean + (upright_pitch - pelvis_lean) * upright
    pitch += (-seated.pitch - upright_pitch) * settles
    upright_bend = 0.5 * seated.bend if seated.bears else seated.bend
    spine = 0.02 + (chest_lean - 0.02) * lean + (upright_bend - chest_lean) * upright
    spine += (seated.bend - upright_bend) * settles
    level = 0.14 + 0.85 * (seated.pitch - seated.bend)
    nod = 0.12 + (style.nod - 0.12) * lean + (level - style.nod) * upright
    askew = style.askew * upright
    pelvis = rot.multiply(
        rot.from_yaw(askew), rot.multiply(way.pelvis_quat(pitch), about_x(0.3 * style.aside * upright))
    )
    aside = (lean - upright)[:, None] * np.array([style.tilt, 0.0, style.twist])
    aside[:, 0] += 0.7 * style.aside * upright
    busy = 1 - 0.85 * minimum_jerk((clock - AT_REST * style.sit_duration) / 1.2)[:, None]
    wobble = busy * unrest(style.habits, clock, WOBBLE)
    aside += 0.3 * wobble
    gaze, looks = _gaze(way, seat, clock)
    aside[:, 2] += 0.2 * gaze - (1.0 if seated.bears else 0.3) * askew  # both shoulders to the back
    chest = rot.multiply(pelvis, rot.multiply(rot.from_rotvec(aside), way.chest_turn(spine)))
    turn = HEAD * gaze - looks * way.look - 0.4 * askew
    head = rot.multiply(rot.from_rotvec(wobble), rot.multiply(rot.from_yaw(turn), way.head_turn(nod)))
    return Trunk(pelvis_pos, pelvis, chest, rot.multiply(chest, head))


def _bent_share(body: Body) -> float:
    """How far the line from pelvis to shoulders leans for every radian that the spine bends."""
    level, bent = np.tile(rot.IDENTITY, (2, 1)), np.stack([rot.IDENTITY, about_y(np.array(0.8))])
    away = shoulders(body, Trunk(np.zeros((2, 3)), level, bent, bent)).mean(1)
    lean = np.arctan2(away[:, 0], away[:, 2])
    return float(lean[1] - lean[0]) / 0.8


def _gaze(way: Walk, seat: _Seat, clock: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far (T,) the head turns to the seat [rad], over the shoulder in the end, and how much (T,) it does that."""
    target = np.array([seat.place.pelvis[0] - 0.05, seat.place.pelvis[1]]) - way.pelvis_pos_w[:, :2]
    away = rot.wrap_angle(np.arctan2(target[:, 1], target[:, 0]) - way.yaw)
    away = np.unwrap(away)
    looks = minimum_jerk((way.time - way.end + LOOKS) / 0.8) * (
        1 - minimum_jerk((clock / seat.style.sit_duration - 0.15) / 0.45)
    )
    looks *= seat.style.look
    begins = int(np.argmax(looks > 0.0))
    away -= 2 * np.pi * np.round(away[begins] / (2 * np.pi))
    return looks * FARTHEST * np.tanh(away / FARTHEST), looks


def _legs(seat: _Seat, way: Walk, clock: np.ndarray, trunk: Trunk) -> tuple[Legs, np.ndarray]:
    """The legs, and (T, 2) where each foot stands."""
    body = seat.body
    legs, style = way.legs(), seat.style
    open_ = minimum_jerk(clock / (0.6 * style.sit_duration))[:, None] * style.knees * np.array([1.0, -1.0])
    axis = rot.rotate(rot.from_yaw(open_), legs.knee_axis_w)
    ankle, stands, quat = legs.ankle_pos_w.copy(), way.feet.contact.copy(), legs.foot_quat_w.copy()
    for side, forward in enumerate((style.left_foot, style.right_foot)):
        sign = 1.0 - 2.0 * side
        begins = FEET_COME_OUT[0] if sign * style.first > 0 else FEET_COME_OUT[1]
        share = minimum_jerk((clock - begins * style.sit_duration) / FOOT_GOES)
        there = np.array([forward, 0.5 * sign * style.apart, 0.0])
        hip = trunk.pelvis_pos_w[-1] + rot.rotate(trunk.pelvis_quat_w[-1], body.skeleton.offsets[body.legs[side].root])
        there *= foot_allowed(seat.obj, body, hip, ankle[-1, side], there)
        if np.abs(there).max() < 0.01:
            continue
        ankle[:, side] += share[:, None] * there
        ankle[:, side, 2] += FOOT_LIFTS * 16 * share**2 * (1 - share) ** 2
        quat[:, side] = rot.multiply(rot.from_yaw(sign * 0.8 * max(style.apart, 0.0) * share), quat[:, side])
        stands[:, side] &= (share <= 0) | (share >= 1)
    return replace(legs, ankle_pos_w=ankle, foot_quat_w=quat, knee_axis_w=axis), stands
