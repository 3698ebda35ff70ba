"""What a seat offers to a body: where to stand and sit, how far back, and a back to lean against.

Found from boxes alone.
"""

from dataclasses import dataclass, replace

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.skeleton import forward_kinematics
from mimicbench.objects.shape import SceneObject
from mimicbench.references.body.body import Body
from mimicbench.references.body.limbs import about_y, two_link

ARM_ROOM = 0.28
"""From the end of a seat to the middle of who sits there [m]."""
PLACE = 0.50
"""Between people who sit side by side [m]."""
THIGH = 0.042
"""Least height of a thigh's axis over the seat's front edge [m], of body size 1."""
SHIN = 0.045
"""Least distance of a knee from that edge [m], of body size 1."""
LOWER = 0.012
"""Feet come out only so far that a pelvis so much lower would do, too [m]: thighs spread, and shift at rest."""
SINK = 0.01
"""How deep a body sinks into what it sits on or leans against [m]."""
DEEPEST = 0.325
"""Farthest that a pelvis sits behind a seat's front edge [m]: who has shorter thighs, as robots do, can follow."""
REAR = 0.10
"""Between a pelvis and the rear edge of a seat, at least [m]."""
LEANS = np.array([0.0, 0.07, -0.07, 0.14, -0.14, 0.21, 0.28, 0.36])
"""How much farther or less far than wanted somebody leans to reach a back [rad], the likeliest first."""
FREE = 0.01
"""Who does not lean against what is behind them keeps so far off it [m]."""


@dataclass(frozen=True)
class Place:
    """One place on a seat."""

    ankles: np.ndarray
    """(2,) between the ankles of who sits there [m]."""
    pelvis: np.ndarray
    """(3,) of who sits there upright [m]."""


@dataclass(frozen=True)
class Seated:
    """How somebody sits in the end."""

    pelvis: np.ndarray
    """(3,) [m]."""
    pitch: float
    """How far the pelvis leans back [rad]."""
    bend: float
    """How far the chest is bent forward over it [rad]."""
    bears: bool
    """Whether the trunk leans against a back."""


def places(obj: SceneObject) -> np.ndarray:
    """(P,) middles of the places on a seat, from right to left [m]."""
    right, left = obj.seat_polygon[:, 1].min(), obj.seat_polygon[:, 1].max()
    free = float(left - right) - 2 * ARM_ROOM
    count = 1 + max(0, int(free / PLACE))
    return (right + left) / 2 + np.linspace(-0.5, 0.5, count) * free if count > 1 else np.array([(right + left) / 2])


def place_at(obj: SceneObject, body: Body, y: float, forward: float = 0.0) -> Place:
    """The place at `y` [m], `forward` [m] of the usual depth or as far behind it as the thighs clear the seat's front
    edge. Raises BadObject if there is no seat.

    The feet are drawn in until the heels are near the seat's front edge, or just in front of what stands below it.
    """
    height = obj.require_seat()
    front = float(obj.seat_polygon[:, 0].max())
    low, high = obj.corners().min(1), obj.corners().max(1)
    in_the_way = (low[:, 2] < 0.30) & (low[:, 1] < y + 0.20) & (high[:, 1] > y - 0.20)
    below = float(high[in_the_way, 0].max()) if in_the_way.any() else -np.inf
    ankle = max(front + 0.06, below + 0.125)
    depth = np.clip(0.155 - 0.5 * (ankle - front - 0.06), 0.12, 0.5 * np.ptp(obj.seat_polygon[:, 0]))
    usual = np.array([front - depth + max(forward, 0.0), y, height + body.buttock - SINK])
    place = Place(np.array([ankle, y]), usual)
    return replace(place, pelvis=usual + _ways_back(obj, body, place, -forward)[-1]) if forward < 0 else place


def lean_against(obj: SceneObject, body: Body, place: Place, pitch: float, bend: float) -> Seated | None:
    """The way to lean at about `pitch` [rad] against what is behind a place, with the chest bent forward by `bend`
    [rad] over the pelvis.

    The pelvis goes back until the trunk bears, but not so far that the knees do not clear the seat's front edge; None
    if nothing is reached.
    """
    back = _ways_back(obj, body, place, 0.75 * body.length(body.legs[0])[0])
    for angle in pitch + LEANS:
        gap = _behind(obj, body, place.pelvis + back, -angle, bend)
        bears = np.flatnonzero(gap <= -SINK / 2)
        if len(bears) and gap[bears[0]] > -1.5 * SINK:
            return Seated(place.pelvis + back[bears[0]], float(angle), bend, True)
    return None


def sit_free(obj: SceneObject, body: Body, place: Place, back: float, pitch: float, bend: float) -> Seated:
    """The way to sit up to `back` [m] behind a place, leaning back by up to `pitch` [rad], that bears on no back."""
    ways = _ways_back(obj, body, place, back)
    for share in (1.0, 0.75, 0.5, 0.25) if pitch > 0 else (1.0,):
        free = _behind(obj, body, place.pelvis + ways, -share * pitch, bend) > FREE
        if free[0]:
            last = len(free) if free.all() else int(np.argmin(free))
            return Seated(place.pelvis + ways[last - 1], share * pitch, bend, False)
    return Seated(place.pelvis, min(pitch, 0.0), bend, False)


def foot_allowed(obj: SceneObject, body: Body, hip: np.ndarray, ankle: np.ndarray, way: np.ndarray) -> float:
    """Share of a way (3,) that a foot may go from an ankle (3,) while thigh and shin below a hip (3,) keep off what
    somebody sits on [m].
    """
    shares = np.array([1.0, 0.8, 0.6, 0.4, 0.2])
    ankles, upper, lower = ankle + shares[:, None] * way, *body.length(body.legs[0])
    hips = np.broadcast_to(hip - [0.0, 0.0, LOWER], ankles.shape)
    thigh, shin, _ = two_link(hips, ankles, np.array([[0.0, 1.0, 0.0]]), upper, lower, True)
    along = np.linspace(0.15, 0.85, 8)[:, None, None] * [0.0, 0.0, -1.0]
    knees = hips + rot.rotate(thigh, np.array([0.0, 0.0, -upper]))
    clear = (obj.distance(hips + rot.rotate(thigh, upper * along)) > THIGH * body.size).all(0)
    clear &= (obj.distance(knees + rot.rotate(shin, lower * along)) > THIGH * body.size).all(0)
    clear &= obj.distance(ankles) > 0.08 * body.size
    short = np.linalg.norm(ankles - hips, axis=-1) < 0.99 * (upper + lower)
    return float(shares[np.argmax(clear & short)]) if (clear & short).any() else 0.0


def _ways_back(obj: SceneObject, body: Body, place: Place, most: float) -> np.ndarray:
    """(N, 3) shifts of the pelvis, ever farther back, up to `most` [m], on the seat and with the knees before it."""
    low, high = float(obj.seat_polygon[:, 0].min()), float(obj.seat_polygon[:, 0].max())
    most = min(most, float(place.pelvis[0]) - low - REAR, float(place.pelvis[0]) - high + DEEPEST)
    back = np.arange(0.0, max(most, 0.0) + 0.005, 0.01)[:, None] * [-1.0, 0.0, 0.0]
    return back[: max(1, _knees_clear(obj, body, place, back))]


def _behind(obj: SceneObject, body: Body, pelvis: np.ndarray, pitch: float, bend: float) -> np.ndarray:
    """(N,) how far the trunk over pelvises (N, 3) [m] is off the object [m], negative inside it."""
    points, radius = _trunk_points(body, pitch, bend)
    return (obj.distance(pelvis[:, None] + points) - radius).min(-1)


def _knees_clear(obj: SceneObject, body: Body, place: Place, back: np.ndarray) -> int:
    """How many of these shifts (N, 3) [m] of the pelvis, ever farther back, leave the knees in front of the seat and
    the thighs above it.
    """
    hips = place.pelvis + back + [0.0, 0.0, -body.hip_drop]
    ankles = np.broadcast_to([*place.ankles, body.sole], hips.shape)
    upper, lower = body.length(body.legs[0])
    thigh, _, _ = two_link(hips, ankles, np.array([[0.0, 1.0, 0.0]]), upper, lower, True)
    knees = hips + rot.rotate(thigh, np.array([0.0, 0.0, -upper]))
    front = float(obj.seat_polygon[:, 0].max())
    edge = (front - hips[:, 0]) / (knees[:, 0] - hips[:, 0])
    clear = (knees[:, 0] > front + SHIN * body.size) & (
        hips[:, 2] + edge * (knees[:, 2] - hips[:, 2]) > obj.require_seat() + THIGH * body.size
    )
    return len(clear) if clear.all() else int(np.argmin(clear))


def _trunk_points(body: Body, pitch: float, bend: float) -> tuple[np.ndarray, np.ndarray]:
    """Points (S, 3) along the trunk of who sits, relative to the pelvis, and the trunk's radius (S,) around them
    [m].
    """
    quat = np.tile(rot.IDENTITY, (len(body.skeleton.joint_names), 1))
    quat[body.pelvis] = about_y(np.array(pitch))
    quat[list(body.spine)] = about_y(np.array(bend / len(body.spine)))
    pos, world = forward_kinematics(body.skeleton, np.zeros(3), quat)
    parts = [part for part in body.parts if part.role == "trunk"]
    points = [pos[part.joint] + rot.rotate(world[part.joint], np.linspace(part.start, part.end, 5)) for part in parts]
    return np.concatenate(points), np.repeat([part.radius for part in parts], 5)
