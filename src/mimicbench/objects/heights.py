"""How high an object is under a vertical line, exactly, from its boxes."""

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.objects.shape import SceneObject


def surface_height(obj: SceneObject, xy: np.ndarray) -> np.ndarray:
    """Height (...) of the highest surface above the floor under the points (..., 2) [m], 0 where the object is not.

    A vertical line meets a box where |a + z e| <= half for all three axes, with `a` the point at z = 0 and `e` the
    vertical in the box's frame; the highest such z over all boxes is the answer.
    """
    height = np.zeros(xy.shape[:-1])
    for pos, rotation, half in zip(obj.box_pos, rot.to_matrix(obj.box_quat), obj.box_half, strict=True):
        ground = np.concatenate([xy - pos[:2], np.full((*xy.shape[:-1], 1), -pos[2])], -1)
        a, e = ground @ rotation, rotation[2]
        low, high = np.full(height.shape, -np.inf), np.full(height.shape, np.inf)
        for axis in range(3):
            if abs(e[axis]) < 1e-9:
                low = np.where(abs(a[..., axis]) <= half[axis], low, np.inf)
            else:
                ends = (-half[axis] - a[..., axis]) / e[axis], (half[axis] - a[..., axis]) / e[axis]
                low, high = np.maximum(low, np.minimum(*ends)), np.minimum(high, np.maximum(*ends))
        height = np.where((high >= low) & (high > height), high, height)
    return height
