"""`sit-sofa`: walk to the nearest place on a sofa, turn the back to it, sit down, perhaps lean back, rest."""

import numpy as np

from mimicbench.core.errors import BadMotion
from mimicbench.core.motion import HumanMotion
from mimicbench.core.seeds import rng
from mimicbench.objects.shape import SceneObject
from mimicbench.references.actions.seats import place_at, places
from mimicbench.references.actions.sit_styles import SitStyle, draw_manner, plain
from mimicbench.references.actions.sitting import route_to, settled, sit_course, sit_down
from mimicbench.references.body.body import roam_body
from mimicbench.references.locomotion.course import Course
from mimicbench.references.locomotion.gait import Gait, plan_footsteps
from mimicbench.references.locomotion.walking import draw_start
from mimicbench.references.synthesis.manner import manner
from mimicbench.references.synthesis.synthesis import Synthesis

REST = 0.6
"""Least time at rest in the end of a clip [s]."""
TRIES = 60
"""Starts that are drawn to find one from which there is time enough."""


def draw_style(random: np.random.Generator, obj: SceneObject, start_xy: np.ndarray) -> SitStyle:
    """The free choices of a clip: people of any size, on the place that is nearest to where they start (2,) [m].

    The shortest people stay away from the highest seats, where their feet would hang.
    """
    shortest = max(0.97, min(1.10, 2.2 * obj.require_seat()))
    every = places(obj)
    place = (
        every[np.argmin(np.abs(every - start_xy[1]))]
        - (obj.seat_polygon[:, 1].min() + obj.seat_polygon[:, 1].max()) / 2
    )
    slow, drops = random.uniform(size=2) < (0.10, 0.12)
    return SitStyle(
        body_scale=random.uniform(shortest, 1.15),
        speed=random.uniform(0.68, 0.82),
        sit_duration=random.uniform(3.0, 3.4) if slow else random.uniform(2.4, 2.9),
        seat_x=random.uniform(-0.10, 0.0),
        seat_y=place + random.uniform(-0.035, 0.035),
        arm_swing=random.uniform(0.7, 1.2),
        duration=12.1 + 0.05 * float(np.clip(random.standard_normal(), -2, 2)),
        lead=random.uniform(0.0, 1.4),
        drop=random.uniform(0.03, 0.05) if drops else 0.0,
        **draw_manner(random),
    )


def synthesize_sit_sofa(clip_id: str, obj: SceneObject, seed: int, alike: bool = False) -> HumanMotion:
    """One clip. Raises BadObject if there is no seat."""
    obj.require_seat()
    random = rng(seed, clip_id, obj.id)
    for _ in range(TRIES):
        start_xy, start_yaw = draw_start(random, obj)
        style = draw_style(manner(random, alike), obj, start_xy)
        style = plain(style) if alike else style
        if arrival(obj, start_xy, start_yaw, style) + settled(style) + REST <= style.duration:
            return make_sit_sofa(clip_id, obj, start_xy, start_yaw, style)
    raise BadMotion(f"clip {clip_id}: sofa {obj.id} is too large to walk to and sit down on in time; use a smaller one")


def make_sit_sofa(
    clip_id: str, obj: SceneObject, start_xy: np.ndarray, start_yaw: float, style: SitStyle
) -> HumanMotion:
    """The clip that follows from a start, a sofa and a style, in closed form.

    The point between the ankles starts at `start_xy` (2,) [m] with heading `start_yaw` [rad].
    """
    return sit_down(clip_id, "sit-sofa", roam_body(style.body_scale), obj, start_xy, start_yaw, style, gait_of(style))


def sit_sofa_courses(obj: SceneObject, style: SitStyle) -> tuple[Course, ...]:
    """The one way to sit down on a sofa in a style."""
    return (sit_course("sit-sofa", roam_body(style.body_scale), obj, style, gait_of(style)),)


def gait_of(style: SitStyle) -> Gait:
    """As people walk who are in no hurry."""
    return Gait(speed=style.speed, stand=0.6)


def arrival(obj: SceneObject, start_xy: np.ndarray, start_yaw: float, style: SitStyle) -> float:
    """When the feet stand in front of the seat [s]."""
    middle = float(obj.seat_polygon[:, 1].min() + obj.seat_polygon[:, 1].max()) / 2
    place = place_at(obj, roam_body(style.body_scale), middle + style.seat_y, style.seat_x)
    return (
        plan_footsteps(
            start_yaw, route_to(obj, start_xy, place), place.ankles, 0.0, gait_of(style), style.body_scale
        ).end
        - style.lead
    )


SYNTHESIS = Synthesis(
    "sit-sofa", synthesize_sit_sofa, SitStyle, lambda obj, style, _: sit_sofa_courses(obj, style), alike=True
)
