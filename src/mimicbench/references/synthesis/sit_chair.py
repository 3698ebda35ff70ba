"""`sit-chair`: start anywhere around a chair, walk to its front, turn the back to it, sit down, stay."""

from dataclasses import replace

import numpy as np

from mimicbench.core.motion import HumanMotion
from mimicbench.core.seeds import rng
from mimicbench.objects.shape import SceneObject
from mimicbench.references.actions.sitting import SitStyle, sit_course, sit_down
from mimicbench.references.body.body import unihsi_body
from mimicbench.references.locomotion.course import Course
from mimicbench.references.locomotion.gait import Gait
from mimicbench.references.locomotion.walking import draw_start

VARIED = 0.4
"""Share of the clips that differ from the usual way to sit down by one thing."""


def draw_styles(random: np.random.Generator, seat_height: float) -> list[SitStyle]:
    """The few free choices of a clip, and more to fall back on.

    The shortest people stay away from the highest seats [m], where their feet would hang.

    Most sit down with free hands, which end on the thighs.
    """
    shortest = max(1.03, min(1.10, 2.1 * seat_height))
    usual = SitStyle(
        body_scale=random.uniform(shortest, 1.13),
        speed=random.uniform(0.57, 0.63),
        sit_duration=random.uniform(1.6, 1.9),
        lean=random.uniform(0.56, 0.66),
        recline=random.uniform(0.0, 0.12),
        seat_x=random.uniform(-0.02, 0.02),
        seat_y=random.uniform(-0.02, 0.02),
        arm_swing=random.uniform(0.7, 1.2),
        duration=14.8 + 0.5 * float(np.clip(random.standard_normal(), -2, 2)),
        habits=float(random.integers(1, 2**24)),
    )
    if random.uniform() >= VARIED:
        return [usual]
    variants = (
        {"on_thighs": 1.0},
        {"on_seat": 1.0},
        {"on_arms": 1.0},
        {"sit_duration": random.uniform(2.4, 3.0)},
        {"drop": random.uniform(0.04, 0.06)},
        {"against": 1.0, "lean_back": random.uniform(0.2, 0.3)},
    )
    return [replace(usual, **variants[i]) for i in random.permutation(len(variants))]


def synthesize_sit_chair(clip_id: str, obj: SceneObject, seed: int) -> HumanMotion:
    """One clip. Raises BadObject if there is no seat."""
    seat_height = obj.require_seat()
    random = rng(seed, clip_id, obj.id)
    start_xy, start_yaw = draw_start(random, obj)
    first, *others = draw_styles(random, seat_height)
    motion = make_sit_chair(clip_id, obj, start_xy, start_yaw, first)
    for style in others:
        # not every chair has arms, or a back in reach, but on any people may sit down slowly
        if _is_done(first, motion):
            break
        first, motion = style, make_sit_chair(clip_id, obj, start_xy, start_yaw, style)
    return motion


def _is_done(style: SitStyle, motion: HumanMotion) -> bool:
    """Whether a clip found the supports that its style asks for."""
    return all(motion.style[name] == getattr(style, name) for name in ("on_seat", "on_arms", "against"))


def make_sit_chair(
    clip_id: str, obj: SceneObject, start_xy: np.ndarray, start_yaw: float, style: SitStyle
) -> HumanMotion:
    """The clip that follows from a start, a chair and a style, in closed form.

    The point between the ankles starts at `start_xy` (2,) [m] with heading `start_yaw` [rad].
    """
    return sit_down(
        clip_id, "sit-chair", unihsi_body(style.body_scale), obj, start_xy, start_yaw, style, gait_of(style)
    )


def gait_of(style: SitStyle) -> Gait:
    """With flat feet and short steps, as a robot of flat feet learns it soonest."""
    return Gait(
        speed=style.speed,
        step_time=0.64,
        double_support=0.26,
        width=0.235,
        max_turn=0.59,
        first_step=0.6,
        stretch=0.15,
        clearance=0.062,
        heel_strike=0.0,
        heel_off=0.0,
        sway=0.0,
    )


def sit_chair_courses(obj: SceneObject, style: SitStyle) -> tuple[Course, ...]:
    """The one way to sit down on a chair in a style."""
    return (sit_course("sit-chair", unihsi_body(style.body_scale), obj, style, gait_of(style)),)
