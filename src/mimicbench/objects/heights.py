"""How high an object is under a vertical line, exactly, from its boxes; and the object lower or higher than it is."""

from dataclasses import replace

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


def with_heights(obj: SceneObject, factor: float) -> SceneObject:
    """The object with all of its heights so many times as large, and nothing else; what is tilted keeps its tilt."""
    times = np.array([1.0, 1.0, factor])
    # how much of a box's own sides (B, 3) is upright
    upright = rot.rotate_inverse(obj.box_quat, np.array([0.0, 0.0, 1.0])) ** 2
    return replace(
        obj,
        id=f"{obj.id}~h{factor:.4f}",
        box_pos=obj.box_pos * times,
        box_half=obj.box_half * np.sqrt(1.0 + upright * (factor**2 - 1.0)),
        seat_height=None if obj.seat_height is None else obj.seat_height * factor,
        touch_points=obj.touch_points * times,
        hulls=tuple(hull * times for hull in obj.hulls),
    )
