"""Touching points near an object (T): move both wrists to targets from where an unseen household object can be
handled.
"""

from functools import partial

import numpy as np

from mimicbench.robots.rigs import HEAD_RIG
from mimicbench.tasks.goal import Field, GoalSpec
from mimicbench.tasks.task import Array, BodyPoints, ObjectInfo, Shortfall, Task

REACHED = 0.1
"""[m] A wrist is at its target while it is no farther away than this (appendix D.1)."""


def wrists_at_targets(body: BodyPoints, obj: ObjectInfo) -> Array:
    """(N,) whether all wrists that have targets are within 0.1 m of them."""
    away = ((body.wrist_pos_w - obj.wrist_goal_w) ** 2).sum(-1)
    nowhere = away != away  # a hand without a target, whose distance is not a number
    return ((away <= REACHED * REACHED) | nowhere).all(-1) & ~nowhere.all(-1)


def _away(side: int, body: BodyPoints, obj: ObjectInfo) -> np.ndarray:
    """(N,) by how much a wrist is farther from its target than it may be [m]; NaN without a target."""
    return np.linalg.norm(body.wrist_pos_w[:, side] - obj.wrist_goal_w[:, side], axis=-1) - REACHED


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
    ),
    in_last_frame=False,
    requires_seat=False,
    upright=False,
    max_start_distance=None,
    wrist_goals=True,
    rig=HEAD_RIG,
    map_cell=0.01,
)
