"""Where an object's surface is: signed distances to it, and the way out."""

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.objects.shape import SceneObject

_STEP = 1e-3
"""[m] Beyond a face there is a way out if so far in front of it there is no other box, nor the floor."""


def signed_distance(obj: SceneObject, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far points are from the object's surface, negative inside, and the unit normal there.

    Inside it is the shortest way along a box's axes that leads out of all boxes, and not into the floor: a mattress is
    left upwards, not into the frame under it.

    Args:
        obj: the object; imported ones are taken for their boxes.
        points: (M, 3) in the object's frame [m].

    Returns:
        Distances (M,) [m] and normals (M, 3), the gradient of the distance, in the object's frame.
    """
    turns = rot.to_matrix(obj.box_quat)
    # first which box is nearest, coordinate by coordinate, for that is three times as fast; then the rest for that box
    # alone
    at, squared, nearest = np.ascontiguousarray(points.T), np.full(len(points), np.inf), np.zeros(len(points), int)
    for box, (center, turn, half) in enumerate(zip(obj.box_pos, turns, obj.box_half, strict=True)):
        x, y, z = np.maximum(np.abs(turn.T @ (at - center[:, None])) - half[:, None], 0.0)
        away = x * x + y * y + z * z
        nearer = away < squared
        np.copyto(squared, away, where=nearer)
        np.copyto(nearest, box, where=nearer)
    best, turn = np.sqrt(squared), turns[nearest]
    local = np.einsum("mi,mij->mj", points - obj.box_pos[nearest], turn)
    outside = np.maximum(np.abs(local) - obj.box_half[nearest], 0.0)
    way = outside / np.maximum(best, 1e-12)[:, None] * np.where(local < 0, -1.0, 1.0)
    normal = np.einsum("mij,mj->mi", turn, way)
    inside = np.flatnonzero(best < 1e-9)
    if len(inside):
        best[inside], normal[inside] = _way_out(obj, turns, points[inside])
    return best, normal


def box_distance(obj: SceneObject, points: np.ndarray, boxes: np.ndarray | slice = slice(None)) -> np.ndarray:
    """Signed distance (...) [m] of points (..., 3) from the nearest of the object's boxes, or of some of them.

    Inside, how deep in one box.

    Quicker than `signed_distance`, which also knows the way out of boxes that touch each other.
    """
    turns, half = rot.to_matrix(obj.box_quat[boxes]), obj.box_half[boxes]
    # one matrix product takes all points into the frames of all boxes
    turn = turns.transpose(1, 2, 0).reshape(3, -1)
    offset = np.einsum("bij,bi->jb", turns, obj.box_pos[boxes])
    local = (points.reshape(-1, 3) @ turn).reshape(-1, 3, len(half)) - offset
    x, y, z = np.abs(local).transpose(1, 0, 2) - half.T[:, None]
    outside = np.sqrt(np.maximum(x, 0) ** 2 + np.maximum(y, 0) ** 2 + np.maximum(z, 0) ** 2)
    inside = np.minimum(np.maximum(np.maximum(x, y), z), 0)
    return (outside + inside).min(-1).reshape(points.shape[:-1])


def _way_out(obj: SceneObject, turns: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances (M,), not positive, and normals (M, 3) of points inside the object."""
    free, blocked = np.full(len(points), -np.inf), np.full(len(points), -np.inf)
    free_way, blocked_way = np.zeros((len(points), 3)), np.zeros((len(points), 3))
    for center, turn, half in zip(obj.box_pos, turns, obj.box_half, strict=True):
        local = (points - center) @ turn
        within = np.flatnonzero((np.abs(local) <= half + 1e-9).all(-1))
        if not len(within):
            continue
        for axis in range(3):
            for sign in (1.0, -1.0):
                depth = sign * local[within, axis] - half[axis]  # negative
                way = sign * turn[:, axis]
                out = points[within] + (_STEP - depth)[:, None] * way
                closed = out[:, 2] < 0
                for other, other_turn, other_half in zip(obj.box_pos, turns, obj.box_half, strict=True):
                    closed |= (np.abs((out - other) @ other_turn) <= other_half).all(-1)
                for best, ways, take in ((free, free_way, ~closed), (blocked, blocked_way, closed)):
                    take = take & (depth > best[within])
                    best[within[take]], ways[within[take]] = depth[take], way
    nowhere = ~np.isfinite(free)
    return np.where(nowhere, blocked, free), np.where(nowhere[:, None], blocked_way, free_way)
