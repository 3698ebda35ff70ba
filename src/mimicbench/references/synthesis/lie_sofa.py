"""`lie-sofa`: walk to the front of a sofa, sit down on its edge, swing the legs up, lie down along it with the feet
on the seat.
"""

from dataclasses import replace
from functools import partial

import numpy as np

from mimicbench.core.motion import HumanMotion
from mimicbench.core.seeds import rng
from mimicbench.objects.families.sofa_shape import HEAD_ROOM
from mimicbench.objects.shape import SceneObject
from mimicbench.references.actions.berths import Berth, aslant, perch
from mimicbench.references.actions.lying import lie_course, lie_down
from mimicbench.references.actions.lying_style import LieStyle, draw_style, needed_time, onto_the_side
from mimicbench.references.body.body import Body, roam_body
from mimicbench.references.locomotion.course import Course
from mimicbench.references.locomotion.gait import Gait, plan_footsteps
from mimicbench.references.locomotion.route import Route, around_box
from mimicbench.references.locomotion.walking import draw_start
from mimicbench.references.synthesis.manner import manner
from mimicbench.references.synthesis.synthesis import Synthesis

FORWARD = 0.05
"""Who lies where nothing rises behind lies so much nearer to the front than the middle [m]: robots slide the other way
while their legs swing up."""
MARGIN = 0.40
"""Between the way and the sofa [m]."""
ON_SIDE = 0.3
"""Share of people who lie on the side in the end."""
TURNS = 4.3
"""When on the clock they turn: while the legs are still being stretched [s]."""
TRIES = 60
"""Starts that are drawn to find one from which there is time enough; on the largest sofas the quickest of them may take
longer."""


def synthesize_lie_sofa(clip_id: str, obj: SceneObject, seed: int, alike: bool = False) -> HumanMotion:
    """One clip. Raises BadObject if there is nothing to lie on."""
    height = obj.require_seat()
    random = rng(seed, clip_id, obj.id)
    low, high = obj.seat_polygon.min(0), obj.seat_polygon.max(0)
    span = float(max(high[1] - obj.head_xy[1], obj.head_xy[1] - low[1]))
    # the shortest people stay away from the highest sofas, where their feet would hang, and tall ones from the shortest
    # sofas
    shortest = max(0.96, min(1.08, 2.0 * height))
    chance = manner(random, alike)
    scale = chance.uniform(shortest, max(shortest + 0.02, min(1.15, (span + 0.03) / 1.25)))
    duration = 12.1 + 0.05 * float(np.clip(chance.standard_normal(), -2.0, 2.0))
    style = draw_style(chance, scale, duration, (0.66, 0.72))
    if chance.uniform() < ON_SIDE:
        style = onto_the_side(replace(style, curl=chance.uniform(0.4, 0.85)), TURNS)
    plans, ends = [], []
    for _ in range(TRIES):
        start_xy, start_yaw = draw_start(random, obj)
        body, berth, route = _plan(obj, start_xy, style)
        plans.append((body, berth, route, start_yaw))
        ends.append(
            plan_footsteps(start_yaw, route, berth.stop_xy, 0.0, gait_of(style), body.size).end
            - style.lead
            + needed_time(style)
        )
        if ends[-1] <= duration:
            break
    body, berth, route, start_yaw = plans[int(np.argmin(ends))]
    course = lie_course("lie-sofa", obj, body, berth, lambda _: route, gait_of(style), style)
    return lie_down(clip_id, course, route, start_yaw, style)


def lie_sofa_courses(obj: SceneObject, style: LieStyle) -> tuple[Course, ...]:
    """The one way to lie down on a sofa in a style."""
    body = roam_body(style.body_scale)
    berth = find_berth(obj, body)
    return (lie_course("lie-sofa", obj, body, berth, partial(_route, obj, berth), gait_of(style), style),)


def gait_of(style: LieStyle) -> Gait:
    """As people walk who are in no hurry."""
    return Gait(speed=style.speed, stand=0.6)


def _plan(obj: SceneObject, start_xy: np.ndarray, style: LieStyle) -> tuple[Body, Berth, Route]:
    """Who lies down, where, and the way there."""
    body = roam_body(style.body_scale)
    berth = find_berth(obj, body)
    return body, berth, _route(obj, berth, start_xy)


def _route(obj: SceneObject, berth: Berth, start_xy: np.ndarray) -> Route:
    """The way around the sofa to in front of the berth."""
    low, high = obj.bounds()
    before = np.array([max(berth.stop_xy[0] + 0.25, high[0] + MARGIN), berth.stop_xy[1]])
    return around_box(start_xy, before, low[:2], high[:2], MARGIN)


def find_berth(obj: SceneObject, body: Body) -> Berth:
    """Where a body lies on a sofa: nearly along the middle of its seat, the head at the pillow."""
    height = obj.require_seat()
    low, high = obj.seat_polygon.min(0), obj.seat_polygon.max(0)
    side = 1.0 if obj.head_xy[1] > (low[1] + high[1]) / 2 else -1.0
    offsets = body.skeleton.offsets
    spine = float(offsets[[*body.spine, *body.neck], 2].sum()) + 0.085 * body.size
    # who has little room for the legs moves the head up to the end
    span = side * (float(obj.head_xy[1]) - float(low[1] if side > 0 else high[1]))
    up = float(np.clip(1.30 * body.size - span, 0.02, max(0.02, HEAD_ROOM - 0.105 * body.size)))
    y = float(obj.head_xy[1]) - side * (spine - up)
    corners = obj.corners()
    least, most = corners.min(1), corners.max(1)

    def blocked(at: float) -> float:
        """How far the sofa reaches out in front of the edge there."""
        there = (least[:, 1] < at + 0.24) & (most[:, 1] > at - 0.24) & (least[:, 2] < height + 0.1)
        return float(most[there, 0].max()) - float(high[0]) if there.any() else 0.0

    # where a chaise reaches to the front, sit down beside it
    at = next((y + side * d for d in np.arange(0.0, 0.45, 0.05) if blocked(y + side * d) < 0.05), y)
    depth, ahead = perch(body, height, max(0.06, blocked(at) + 0.07))
    foot_end = float(low[1] if side > 0 else high[1])
    end = (side * (most if side > 0 else least)[:, 1] < side * foot_end + 0.06) & (most[:, 2] > height + 0.03)
    room = side * (y - foot_end) + (0.0 if end.any() else 0.05)
    pillow = float(most[(np.abs(obj.box_pos[:, :2] - obj.head_xy) < 0.03).all(-1), 2].max(initial=height)) - height
    front = float(high[0])
    behind = (most[:, 2] > height + 0.15) & (least[:, 0] < low[0]) & ((most - least)[:, 1] > 0.5 * span)
    lying, seat, stop = (
        np.array([float(obj.head_xy[0]) + (0.0 if behind.any() else FORWARD), y]),
        np.array([front - depth, at]),
        np.array([front + ahead, at]),
    )
    out = np.array([1.0, 0.0])
    head = aslant(np.array([0.0, side]), out)
    return Berth(height, pillow, head, out, lying, seat, stop, room, bool(end.any()), False)


SYNTHESIS = Synthesis(
    "lie-sofa", synthesize_lie_sofa, LieStyle, lambda obj, style, _: lie_sofa_courses(obj, style), alike=True
)
