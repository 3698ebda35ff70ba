"""Lying on a sofa (LS): navigate, locate, and stably lie on a fixed, unseen sofa."""

from mimicbench.robots.rigs import PELVIS_RIG
from mimicbench.tasks.berth import berth
from mimicbench.tasks.task import Array, BodyPoints, ObjectInfo, Shortfall, Task

PELVIS_BAND = 0.4
"""[m] The pelvis is on the sofa while its height lies in [H, H + 0.4] (appendix D.1)."""


def pelvis_on_sofa_and_ankles_up(body: BodyPoints, obj: ObjectInfo) -> Array:
    """(N,) whether the root is on the sofa and both ankles are above half of the sofa's height."""
    half = 0.5 * obj.high[:, 2]
    return obj.on_plane(body.pelvis_pos_w, PELVIS_BAND) & (body.ankle_pos_w[..., 2] > half[:, None]).all(-1)


TASK = Task(
    name="lie-sofa",
    abbreviation="LS",
    title="Lie on a sofa",
    action="lying down",
    family="couch",
    time_limit=20.0,
    hold_time=0.3,
    holds=pelvis_on_sofa_and_ankles_up,
    shortfalls=(
        Shortfall("pelvis {} beside the sofa", lambda body, obj: obj.beside(body.pelvis_pos_w)),
        Shortfall("pelvis {} too high", lambda body, obj: body.pelvis_pos_w[:, 2] - obj.seat_height - PELVIS_BAND),
        Shortfall("pelvis {} too low", lambda body, obj: obj.seat_height - body.pelvis_pos_w[:, 2]),
        Shortfall("an ankle {} too low", lambda body, obj: 0.5 * obj.high[:, 2] - body.ankle_pos_w[..., 2].min(-1)),
    ),
    goal=berth(window=3.6, near=0.9),
    in_last_frame=False,
    requires_seat=True,
    upright=False,
    max_start_distance=2.0,
    rig=PELVIS_RIG,
    map_cell=0.04,
)
