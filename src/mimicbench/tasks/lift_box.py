"""Lifting a box (L): approach a large, unseen box, clasp it with both arms and lift it from the floor."""

from mimicbench.robots.rigs import HEAD_RIG
from mimicbench.tasks.task import Array, BodyPoints, ObjectInfo, Task

LIFT = 0.2
"""[m] How high the box is to be above where it stood (appendix D.1)."""
NEAR = 0.1
"""[m] The wrists hold it while they are no farther from its surface than this (appendix D.1)."""


def box_lifted_by_the_wrists(body: BodyPoints, obj: ObjectInfo) -> Array:
    """(N,) whether the box is 0.2 m higher than at the start, with both wrists within 0.1 m of its surface."""
    return (obj.pos_w[:, 2] >= LIFT) & obj.within(body.wrist_pos_w, NEAR).all(-1)


TASK = Task(
    name="lift-box",
    abbreviation="L",
    title="Lift a box",
    action="lifting",
    family="box",
    time_limit=10.0,
    hold_time=0.0,
    holds=box_lifted_by_the_wrists,
    in_last_frame=True,
    requires_seat=False,
    upright=True,
    max_start_distance=None,
    rig=HEAD_RIG,
    map_cell=0.04,
    moves_object=True,
)
