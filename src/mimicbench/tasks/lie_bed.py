"""Lying on a bed (LB): navigate, locate, and stably lie on a fixed, unseen bed."""

from mimicbench.robots.rigs import PELVIS_RIG
from mimicbench.tasks.task import Array, BodyPoints, ObjectInfo, Task

BODY_BAND = 0.4
"""[m] A joint is on the bed while its height lies in [H, H + 0.4] (appendix D.1)."""


def pelvis_and_ankles_on_bed(body: BodyPoints, obj: ObjectInfo) -> Array:
    """(N,) whether root and both ankles lie in the bed's interior in the bird-eye view, at heights in [H, H + 0.4
    m].
    """
    left, right = body.ankle_pos_w[:, 0], body.ankle_pos_w[:, 1]
    return obj.on_plane(body.pelvis_pos_w, BODY_BAND) & obj.on_plane(left, BODY_BAND) & obj.on_plane(right, BODY_BAND)


TASK = Task(
    name="lie-bed",
    abbreviation="LB",
    title="Lie on a bed",
    action="lying down",
    family="bed",
    time_limit=20.0,
    hold_time=0.3,
    holds=pelvis_and_ankles_on_bed,
    in_last_frame=False,
    requires_seat=True,
    upright=False,
    max_start_distance=2.0,
    rig=PELVIS_RIG,
    map_cell=0.04,
)
