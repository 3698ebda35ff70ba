"""The goal of tasks that sit down: a seat, as a robot finds it."""

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadObject
from mimicbench.objects.shape import SceneObject
from mimicbench.tasks.around import extent
from mimicbench.tasks.goal import Field, GoalSpec

HALF_WIDTH = 0.25
"""[m] Of a seat that nothing is known of but where its middle is."""


def describe_seat(obj: SceneObject) -> np.ndarray:
    """(6,) the middle of the seat, which faces +x, its height and its depth, front to back. Raises BadObject."""
    height = obj.require_seat()
    if not len(obj.seat_polygon):
        raise BadObject(f"object {obj.id} has no outline of its seat; describe it in seat_polygon")
    low, high = obj.seat_polygon.min(0), obj.seat_polygon.max(0)
    return np.array([*(low + high) / 2, 0.0, 1.0, height, high[0] - low[0]])


def seat_like(goal: np.ndarray, around: np.ndarray) -> tuple[SceneObject]:
    """A block with such a seat, for one, as large as what rises around it (M, 3) [m]."""
    room = extent(around)
    height, depth = goal[4], goal[5]
    half = np.array([depth / 2, HALF_WIDTH])
    low, high = np.minimum(room[0], -half), np.maximum(room[1], half)
    high[0] = half[0]  # who sits there puts the feet in front of it
    block = np.array([[*(low + high) / 2, height / 2]]), np.array([[*(high - low) / 2, height / 2]])
    polygon = half * [[1, -1], [1, 1], [-1, 1], [-1, -1]]
    grey = np.full((1, 3), 0.6)
    return (SceneObject("stand-in", "stand-in", "seat", block[0], rot.IDENTITY[None], block[1], grey, height, polygon),)


def seat(window: float) -> GoalSpec:
    """Goals for seats on objects that fit into a window [m]."""
    return GoalSpec(
        fields=(
            Field("middle", "place", noise=0.03, spread=0.1),
            Field("front", "direction", noise=0.05, spread=0.4),
            Field("height", "scalar", noise=0.012, spread=0.05, middle=0.45),
            Field("depth", "scalar", noise=0.03, spread=0.06, middle=0.45),
        ),
        describe=describe_seat,
        window=window,
        stand_ins=seat_like,
    )
