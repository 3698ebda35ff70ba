"""`lift-box`: come a few steps up to a box, bend, clasp it by its left and right side, stand up with it, and hold it
against the body.

These boxes reach to the hip. Nobody gets the hands under one and then sees over it, so they are clasped: light ones
above the middle of their sides, heavy ones lower, with straighter arms and more in the knees. It ends where people
carry boxes: wrists at the height of the pelvis, elbows bent by 55 degrees, the front on the belly.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.motion import HumanMotion
from mimicbench.core.seeds import rng
from mimicbench.objects.shape import SceneObject
from mimicbench.references.actions.postures import Ground, Manner, Posture, depth, elbow_axes, find_posture, placed
from mimicbench.references.actions.reaching import (
    SIZES,
    STRIDES,
    Grasp,
    cut,
    draw_approach,
    lay_hands,
    reach_past,
    settle,
    steps_up_to,
    strained,
)
from mimicbench.references.body.body import Body, core4d_body
from mimicbench.references.body.limbs import about_y
from mimicbench.references.body.posing import blend, pose, reach
from mimicbench.references.curves import minimum_jerk
from mimicbench.references.locomotion.course import Course
from mimicbench.references.locomotion.route import Route
from mimicbench.references.locomotion.walking import FPS, Walk, follow
from mimicbench.references.synthesis.manner import manner
from mimicbench.references.synthesis.synthesis import Synthesis

SIDES = np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
"""(2, 3) out of the box, where the left and the right hand clasp it."""
HANDS_OFF = 0.024
"""[m] between a side of the box and a wrist that clasps it: palms give by the rest."""
FARTHEST_FORWARD = 0.14
"""[m] in front of the middle; a box that is held farther from its middle would swing."""
HOLD = 0.35
"""[s] for which the box is held in the end, at least."""
HEAVY = (1.0, 4.0)
"""[kg] of boxes that count as light and as heavy."""
LOWEST_CLASP = 0.52
"""[m] Nobody bends lower to clasp a box that is higher, at body size 1."""
LIFTS = (0.32, 0.50)
"""[m] how high a box is lifted, at least and at most."""
PULLS = (0.0, 0.18)
"""[m] how far it is drawn to the body meanwhile."""
FINE = 0.006
"""[m] by which a posture may fall short."""
PRESSED = 0.003
"""[m] that the belly gives where the box is held against it."""
AROUND = 0.3
"""[rad] that the elbows swing out farther on the way up."""
FRONT = ("pelvis", "trunk", "thigh", "shin")
"""What a box may be held against."""
WEIGHT = 60.0
"""[kg] of a person of size 1, whose balance the box shifts."""


@dataclass(frozen=True)
class LiftStyle:
    """What a clip chooses beyond its start and its box; stored with it."""

    body_scale: float
    """Size of the body; 1 is 1.80 m tall."""
    walking: float
    """The clip begins so long before the last foot lands [s]."""
    overlap: float
    """The hands leave so long before the last foot has landed [s]."""
    reach_duration: float
    """From there until both hands clasp the box [s]."""
    lift_duration: float
    """From when it leaves the floor until it is up [s]."""
    duration: float
    """Of the whole clip [s]."""
    clasp_height: float
    """Where the hands clasp the box, as a share of its height, beyond what its weight calls for."""
    clasp_forward: float
    """And how far in front of its middle [m]."""
    brace: float
    """The hands press so long before the box leaves the floor [s]."""
    hold_height: float
    """Where the wrists are in the end, as a share of the height of the pelvis in standing, beyond what the weight
    calls for."""
    uneven: float
    """How much higher the left hand clasps it than the right one [m]."""
    tip: float
    """How far its upper side leans towards the body in the end [rad]."""
    squat: float
    """How far the hips sink with a lean [m/rad], beyond what the weight calls for."""
    sway: float
    """Phase of the small motions of who stands [rad]."""
    arm_swing: float
    """Swing of the arms, as a share of the usual."""


class Lifting(NamedTuple):
    """How a box is lifted, and by whom."""

    clasp: np.ndarray
    """(2, 3) where the wrists clasp it [m]."""
    carried: np.ndarray
    """(3,) how far it is carried [m]."""
    body: Body
    ground: Ground
    grip: Posture
    """As the hands clasp it."""
    stand: Posture
    """As it is up."""


def draw_style(random: np.random.Generator) -> LiftStyle:
    """The few free choices of a clip. The walk is short enough for the box to be held for HOLD seconds."""
    duration = 4.3 + float(np.clip(0.2 * random.standard_normal(), -0.4, 0.4))
    reach_duration, lift_duration = random.uniform(0.95, 1.15), random.uniform(1.1, 1.35)
    overlap, brace = random.uniform(0.15, 0.35), random.uniform(0.08, 0.25)
    walking = min(random.uniform(0.9, 1.4), duration - reach_duration - lift_duration - HOLD - brace + overlap)
    return LiftStyle(
        random.uniform(*SIZES),
        walking,
        overlap,
        reach_duration,
        lift_duration,
        duration,
        clasp_height=random.uniform(-0.05, 0.05),
        clasp_forward=random.uniform(0.06, 0.12),
        brace=brace,
        hold_height=random.uniform(-0.03, 0.04),
        uneven=random.uniform(-0.03, 0.03),
        tip=random.uniform(0.0, 0.05),
        squat=random.uniform(-0.05, 0.10),
        sway=random.uniform(0.0, 2 * np.pi),
        arm_swing=random.uniform(0.5, 0.9),
    )


def synthesize_lift_box(clip_id: str, obj: SceneObject, seed: int, alike: bool = False) -> HumanMotion:
    """One clip."""
    random = rng(seed, clip_id, obj.id)
    style = draw_style(manner(random, alike))
    start_xy, start_yaw = draw_approach(random, np.array([stand_off(obj, style.body_scale), 0.0]), np.pi)
    return make_lift_box(clip_id, obj, start_xy, start_yaw, style)


def stand_off(obj: SceneObject, scale: float) -> float:
    """Where along x somebody of that size stands before the box [m]: close, with room for the toes."""
    return float(obj.bounds()[1][0]) + core4d_body(scale).toe + 0.035


def make_lift_box(
    clip_id: str, obj: SceneObject, start_xy: np.ndarray, start_yaw: float, style: LiftStyle
) -> HumanMotion:
    """The clip that follows from a start, a box and a style, in closed form.

    The point between the ankles comes from `start_xy` (2,) [m] with heading `start_yaw` [rad].
    """
    course = lift_course(obj, style)
    steps = steps_up_to(start_xy, start_yaw, course.stop_xy, course.stop_yaw, STRIDES, course.body.size)
    skipped = max(0, round((steps.end - style.walking) * FPS))
    way = follow(course.body, steps, STRIDES, 0.5, skipped / FPS + style.duration)
    return cut(course.act(clip_id, way), skipped, skipped + round(style.duration * FPS) + 1)


def lift_course(obj: SceneObject, style: LiftStyle) -> Course:
    """Where to stand before a box, and how to lift it from there."""
    found = _who_lifts(obj, style)
    body, ground = found.body, found.ground

    detour: list[int] = []  # found once, good for all

    def act(clip_id: str, way: Walk) -> HumanMotion:
        return _lift(clip_id, obj, style, found, way, detour)

    after = style.reach_duration - style.overlap + style.brace + style.lift_duration + HOLD
    return Course(
        body,
        STRIDES,
        ground.middle,
        ground.yaw,
        lambda start_xy: Route(np.stack([start_xy, ground.middle])),
        after,
        act,
    )


def _lift(
    clip_id: str, obj: SceneObject, style: LiftStyle, found: Lifting, way: Walk, detour: list[int]
) -> HumanMotion:
    """The clip that follows from a walk up to the box."""
    clasp, carried, body, _, grip, stand = found
    progress = (way.time - way.end + style.overlap) / style.reach_duration
    lifting = (way.time - way.end + style.overlap - style.reach_duration - style.brace) / style.lift_duration
    # straight up first, past the knees, and then to the belly
    up, near = minimum_jerk(lifting), minimum_jerk((lifting - 0.2) / 0.8)
    box_quat = about_y(style.tip * near)
    # it turns about the line between the hands
    axis = clasp.mean(0)
    box_pos = axis + np.stack([near, near, up], -1) * carried - rot.rotate(box_quat, axis)
    # the eyes leave the box when it is up
    look = axis + [0.0, 0.0, 0.15] + np.stack([up, up, up], -1) * (carried + [-0.8, 0.0, 0.45] * near[:, None])
    trunk = settle(way, body.size, [(grip, minimum_jerk(progress / 0.92)), (stand, up)], look, style.sway)
    trunk = strained(trunk, way.time, style.sway, minimum_jerk((progress - 1.0) / 0.3))
    grasp = Grasp(clasp, SIDES, float(grip.elbow))
    reaching = reach_past(body, obj, trunk, way.legs(), way.arms(body, style.arm_swing), grasp, progress, detour)
    hands = box_pos[:, None] + rot.rotate(box_quat[:, None], clasp)
    # the elbows go round the upper edges
    elbows = grip.elbow + up * (stand.elbow - grip.elbow) + 4.0 * AROUND * up * (1.0 - up)
    holding = reach(body, trunk, hands, elbow_axes(trunk.chest_quat_w, elbows))
    arms = blend(reaching, holding, (progress >= 1.0).astype(float))
    quat = lay_hands(body, pose(body, trunk, way.legs(), arms), trunk, SIDES, minimum_jerk(progress / 0.95))
    contacts = np.concatenate([way.feet.contact, np.repeat((progress >= 0.97)[:, None], 2, 1)], -1)
    return HumanMotion(
        clip_id,
        "lift-box",
        body.skeleton,
        FPS,
        trunk.pelvis_pos_w,
        quat,
        obj.id,
        ("left_foot", "right_foot", "left_hand", "right_hand"),
        contacts,
        {
            **{name: float(value) for name, value in vars(style).items()},
            "body_scale": body.size,
            "clasp_forward": float(clasp[0, 0]),
        },
        object_pos_w=box_pos,
        object_quat_w=box_quat,
    )


def _who_lifts(obj: SceneObject, style: LiftStyle) -> Lifting:
    """Who is too small for the box clasps it farther in front or higher, or grows."""
    best, least = None, np.inf
    for scale in (style.body_scale, *(larger for larger in (0.95, SIZES[1]) if larger > style.body_scale)):
        body = core4d_body(scale)
        ground = Ground.at(body, np.array([stand_off(obj, scale), 0.0]), np.pi, STRIDES)
        for forward, higher in ((0.0, 0.0), (FARTHEST_FORWARD - style.clasp_forward, 0.1)):
            clasp = _clasp(obj, style, scale) + [forward, 0.0, higher]
            grip, short, _ = find_posture(body, ground, clasp, obj, np.zeros(3), _manner(obj, style, body, 0.0))
            if short > max(least, FINE):
                continue
            carried, stand, later = _stand(obj, style, body, ground, clasp)
            if best is None or max(short, later) < least - 1e-9:
                best, least = Lifting(clasp, carried, body, ground, grip, stand), max(short, later)
            if least < FINE:
                return best
    assert best is not None
    return best


def _weight(obj: SceneObject) -> float:
    """0 for a light box, 1 for a heavy one."""
    return float(np.clip(((obj.mass or 0.0) - HEAVY[0]) / (HEAVY[1] - HEAVY[0]), 0.0, 1.0))


def _clasp(obj: SceneObject, style: LiftStyle, scale: float) -> np.ndarray:
    """(2, 3) where wrists clasp a box [m]: the lower the heavier it is."""
    low, high = obj.bounds()
    height = max((0.78 - 0.10 * _weight(obj) + style.clasp_height) * float(high[2]), LOWEST_CLASP * scale)
    height = min(height, 0.88 * float(high[2]))
    x, uneven = style.clasp_forward, 0.5 * style.uneven
    return np.array([[x, low[1] - HANDS_OFF, height + uneven], [x, high[1] + HANDS_OFF, height - uneven]])


def _manner(obj: SceneObject, style: LiftStyle, body: Body, load: float) -> Manner:
    """Heavy boxes are lifted out of the knees."""
    return Manner(
        load * float(obj.mass or 0.0) / (WEIGHT * body.size**3), squat=0.20 + 0.12 * _weight(obj) + style.squat
    )


def _stand(
    obj: SceneObject, style: LiftStyle, body: Body, ground: Ground, clasp: np.ndarray
) -> tuple[np.ndarray, Posture, float]:
    """How far a box is carried (3,) [m], the posture in which it is held, and how far that falls short [m]."""
    up = (1.0 - 0.05 * _weight(obj) + style.hold_height) * body.standing_height - float(clasp[:, 2].mean())
    pull, manner = 0.11, _manner(obj, style, body, 1.0)
    for last in (False, True):
        carried = np.array([pull, 0.0, float(np.clip(up, *LIFTS))])
        stand, short, _ = find_posture(body, ground, clasp + carried, obj, carried, manner)
        if not last:  # to where the belly is
            pos, quat = placed(body, ground, stand[None], clasp + carried)
            pull = float(np.clip(pull + PRESSED - depth(body, pos, quat, obj, carried, FRONT)[0], *PULLS))
    return carried, stand, short


SYNTHESIS = Synthesis(
    "lift-box", synthesize_lift_box, LiftStyle, lambda obj, style, _: (lift_course(obj, style),), alike=True
)
