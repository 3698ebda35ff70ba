"""`lie-bed`: walk to the nearer side of a bed, sit down on its edge, swing the legs up, lie down with the head on
the pillow.
"""

from functools import partial

import numpy as np

from mimicbench.core.motion import HumanMotion
from mimicbench.core.seeds import rng
from mimicbench.objects.shape import SceneObject
from mimicbench.references.actions.berths import Berth, aslant, perch
from mimicbench.references.actions.lying import lie_course, lie_down
from mimicbench.references.actions.lying_style import LieStyle, draw_style, onto_the_side
from mimicbench.references.body.body import Body, unihsi_body
from mimicbench.references.locomotion.course import Course
from mimicbench.references.locomotion.gait import Gait
from mimicbench.references.locomotion.route import Route, around_box
from mimicbench.references.locomotion.walking import draw_start
from mimicbench.references.synthesis.manner import manner
from mimicbench.references.synthesis.synthesis import Synthesis

INSIDE = 0.32
"""How far behind the edge the pelvis of who lies is, at most [m]: nobody pushes the hips farther in than needed."""
TURNS = 5.8
"""When on the clock somebody turns onto the side: after lying on the back [s]."""
MARGIN = 0.40
"""Between the way and the bed [m]."""
ON_SIDE = 0.25
"""Share of people who turn onto the side in the end."""


def synthesize_lie_bed(clip_id: str, obj: SceneObject, seed: int, alike: bool = False) -> HumanMotion:
    """One clip. Raises BadObject if there is nothing to lie on."""
    height = obj.require_seat()
    random = rng(seed, clip_id, obj.id)
    start_xy, start_yaw = draw_start(random, obj)
    # the shortest people stay away from the highest beds, where their feet would hang
    chance = manner(random, alike)
    scale = chance.uniform(max(0.96, min(1.10, 1.75 * height)), 1.15)
    duration = 24.8 + 0.7 * float(np.clip(chance.standard_normal(), -2.0, 2.0))
    style = draw_style(chance, scale, duration, (0.95, 1.1))
    if chance.uniform() < ON_SIDE:
        style = onto_the_side(style, TURNS)
    return make_lie_bed(clip_id, obj, start_xy, start_yaw, style)


def make_lie_bed(
    clip_id: str, obj: SceneObject, start_xy: np.ndarray, start_yaw: float, style: LieStyle
) -> HumanMotion:
    """The clip that follows from a start, a bed and a style, in closed form.

    The point between the ankles starts at `start_xy` (2,) [m] with heading `start_yaw` [rad].
    """
    body = unihsi_body(style.body_scale)
    berth = find_berth(obj, body, start_xy)
    route = _route(obj, berth, start_xy)
    course = lie_course("lie-bed", obj, body, berth, lambda _: route, gait_of(style), style)
    return lie_down(clip_id, course, route, start_yaw, style)


def gait_of(style: LieStyle) -> Gait:
    """As people walk who are in no hurry."""
    return Gait(speed=style.speed)


def lie_bed_courses(obj: SceneObject, style: LieStyle) -> tuple[Course, ...]:
    """How to lie down on a bed in a style: from its left side, and from its right one."""
    body = unihsi_body(style.body_scale)
    berths = [find_berth(obj, body, np.array([0.0, side])) for side in (1.0, -1.0)]
    return tuple(
        lie_course("lie-bed", obj, body, berth, partial(_route, obj, berth), gait_of(style), style) for berth in berths
    )


def find_berth(obj: SceneObject, body: Body, start_xy: np.ndarray) -> Berth:
    """Where a body lies that comes from `start_xy` (2,) [m]: nearly along the nearer side of the bed, half an arm's
    length from its edge.
    """
    height = obj.require_seat()
    low, high = obj.seat_polygon.min(0), obj.seat_polygon.max(0)
    side = (
        float(np.sign(start_xy[1]))
        if abs(start_xy[1]) > 0.3 or abs(obj.head_xy[1]) < 0.05
        else float(np.sign(obj.head_xy[1]))
    )
    side = side or 1.0
    edge = float(high[1] if side > 0 else -low[1])
    # the head's middle; from there to the pelvis
    spine = float(body.skeleton.offsets[[body.chest, body.head], 2].sum()) + 0.175 * body.size
    head_x = max(low[0] + 0.105 * body.size + 0.02, float(obj.head_xy[0]) - 0.08)
    x = head_x + spine
    depth_lying = min(edge - abs(float(obj.head_xy[1])) if abs(obj.head_xy[1]) > 0.05 else edge, INSIDE)
    corners = obj.corners()
    least, most = corners.min(1), corners.max(1)
    beside = (least[:, 0] < x + 0.25) & (most[:, 0] > x - 0.25) & (least[:, 2] < height - 0.05)
    outermost = float((most[beside, 1] if side > 0 else -least[beside, 1]).max())
    depth, ahead = perch(body, height, max(0.06, outermost - edge + 0.07))
    boards = (
        (least[:, 0] > high[0] - 0.06)
        & (most[:, 2] > height + 0.03)
        & (least[:, 1] < side * 0.5 * edge + 0.3)
        & (most[:, 1] > side * 0.5 * edge - 0.3)
    )
    foot_end = float(least[boards, 0].min()) if boards.any() else float(high[0]) + 0.03
    pillow = most[
        (most[:, 2] > height + 0.01) & (least[:, 2] < height) & (most[:, 0] < low[0] + 0.5) & (least[:, 0] > low[0]), 2
    ]
    out = np.array([0.0, side])
    lying, seat, stop = (np.array([x, side * (edge + across)]) for across in (-depth_lying, -depth, ahead))
    above = float(pillow.max()) - height if len(pillow) else 0.0
    head = aslant(np.array([-1.0, 0.0]), out)
    return Berth(height, above, head, out, lying, seat, stop, foot_end - x, bool(boards.any()), True)


def _route(obj: SceneObject, berth: Berth, start_xy: np.ndarray) -> Route:
    """Around what stands between the start and the side of the bed; tables beside the head are behind who comes."""
    corners = obj.corners()
    beside = corners[..., 0].max(1) > berth.pelvis_xy[0] - 0.3
    low, high = corners[beside].min((0, 1)), corners[beside].max((0, 1))
    # as seen by who looks out of the bed: `around_box` goes to the front of a rectangle
    side = berth.out[1]
    turned = np.array([[0.0, side], [-side, 0.0]])  # x' = side y, y' = -side x
    ends = np.array([turned @ low[:2], turned @ high[:2]])
    near, far = ends.min(0), ends.max(0)
    stop = turned @ berth.stop_xy
    before = np.array([max(stop[0] + 0.25, far[0] + MARGIN), stop[1]])
    return Route(around_box(turned @ start_xy, before, near, far, MARGIN).points @ turned)


SYNTHESIS = Synthesis(
    "lie-bed", synthesize_lie_bed, LieStyle, lambda obj, style, _: lie_bed_courses(obj, style), alike=True
)
