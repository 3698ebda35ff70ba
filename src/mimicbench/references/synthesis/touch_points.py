"""`touch-points`: come a few steps up to a household object, bend or squat, and hold both wrists at their places on
it.
"""

from dataclasses import dataclass, replace

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.motion import HumanMotion
from mimicbench.core.seeds import rng
from mimicbench.objects.shape import SceneObject
from mimicbench.objects.touch import stance_before, touch_pair
from mimicbench.references.actions.postures import Ground, Manner, Posture, chest_turn, find_posture
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
)
from mimicbench.references.body.body import Body, core4d_body
from mimicbench.references.body.hands import keep_off
from mimicbench.references.body.limbs import about_y, glide
from mimicbench.references.body.posing import pose
from mimicbench.references.curves import minimum_jerk
from mimicbench.references.locomotion.course import Course
from mimicbench.references.locomotion.route import Route
from mimicbench.references.locomotion.walking import FPS, Walk, follow
from mimicbench.references.synthesis.manner import manner
from mimicbench.references.synthesis.synthesis import Synthesis

STANCES = (-0.12, -0.04, 0.04)
"""How much nearer to the object than usual to stand [m]: the easiest is taken."""
ROUNDED = (0.0, 0.35)
"""[rad] how far the back is rounded beyond what goes with a lean; more only where the hands do not arrive otherwise."""
FINE = 1e-3
"""[m] by which a posture may fall short."""
HELD = 1.2
"""[s] for which the hands stay, at least."""
BENDS = 1.80
"""[rad/s] how fast the trunk bends, at most, where there is time."""
ARRIVES = 0.95
"""Share of the reach in which the trunk gets there."""
RAMPS = 0.36
"""Shares of the bend in which it gathers speed and loses it."""


@dataclass(frozen=True)
class TouchStyle:
    """What a clip chooses beyond its start, its object and its targets; stored with it."""

    body_scale: float
    """Size of the body; 1 is 1.80 m tall."""
    walking: float
    """The clip begins so long before the last foot lands [s]."""
    overlap: float
    """The hands leave so long before the last foot has landed [s]."""
    reach_duration: float
    """From there until both hands have arrived [s]."""
    duration: float
    """Of the whole clip [s]."""
    sway: float
    """Phase of the small motions of who stands [rad]."""
    arm_swing: float
    """Swing of the arms, as a share of the usual."""


def draw_style(random: np.random.Generator) -> TouchStyle:
    """The few free choices of a clip. The walk is short enough for the hands to be at rest for HELD seconds."""
    duration, reach_duration = (
        3.3 + float(np.clip(0.2 * random.standard_normal(), -0.4, 0.4)),
        random.uniform(0.9, 1.05),
    )
    overlap = random.uniform(0.15, 0.3)
    walking = min(random.uniform(0.8, 1.25), duration - reach_duration + overlap - HELD)
    return TouchStyle(
        random.uniform(*SIZES),
        walking,
        overlap,
        reach_duration,
        duration,
        random.uniform(0.0, 2 * np.pi),
        random.uniform(0.5, 0.9),
    )


def synthesize_touch_points(clip_id: str, obj: SceneObject, seed: int, alike: bool = False) -> HumanMotion:
    """One clip. Raises BadObject if the object has no pair of touch points."""
    random = rng(seed, clip_id, obj.id)
    goal = np.stack(touch_pair(obj, random))
    *place, yaw = stance_before(obj, goal[0], goal[1])
    start_xy, start_yaw = draw_approach(random, np.array(place), float(yaw))
    return make_touch_points(clip_id, obj, goal, start_xy, start_yaw, draw_style(manner(random, alike)))


def make_touch_points(
    clip_id: str, obj: SceneObject, goal: np.ndarray, start_xy: np.ndarray, start_yaw: float, style: TouchStyle
) -> HumanMotion:
    """The clip that follows from the wrists' places (2, 3) [m], a start and a style, in closed form.

    The point between the ankles comes from `start_xy` (2,) [m] with heading `start_yaw` [rad]. Who is too small for the
    object grows.
    """
    found = _who_reaches(obj, goal, style.body_scale)
    style = unhurried(style, found[2])
    course = _course(obj, goal, style, *found)
    steps = steps_up_to(start_xy, start_yaw, course.stop_xy, course.stop_yaw, STRIDES, course.body.size)
    skipped = max(0, round((steps.end - style.walking) * FPS))
    way = follow(course.body, steps, STRIDES, 0.5, skipped / FPS + style.duration)
    return cut(course.act(clip_id, way), skipped, skipped + round(style.duration * FPS) + 1)


def touch_course(obj: SceneObject, goal: np.ndarray, style: TouchStyle) -> Course:
    """Where to stand before the wrists' places (2, 3) [m], and how to reach for them from there."""
    body, ground, posture = _who_reaches(obj, goal, style.body_scale)
    return _course(obj, goal, unhurried(style, posture), body, ground, posture)


def unhurried(style: TouchStyle, posture: Posture) -> TouchStyle:
    """Who bends far takes longer for it, and begins while the feet still go."""
    far = float(
        rot.angle_between(
            rot.IDENTITY, rot.multiply(about_y(posture.pitch), chest_turn(posture.pitch, posture.twist, posture.bend))
        )
    )
    reach_duration = max(style.reach_duration, far / (BENDS * (1.0 - RAMPS) * ARRIVES))
    overlap = max(style.overlap, 0.55 * (reach_duration - 0.75))
    walking = max(min(style.walking, style.duration - reach_duration + overlap - HELD), 0.3)
    overlap = min(overlap, walking)
    return replace(
        style,
        reach_duration=min(reach_duration, style.duration - HELD - walking + overlap),
        walking=walking,
        overlap=overlap,
    )


def _course(
    obj: SceneObject, goal: np.ndarray, style: TouchStyle, body: Body, ground: Ground, posture: Posture
) -> Course:
    detour: list[int] = []  # found once, good for all

    def act(clip_id: str, way: Walk) -> HumanMotion:
        return _touch(clip_id, obj, goal, style, body, posture, way, detour)

    return Course(
        body,
        STRIDES,
        ground.middle,
        ground.yaw,
        lambda start_xy: Route(np.stack([start_xy, ground.middle])),
        style.reach_duration - style.overlap + HELD,
        act,
    )


def _touch(
    clip_id: str,
    obj: SceneObject,
    goal: np.ndarray,
    style: TouchStyle,
    body: Body,
    posture: Posture,
    way: Walk,
    detour: list[int],
) -> HumanMotion:
    """The clip that follows from a walk up to the object."""
    progress = (way.time - way.end + style.overlap) / style.reach_duration
    share = glide(progress / ARRIVES, RAMPS, RAMPS)
    trunk = settle(way, body.size, [(posture, share)], np.broadcast_to(goal.mean(0), (len(share), 3)), style.sway)
    swinging = way.arms(body, style.arm_swing)
    normals = obj.touch_normals[[int(np.argmin(((obj.touch_points - wrist) ** 2).sum(-1))) for wrist in goal]]
    grasp = Grasp(goal, normals, float(posture.elbow))
    arms = reach_past(body, obj, trunk, way.legs(), swinging, grasp, progress, detour)
    # on the way the hands go round the own knees
    arms = keep_off(body, trunk, way.legs(), arms, (1.0 - minimum_jerk((progress - 0.7) / 0.25))[:, None])
    quat = lay_hands(body, pose(body, trunk, way.legs(), arms), trunk, normals, minimum_jerk(progress / 0.95))
    contacts = np.concatenate([way.feet.contact, np.repeat((progress >= 0.97)[:, None], 2, 1)], -1)
    return HumanMotion(
        clip_id,
        "touch-points",
        body.skeleton,
        FPS,
        trunk.pelvis_pos_w,
        quat,
        obj.id,
        ("left_foot", "right_foot", "left_hand", "right_hand"),
        contacts,
        {**{name: float(value) for name, value in vars(style).items()}, "body_scale": body.size},
        wrist_goal_w=goal,
    )


def _who_reaches(obj: SceneObject, goal: np.ndarray, size: float) -> tuple[Body, Ground, Posture]:
    """The body of that size, or of a larger one where it cannot reach, on its feet, and how it stands there to
    touch.
    """
    x, y, yaw = stance_before(obj, goal[0], goal[1])
    best, least, reached = None, np.inf, False
    for scale in (size, *(larger for larger in (0.95, SIZES[1]) if larger > size)):
        body = core4d_body(scale)
        for bend in ROUNDED:
            for nearer in STANCES:
                ground = Ground.at(body, np.array([x - nearer, y]), float(yaw), STRIDES)
                posture, short, effort = find_posture(body, ground, goal, obj, np.zeros(3), Manner(bend=bend))
                if effort + 100.0 * short < least:
                    best, least, reached = (body, ground, posture), effort + 100.0 * short, short < FINE
            if reached:
                break
        if reached:
            break
    assert best is not None
    return best


SYNTHESIS = Synthesis(
    "touch-points",
    synthesize_touch_points,
    TouchStyle,
    lambda obj, style, goal: (touch_course(obj, goal, style),),
    wrist_goals=True,
    alike=True,
)
