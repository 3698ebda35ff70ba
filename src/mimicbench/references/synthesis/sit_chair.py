"""`sit-chair`: start anywhere around a chair, walk to its front, turn the back to it, sit down, stay."""

import numpy as np

from mimicbench.core.motion import HumanMotion
from mimicbench.core.seeds import rng
from mimicbench.objects.shape import SceneObject
from mimicbench.references.actions.sit_styles import SitStyle, draw_manner, plain
from mimicbench.references.actions.sitting import sit_course, sit_down
from mimicbench.references.body.body import unihsi_body
from mimicbench.references.locomotion.course import Course
from mimicbench.references.locomotion.gait import Gait
from mimicbench.references.locomotion.walking import draw_start
from mimicbench.references.synthesis.manner import manner
from mimicbench.references.synthesis.synthesis import Synthesis

SLOW, DROPS = 0.12, 0.12
"""Shares of people who take their time, and who let themselves drop the last centimeters."""


def draw_style(random: np.random.Generator, seat_height: float) -> SitStyle:
    """The free choices of a clip.

    The shortest people stay away from the highest seats [m], where their feet would hang.
    """
    shortest = max(1.03, min(1.10, 2.1 * seat_height))
    slow, drops = random.uniform(size=2) < (SLOW, DROPS)
    return SitStyle(
        body_scale=random.uniform(shortest, 1.13),
        speed=random.uniform(0.68, 0.84),
        sit_duration=random.uniform(3.0, 3.5) if slow else random.uniform(2.35, 2.9),
        seat_x=random.uniform(-0.10, 0.0),
        seat_y=random.uniform(-0.02, 0.02),
        arm_swing=random.uniform(0.7, 1.2),
        duration=14.8 + 0.5 * float(np.clip(random.standard_normal(), -2, 2)),
        drop=random.uniform(0.03, 0.05) if drops else 0.0,
        **draw_manner(random),
    )


def synthesize_sit_chair(clip_id: str, obj: SceneObject, seed: int, alike: bool = False) -> HumanMotion:
    """One clip. Raises BadObject if there is no seat."""
    seat_height = obj.require_seat()
    random = rng(seed, clip_id, obj.id)
    start_xy, start_yaw = draw_start(random, obj)
    style = draw_style(manner(random, alike), seat_height)
    return make_sit_chair(clip_id, obj, start_xy, start_yaw, plain(style) if alike else style)


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
    """As people walk who are in no hurry."""
    return Gait(speed=style.speed)


def sit_chair_courses(obj: SceneObject, style: SitStyle) -> tuple[Course, ...]:
    """The one way to sit down on a chair in a style."""
    return (sit_course("sit-chair", unihsi_body(style.body_scale), obj, style, gait_of(style)),)


SYNTHESIS = Synthesis(
    "sit-chair", synthesize_sit_chair, SitStyle, lambda obj, style, _: sit_chair_courses(obj, style), alike=True
)
