"""The goal of tasks that lie down: a place to lie on, as a robot finds it."""

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadObject
from mimicbench.objects.shape import SceneObject
from mimicbench.tasks.goal import Field, GoalSpec

HEAD_ROOM = 0.24
"""[m] Between the head's middle and the end where it goes, where nothing is known of a pillow."""

RIM = 0.15
"""[m] What is around it, and lower, is at most so wide: more of it is not in the way of who sits down."""
MATTRESS = 0.2
"""[m] So far below what one lies on that is."""


def describe_berth(obj: SceneObject) -> np.ndarray:
    """(9,) its middle, its front, which is +x, the direction from there to the end where the head goes, its height, how
    long it is in that direction, and how wide. Raises BadObject.
    """
    height = obj.require_seat()
    if not len(obj.seat_polygon):
        raise BadObject(f"object {obj.id} has no outline of what one lies on; describe it in seat_polygon")
    if not len(obj.head_xy):
        raise BadObject(f"object {obj.id} does not say where the head goes; describe it in head_xy")
    low, high = obj.seat_polygon.min(0), obj.seat_polygon.max(0)
    middle, sides = (low + high) / 2, high - low
    away = (obj.head_xy - middle) / sides
    along = int(np.argmax(np.abs(away)))
    head = np.zeros(2)
    head[along] = np.sign(away[along])
    return np.array([*middle, 0.0, 1.0, head[1], head[0], height, sides[along], sides[1 - along]])


def berth_like(goal: np.ndarray, room: np.ndarray) -> tuple[SceneObject]:
    """A block with such a place to lie on, and around it, lower, what else is taken of a room (2, 2) [m]: the rim of a
    platform, the arms of a sofa.
    """
    head, (height, length, width) = goal[[5, 4]], goal[6:9]
    along = int(np.argmax(np.abs(head)))
    half = np.array([length, width])[[along, 1 - along]] / 2
    polygon = half * [[1, -1], [1, 1], [-1, 1], [-1, -1]]
    towards = np.sign(head[along]) * np.eye(2)[along]
    low, high = np.clip(room[0], -half - RIM, -half), np.clip(room[1], half, half + RIM)
    top = max(height - MATTRESS, 0.05)
    middles = np.array([[0.0, 0.0, height / 2], [*(low + high) / 2, top / 2]])
    halves = np.array([[*half, height / 2], [*(high - low) / 2, top / 2]])
    grey = np.full((2, 3), 0.6)
    return (
        SceneObject(
            "stand-in",
            "stand-in",
            "berth",
            middles,
            np.tile(rot.IDENTITY, (2, 1)),
            halves,
            grey,
            height,
            polygon,
            towards * (half[along] - HEAD_ROOM),
        ),
    )


def berth(window: float, near: float) -> GoalSpec:
    """Goals for what one lies on, of objects that fit into a window [m], whose front is less than `near` [m] from the
    middle.
    """
    return GoalSpec(
        fields=(
            Field("middle", "place", noise=0.04, spread=0.2),
            Field("front", "direction", noise=0.05, spread=0.4),
            Field("head", "direction", noise=0.05, spread=0.4),
            Field("height", "scalar", noise=0.012, spread=0.05, middle=0.45),
            Field("length", "scalar", noise=0.05, spread=0.2, middle=1.9),
            Field("width", "scalar", noise=0.05, spread=0.3, middle=1.0),
        ),
        describe=describe_berth,
        window=window,
        near=near,
        stand_ins=berth_like,
    )
