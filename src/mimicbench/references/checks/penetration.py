"""How deep a person is in an object: capsules against boxes, with bounding spheres first so that only what is near
costs time.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull

from mimicbench.core import rotations as rot
from mimicbench.core.motion import HumanMotion
from mimicbench.objects.shape import SceneObject
from mimicbench.references.body.body import Body

SOFT = ("bed", "sofa", "couch")
"""Families that have mattresses and upholstery."""
OWN = ("pelvis", "trunk", "head", "thigh", "shin")
"""What hands and forearms must not be in."""
ARM = ("forearm", "palm")
THICK = (0.028, 0.018)
"""Radii of the forearm towards the wrist and of wrist and palm, at body size 1 [m]."""
SAMPLES = 7
"""Along the axis of a capsule."""


@dataclass(frozen=True)
class Depths:
    """Deepest places over all frames [m], 0 where nothing touches."""

    hard: float
    soft: float
    """In mattresses and upholstery."""
    seat: float
    """Of the pelvis in anything."""
    moving: bool
    """Whether the object moves."""


def soft_boxes(obj: SceneObject) -> np.ndarray:
    """(B,) which boxes of an object are mattress or upholstery.

    Of beds it is what carries the surface to lie on or lies on it; of sofas everything but what stands on the floor
    below the seat.
    """
    if obj.family not in SOFT or obj.seat_height is None:
        return np.zeros(len(obj.box_pos), bool)
    corners = obj.corners()
    low, high = corners.min(1), corners.max(1)
    if obj.family != "bed":
        return high[:, 2] > obj.seat_height - 0.15
    inside = ((low[:, :2] >= obj.seat_polygon.min(0) - 0.02) & (high[:, :2] <= obj.seat_polygon.max(0) + 0.02)).all(-1)
    return inside & (high[:, 2] > obj.seat_height - 0.05)


def depths(motion: HumanMotion, obj: SceneObject, body: Body, pos: np.ndarray, quat: np.ndarray) -> Depths:
    """How deep the body's parts are in the object, which may move, given the joints' poses (T, J, 3) and (T, J, 4)."""
    moving = len(motion.object_pos_w) > 0
    parts = body.parts
    joints = np.array([part.joint for part in parts])
    ends = np.array([[part.start, part.end] for part in parts])  # (P, 2, 3)
    radius = np.array([part.radius for part in parts])
    reach = 0.5 * np.linalg.norm(ends[:, 1] - ends[:, 0], axis=-1) + radius
    low, high = obj.bounds()
    root = pos[:, 0]
    if moving:
        root = rot.rotate_inverse(motion.object_quat_w, root - motion.object_pos_w)
    span = 1.2 * body.standing_height
    frames = np.flatnonzero(((root > low - span) & (root < high + span)).all(-1))
    nothing = Depths(0.0, 0.0, 0.0, moving)
    if not len(frames):
        return nothing
    places = pos[frames[:, None], joints]
    segment = places[:, :, None] + rot.rotate(quat[frames[:, None], joints][:, :, None], ends)  # (T, P, 2, 3)
    if moving:
        segment = rot.rotate_inverse(
            motion.object_quat_w[frames, None, None], segment - motion.object_pos_w[frames, None, None]
        )
    middle = 0.5 * (segment[:, :, 0] + segment[:, :, 1])
    around = ((middle > low - reach[:, None]) & (middle < high + reach[:, None])).all(-1)
    frame, part = np.nonzero(around)
    if not len(frame):
        return nothing
    return _in_boxes(
        obj,
        segment[frame, part],
        radius[part],
        reach[part],
        np.array([p.role == "pelvis" for p in parts])[part],
        moving,
    )


def own_depth(
    body: Body, pos: np.ndarray, quat: np.ndarray, others: Sequence[str] = OWN, points: Sequence[str] = ARM
) -> np.ndarray:
    """(T, 2) how deep either arm is in the body's own parts of some roles [m], negative while it is clear of them.

    `pos` (T, J, 3) and `quat` (T, J, 4) are the joints'; `points` says which of forearm, palm and fingers count.
    """
    return own_gaps(body, pos, quat, others, points)[0].max((2, 3))


def own_gaps(
    body: Body, pos: np.ndarray, quat: np.ndarray, others: Sequence[str], points: Sequence[str]
) -> tuple[np.ndarray, np.ndarray]:
    """(T, 2, parts, points) how deep points of both arms are in the body's own parts [m], and (..., 3) ways out from
    the parts' axes.
    """
    parts = [part for part in body.parts if part.role in others]
    joints = [part.joint for part in parts]
    start, end = (
        pos[:, joints] + rot.rotate(quat[:, joints], np.array([getattr(part, side) for part in parts]))
        for side in ("start", "end")
    )
    along = (end - start)[:, None, :, None]
    length, radius = np.maximum(_squared(along), 1e-12), np.array([part.radius for part in parts])[:, None]
    fore, palm = (
        ("forearm" in points) * (0.3, 0.55, 0.8),
        ("palm" in points) * (0.0, 1.0) + ("fingers" in points) * (1.6,),
    )
    thick = body.size * np.array([THICK[0]] * len(fore) + [THICK[1]] * len(palm))
    mine = []
    for arm in body.arms:
        elbow, wrist = (
            rot.rotate(quat[:, joint, None], np.array(places).reshape(-1, 3)) + pos[:, joint, None]
            for joint, places in (
                (arm.middle, [share * body.skeleton.offsets[arm.end] for share in fore]),
                (arm.end, [[0.0, 0.0, -share * body.hand] for share in palm]),
            )
        )
        mine.append(np.concatenate([elbow, wrist], 1))
    offset = np.stack(mine, 1)[:, :, None] - start[:, None, :, None]  # (T, 2, parts, points, 3)
    share = np.clip((offset * along).sum(-1) / length, 0.0, 1.0)
    away = offset - share[..., None] * along
    gap = np.sqrt(_squared(away))
    return radius + thick - gap, away / np.maximum(gap, 1e-9)[..., None]


def _in_boxes(
    obj: SceneObject, segment: np.ndarray, radius: np.ndarray, reach: np.ndarray, pelvis: np.ndarray, moving: bool
) -> Depths:
    """The same for segments (N, 2, 3) in the object's frame, each with a radius, a bounding radius, and whether it
    is a pelvis (N,).
    """
    worst = {True: 0.0, False: 0.0}
    seat = 0.0
    middle, bound = 0.5 * (segment[:, 0] + segment[:, 1]), reach**2
    matrices, shares, hulls = (
        rot.to_matrix(obj.box_quat),
        np.linspace(0, 1, SAMPLES)[:, None],
        obj.hulls or (None,) * len(obj.box_pos),
    )
    for center, turn, half, soft, hull in zip(obj.box_pos, matrices, obj.box_half, soft_boxes(obj), hulls, strict=True):
        around = np.maximum(np.abs((middle - center) @ turn) - half, 0.0)
        near = np.flatnonzero(_squared(around) < bound)
        if not len(near):
            continue
        if hull is None:
            first, last = (segment[near, 0] - center) @ turn, (segment[near, 1] - center) @ turn
            beyond = np.abs(first[:, None] + shares * (last - first)[:, None]) - half  # (n, S, 3)
            inside = np.maximum(np.maximum(beyond[..., 0], beyond[..., 1]), beyond[..., 2])
            distance = np.sqrt(_squared(np.maximum(beyond, 0.0))) + np.minimum(inside, 0.0)
        else:  # of the convex piece itself; outside, the distance from its nearest plane is at most the true one
            first, last = segment[near, 0, None], segment[near, 1, None]
            planes = ConvexHull(hull).equations
            distance = ((first + shares * (last - first)) @ planes[:, :3].T + planes[:, 3]).max(-1)
        depth = radius[near] - distance.min(-1)
        worst[bool(soft)] = max(worst[bool(soft)], float(depth.max()))
        seat = max(seat, float(depth[pelvis[near]].max(initial=0.0)))
    return Depths(worst[False], worst[True], seat, moving)


def _squared(vectors: np.ndarray) -> np.ndarray:
    """Squared lengths (...) of vectors (..., 3); NumPy sums over so short an axis are slow."""
    return vectors[..., 0] ** 2 + vectors[..., 1] ** 2 + vectors[..., 2] ** 2
