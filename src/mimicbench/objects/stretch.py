"""Objects of other proportions than those that are made."""

from dataclasses import replace

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.objects.shape import SceneObject


def stretched(obj: SceneObject, object_id: str, factors: np.ndarray) -> SceneObject:
    """The object so many times (3,) as long, wide and high, and as heavy as it was; what is tilted keeps its tilt."""
    # each side of a box grows as much as its direction does
    sides = np.sqrt(((rot.to_matrix(obj.box_quat) * factors[:, None]) ** 2).sum(1))
    return replace(
        obj,
        id=object_id,
        box_pos=obj.box_pos * factors,
        box_half=obj.box_half * sides,
        seat_height=None if obj.seat_height is None else obj.seat_height * float(factors[2]),
        seat_polygon=obj.seat_polygon * factors[:2],
        head_xy=obj.head_xy * factors[: len(obj.head_xy)],
        touch_points=obj.touch_points * factors,
        hulls=tuple(hull * factors for hull in obj.hulls),
    )
