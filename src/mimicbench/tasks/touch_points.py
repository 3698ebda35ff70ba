"""Touching points near an object (T): move both wrists to targets from where an unseen household object can be
handled.
"""

from mimicbench.robots.rigs import HEAD_RIG
from mimicbench.tasks.task import Array, BodyPoints, ObjectInfo, Task

REACHED = 0.1
"""[m] A wrist is at its target while it is no farther away than this (appendix D.1)."""


def wrists_at_targets(body: BodyPoints, obj: ObjectInfo) -> Array:
    """(N,) whether all wrists that have targets are within 0.1 m of them."""
    away = ((body.wrist_pos_w - obj.wrist_goal_w) ** 2).sum(-1)
    nowhere = away != away  # a hand without a target, whose distance is not a number
    return ((away <= REACHED * REACHED) | nowhere).all(-1) & ~nowhere.all(-1)


TASK = Task(
    name="touch-points",
    abbreviation="T",
    title="Touch points near an object",
    action="reaching",
    family="household",
    time_limit=10.0,
    hold_time=1.0,
    holds=wrists_at_targets,
    in_last_frame=False,
    requires_seat=False,
    upright=True,
    max_start_distance=None,
    wrist_goals=True,
    rig=HEAD_RIG,
    map_cell=0.01,
)
