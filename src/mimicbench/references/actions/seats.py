"""What a seat offers to a body: where to stand and sit, a back to lean against, and places for the hands.

Found from boxes alone.
"""

from dataclasses import dataclass

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.motion import forward_kinematics
from mimicbench.objects.shape import SceneObject
from mimicbench.references.body.body import Body
from mimicbench.references.body.limbs import about_y, two_link

ARM_ROOM = 0.28
"""From the end of a seat to the middle of who sits there [m]."""
PLACE = 0.50
"""Between people who sit side by side [m]."""
THIGH = 0.037
"""Least height of a thigh's axis over the seat's front edge [m], of body size 1."""
SINK = 0.01
"""How deep a body sinks into what it sits on or leans against [m]."""
WRIST = 0.045
"""Height of a wrist over what the palm rests on [m]."""


@dataclass(frozen=True)
class Place:
    """One place on a seat."""

    ankles: np.ndarray
    """(2,) between the ankles of who sits there [m]."""
    pelvis: np.ndarray
    """(3,) of who sits there upright [m]."""


@dataclass(frozen=True)
class Leaning:
    """How to sit against a back."""

    pelvis: np.ndarray
    """(3,) [m]."""
    pitch: float
    """How far pelvis and trunk lean back [rad]."""


def places(obj: SceneObject) -> np.ndarray:
    """(P,) middles of the places on a seat, from right to left [m]."""
    right, left = obj.seat_polygon[:, 1].min(), obj.seat_polygon[:, 1].max()
    free = float(left - right) - 2 * ARM_ROOM
    count = 1 + max(0, int(free / PLACE))
    return (right + left) / 2 + np.linspace(-0.5, 0.5, count) * free if count > 1 else np.array([(right + left) / 2])


def place_at(obj: SceneObject, body: Body, y: float, forward: float = 0.0) -> Place:
    """The place at `y` [m], `forward` [m] of the usual depth. Raises BadObject if there is no seat.

    The feet are drawn in until the heels are near the seat's front edge, or just in front of what stands below it.
    """
    height = obj.require_seat()
    front = float(obj.seat_polygon[:, 0].max())
    low, high = obj.corners().min(1), obj.corners().max(1)
    in_the_way = (low[:, 2] < 0.30) & (low[:, 1] < y + 0.20) & (high[:, 1] > y - 0.20)
    below = float(high[in_the_way, 0].max()) if in_the_way.any() else -np.inf
    ankle = max(front + 0.06, below + 0.125)
    depth = np.clip(0.155 - 0.5 * (ankle - front - 0.06), 0.12, 0.5 * np.ptp(obj.seat_polygon[:, 0]))
    return Place(np.array([ankle, y]), np.array([front - depth + forward, y, height + body.buttock - SINK]))


def lean_against(obj: SceneObject, body: Body, place: Place, pitch: float, bend: float) -> Leaning | None:
    """The way to lean at about `pitch` [rad] against what is behind a place, with the chest bent forward by `bend`
    [rad] over the pelvis.

    The pelvis goes back until the trunk bears, but not so far that the knees do not clear the seat's front edge; None
    if nothing is reached.
    """
    back = np.arange(0.0, 0.5 * body.length(body.legs[0])[0], 0.01)[:, None] * [-1.0, 0.0, 0.0]
    back = back[: _knees_clear(obj, body, place, back)]
    for angle in pitch + np.array([0.0, 0.07, -0.07, 0.14, 0.21]):
        points, radius = _trunk_points(body, -angle, bend)
        gap = (obj.distance(place.pelvis + back[:, None] + points) - radius).min(-1)
        bears = np.flatnonzero(gap <= -SINK / 2)
        if len(bears) and gap[bears[0]] > -1.5 * SINK:
            return Leaning(place.pelvis + back[bears[0]], float(angle))
    return None


def feet_allowed(obj: SceneObject, body: Body, place: Place, leaning: Leaning | None, forward: float) -> float:
    """Share of `forward` [m] by which a foot of who sits may come forward with the thigh above the seat's front
    edge.
    """
    seated = place.pelvis if leaning is None else leaning.pelvis
    shares = (1.0, 0.8, 0.6, 0.4, 0.2)
    there = (Place(place.ankles + [share * forward, 0.0], seated) for share in shares)
    return next(
        (share for share, at in zip(shares, there, strict=True) if _knees_clear(obj, body, at, np.zeros((1, 3)))), 0.0
    )


def _knees_clear(obj: SceneObject, body: Body, place: Place, back: np.ndarray) -> int:
    """How many of these shifts (N, 3) [m] of the pelvis, ever farther back, leave the knees in front of the seat and
    the thighs above it.
    """
    hips = place.pelvis + back + [0.0, 0.0, -body.hip_drop]
    ankles = np.broadcast_to([*place.ankles, body.sole], hips.shape)
    upper, lower = body.length(body.legs[0])
    thigh, _, _ = two_link(hips, ankles, np.array([[0.0, 1.0, 0.0]]), upper, lower, True)
    knees = hips + rot.rotate(thigh, np.array([0.0, 0.0, -upper]))
    edge = (obj.seat_polygon[:, 0].max() - hips[:, 0]) / (knees[:, 0] - hips[:, 0])
    clear = (edge < 0.98) & (hips[:, 2] + edge * (knees[:, 2] - hips[:, 2]) > obj.require_seat() + THIGH * body.size)
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


def armrest(obj: SceneObject, body: Body, pelvis: np.ndarray, shoulder: np.ndarray, side: int) -> np.ndarray | None:
    """Where the wrist (3,) [m] of the left (0) or right (1) hand rests on an arm beside who sits with the pelvis at
    (3,); None without one in reach.

    Looks straight down on a grid beside the body for what is between 6 and 28 cm above the seat and has nothing above
    it. `shoulder` is (3,).
    """
    height, sign = obj.require_seat(), 1.0 - 2.0 * side
    x = pelvis[0] + np.arange(0.04, 0.30, 0.04)
    y = pelvis[1] + sign * np.arange(0.20, 0.56, 0.02)
    z = height + np.arange(0.06, 0.50, 0.02)
    points = np.stack(np.meshgrid(x, y, z, indexing="ij"), -1)
    solid = obj.distance(points) <= 0.0
    top = np.where(solid, z, -np.inf).max(-1)
    good = solid.any(-1) & (top < height + 0.28)
    # a hand is wide: the arm goes on to one side at least
    level = good[:, 1:] & good[:, :-1] & (np.abs(np.diff(np.where(good, top, 0.0), axis=1)) < 0.03)
    wide = np.pad(level, ((0, 0), (0, 1))) | np.pad(level, ((0, 0), (1, 0)))
    wrists = np.stack([*np.meshgrid(x, y, indexing="ij"), top + WRIST + 0.01], -1)
    away = np.linalg.norm(wrists - shoulder, axis=-1)
    reach = sum(body.length(body.arms[side]))
    fits = wide & (away < 0.94 * reach) & (away > 0.55 * reach)
    fits[fits] = obj.distance(wrists[fits]) > 0.04
    fits[fits] = obj.distance(wrists[fits] + 0.3 * (shoulder - wrists[fits])) > 0.05
    if not fits.any():
        return None
    # the most comfortable: the arm nearly straight, a little in front of the hips
    cost = np.where(
        fits,
        np.abs(away / reach - 0.88)
        + np.abs(wrists[..., 0] - pelvis[0] - 0.20)
        + 0.5 * np.abs(wrists[..., 1] - shoulder[1]),
        np.inf,
    )
    return wrists[np.unravel_index(int(np.argmin(cost)), cost.shape)]


def beside_thigh(obj: SceneObject, body: Body, pelvis: np.ndarray, side: int) -> np.ndarray | None:
    """Where the wrist (3,) [m] of a hand rests on the seat beside the thighs; None if the seat ends there."""
    right, left = float(obj.seat_polygon[:, 1].min()), float(obj.seat_polygon[:, 1].max())
    edge = left - pelvis[1] if side == 0 else pelvis[1] - right
    beside = min(body.hip_half_width + 0.135 * body.size, edge - 0.01)  # or on the seat's edge
    wrist = np.array([pelvis[0] + 0.03, pelvis[1] + (1.0 - 2.0 * side) * beside, obj.require_seat() + WRIST])
    return wrist if beside > body.hip_half_width + 0.10 * body.size and obj.distance(wrist) > 0.03 else None
