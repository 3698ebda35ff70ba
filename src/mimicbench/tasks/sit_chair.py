"""Sitting on a chair (SC): navigate, locate, and stably sit on a fixed, unseen chair."""

import numpy as np

from mimicbench.tasks.task import BodyPoints, ObjectFacts, Task

PELVIS_BAND = 0.27
"""[m] The pelvis frame is above the seat while its height lies in [H, H + 0.27] (appendix D.1)."""


def pelvis_above_seat(body: BodyPoints, obj: ObjectFacts) -> np.ndarray:
    """(N,) whether the root lies in the chair's interior in the bird-eye view, at a height in [H, H + 0.27 m]."""
    height = body.pelvis_pos_w[:, 2] - obj.seat_height
    return obj.interior_xy(body.pelvis_pos_w) & (height >= 0) & (height <= PELVIS_BAND)


SIT_CHAIR = Task(
    slug="sit-chair",
    abbreviation="SC",
    title="Sit on a chair",
    family="chair",
    time_limit=20.0,
    hold_time=0.3,
    holds=pelvis_above_seat,
    requires_seat=True,
    max_start_distance=2.0,
)
