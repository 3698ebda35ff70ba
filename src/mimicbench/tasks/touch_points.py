"""Touching points near an object (T): move both wrists to targets from where an unseen household object can be
handled.
"""

from functools import partial

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.objects.shape import SceneObject
from mimicbench.objects.touch import WRIST_OFF
from mimicbench.robots.rigs import HEAD_RIG
from mimicbench.tasks.goal import Field, GoalSpec
from mimicbench.tasks.task import Array, BodyPoints, ObjectInfo, Shortfall, Task

REACHED = 0.1
"""[m] A wrist is at its target while it is no farther away than this (appendix D.1)."""
WIDE = 0.1
"""[m] What nobody has seen reaches so far beyond what is to be touched."""
LOWEST = 0.1
"""[m] And at least so high above the floor."""


def wrists_at_targets(body: BodyPoints, obj: ObjectInfo) -> Array:
    """(N,) whether all wrists that have targets are within 0.1 m of them."""
    away = ((body.wrist_pos_w - obj.wrist_goal_w) ** 2).sum(-1)
    nowhere = away != away  # a hand without a target, whose distance is not a number
    return ((away <= REACHED * REACHED) | nowhere).all(-1) & ~nowhere.all(-1)


def _away(side: int, body: BodyPoints, obj: ObjectInfo) -> np.ndarray:
    """(N,) by how much a wrist is farther from its target than it may be [m]; NaN without a target."""
    return np.linalg.norm(body.wrist_pos_w[:, side] - obj.wrist_goal_w[:, side], axis=-1) - REACHED


def touchable(goal: np.ndarray, room: np.ndarray) -> SceneObject:
    """A block in a room (2, 2) [m] that is taken, as high as the hands may come down on it at both places (6,)."""
    wrists = goal.reshape(2, 3)
    points = wrists - [0.0, 0.0, WRIST_OFF]
    low, high = np.minimum(room[0], points[:, :2].min(0) - WIDE), np.maximum(room[1], points[:, :2].max(0) + WIDE)
    high[0] = max(room[1, 0], float(points[:, 0].max()))  # who touches it stands before it
    top = max(LOWEST, float(points[:, 2].min()))
    block = np.array([[*(low + high) / 2, top / 2]]), np.array([[*(high - low) / 2, top / 2]])
    grey, up = np.full((1, 3), 0.6), np.tile([0.0, 0.0, 1.0], (2, 1))
    return SceneObject(
        "stand-in",
        "stand-in",
        "household",
        block[0],
        rot.IDENTITY[None],
        block[1],
        grey,
        touch_points=points,
        touch_normals=up,
    )


TASK = Task(
    name="touch-points",
    abbreviation="T",
    title="Touch points near an object",
    action="reaching",
    family="household",
    time_limit=10.0,
    hold_time=1.0,
    holds=wrists_at_targets,
    shortfalls=(
        Shortfall("left wrist {} too far from its target", partial(_away, 0)),
        Shortfall("right wrist {} too far from its target", partial(_away, 1)),
    ),
    goal=GoalSpec(
        fields=(
            Field("left wrist", "point", noise=0.0, spread=0.3),
            Field("right wrist", "point", noise=0.0, spread=0.3),
        ),
        describe=None,
        stand_in=touchable,
    ),
    in_last_frame=False,
    requires_seat=False,
    upright=False,
    max_start_distance=None,
    wrist_goals=True,
    rig=HEAD_RIG,
    map_cell=0.01,
)
