"""Where an object's surface is: signed distances to it, and the way out."""

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.objects.shape import SceneObject


def signed_distance(obj: SceneObject, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far points are from the surface of the nearest box, negative inside, and the unit normal there.

    Args:
        obj: the object; imported ones are taken for their boxes.
        points: (M, 3) in the object's frame [m].

    Returns:
        Distances (M,) [m] and normals (M, 3), the gradient of the distance, in the object's frame.
    """
    turn = rot.to_matrix(obj.box_quat)  # (B, 3, 3)
    best, normal = np.full(len(points), np.inf), np.zeros((len(points), 3))
    each = np.arange(len(points))
    for center, matrix, half in zip(obj.box_pos, turn, obj.box_half, strict=True):
        local = (points - center) @ matrix
        beyond = np.abs(local) - half
        outside = np.maximum(beyond, 0.0)
        away = np.sqrt((outside**2).sum(-1))
        axis = beyond.argmax(-1)
        distance = away + np.minimum(beyond[each, axis], 0.0)
        nearer = distance < best
        if not nearer.any():
            continue
        best[nearer] = distance[nearer]
        # outside, away from the nearest point; inside, through the nearest face
        way = np.zeros((int(nearer.sum()), 3))
        way[np.arange(len(way)), axis[nearer]] = 1.0
        off = away[nearer] > 1e-9
        way[off] = outside[nearer][off] / away[nearer][off, None]
        normal[nearer] = (way * np.where(local[nearer] < 0, -1.0, 1.0)) @ matrix.T
    return best, normal
