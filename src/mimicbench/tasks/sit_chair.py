"""Sitting on a chair (SC): navigate, locate, and stably sit on a fixed, unseen chair."""

from mimicbench.robots.rigs import PELVIS_RIG
from mimicbench.tasks.seat import seat
from mimicbench.tasks.task import Array, BodyPoints, ObjectInfo, Shortfall, Task

PELVIS_BAND = 0.27
"""[m] The pelvis frame is above the seat while its height lies in [H, H + 0.27] (appendix D.1)."""


def pelvis_above_seat(body: BodyPoints, obj: ObjectInfo) -> Array:
    """(N,) whether the root lies in the object's interior in the bird-eye view, at a height in [H, H + 0.27 m]."""
    return obj.on_plane(body.pelvis_pos_w, PELVIS_BAND)


SHORTFALLS = (
    Shortfall("pelvis {} beside the seat", lambda body, obj: obj.beside(body.pelvis_pos_w)),
    Shortfall("pelvis {} too high", lambda body, obj: body.pelvis_pos_w[:, 2] - obj.seat_height - PELVIS_BAND),
    Shortfall("pelvis {} too low", lambda body, obj: obj.seat_height - body.pelvis_pos_w[:, 2]),
)

TASK = Task(
    name="sit-chair",
    abbreviation="SC",
    title="Sit on a chair",
    action="sitting down",
    family="chair",
    time_limit=20.0,
    hold_time=0.3,
    holds=pelvis_above_seat,
    shortfalls=SHORTFALLS,
    goal=seat(window=1.92),
    in_last_frame=False,
    requires_seat=True,
    upright=True,
    max_start_distance=2.0,
    rig=PELVIS_RIG,
    map_cell=0.04,
    height_weight=100.0,
)
