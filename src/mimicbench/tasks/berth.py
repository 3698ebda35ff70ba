"""The goal of tasks that lie down: a place to lie on, as a robot finds it."""

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadObject
from mimicbench.objects.shape import SceneObject
from mimicbench.tasks.around import extent
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


WALL = 0.15
"""[m] What rises higher above what one lies on stands in the way of who lies; and how thick that is taken to be."""


def berth_like(goal: np.ndarray, around: np.ndarray) -> tuple[SceneObject]:
    """A block with such a place to lie on, and of what rises around it (M, 3) [m]: lower, the rim of a platform; above,
    the back and the arms of a sofa, the boards of a bed.
    """
    room, head, (height, length, width) = extent(around), goal[[5, 4]], goal[6:9]
    along = int(np.argmax(np.abs(head)))
    half = np.array([length, width])[[along, 1 - along]] / 2
    polygon = half * [[1, -1], [1, 1], [-1, 1], [-1, -1]]
    towards = np.sign(head[along]) * np.eye(2)[along]
    low, high = np.clip(room[0], -half - RIM, -half), np.clip(room[1], half, half + RIM)
    top = max(height - MATTRESS, 0.05)
    walls = _walls(half, along, height, around)
    lows = np.array([[*-half, 0.0], [*low, 0.0], *(wall[0] for wall in walls)])
    highs = np.array([[*half, height], [*high, top], *(wall[1] for wall in walls)])
    return (
        SceneObject(
            "stand-in",
            "stand-in",
            "berth",
            (lows + highs) / 2,
            np.tile(rot.IDENTITY, (len(lows), 1)),
            (highs - lows) / 2,
            np.full((len(lows), 3), 0.6),
            height,
            polygon,
            towards * (half[along] - HEAD_ROOM),
        ),
    )


def _walls(half: np.ndarray, along: int, height: float, around: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Lowest and highest corners (3,) of what stands at the edges of a place to lie on, of half the size (2,), at both
    of its ends and behind it. A side is closed where half of what lies between its first and its last point is.
    """
    walls = []
    for axis, sign in ((along, 1.0), (along, -1.0), *([(0, -1.0)] if along else [])):
        beyond, beside = sign * around[:, axis] - half[axis], around[:, 1 - axis]
        stands = (np.abs(beyond - 0.1) < 0.25) & (np.abs(beside) < half[1 - axis]) & (around[:, 2] > height + WALL)
        taken = np.unique(np.round(beside[stands] / 0.05))  # no cell of a map is larger
        if len(taken) < 4 or len(taken) < 0.5 * (taken[-1] - taken[0] + 1):
            continue
        first = half[axis] + np.clip(np.percentile(beyond[stands], 10), 0.0, WALL)
        low, high = np.zeros(3), np.zeros(3)
        low[axis], high[axis] = np.sort(sign * np.array([first, first + WALL]))
        low[1 - axis], high[1 - axis] = beside[stands].min(), beside[stands].max()
        high[2] = np.percentile(around[stands, 2], 80)
        walls.append((low, high))
    return walls


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
