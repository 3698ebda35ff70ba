"""Lying on a bed (LB): navigate, locate, and stably lie on a fixed, unseen bed."""

from collections.abc import Callable

import numpy as np

from mimicbench.robots.rigs import PELVIS_RIG
from mimicbench.tasks.berth import berth
from mimicbench.tasks.task import Array, BodyPoints, ObjectInfo, Shortfall, Task

BODY_BAND = 0.4
"""[m] A joint is on the bed while its height lies in [H, H + 0.4] (appendix D.1)."""


def pelvis_and_ankles_on_bed(body: BodyPoints, obj: ObjectInfo) -> Array:
    """(N,) whether root and both ankles lie in the bed's interior in the bird-eye view, at heights in [H, H + 0.4
    m].
    """
    left, right = body.ankle_pos_w[:, 0], body.ankle_pos_w[:, 1]
    return obj.on_plane(body.pelvis_pos_w, BODY_BAND) & obj.on_plane(left, BODY_BAND) & obj.on_plane(right, BODY_BAND)


def _beside(pos_w: np.ndarray, obj: ObjectInfo) -> np.ndarray:
    return obj.beside(pos_w)


def _above(pos_w: np.ndarray, obj: ObjectInfo) -> np.ndarray:
    return pos_w[:, 2] - obj.seat_height - BODY_BAND


def _below(pos_w: np.ndarray, obj: ObjectInfo) -> np.ndarray:
    return obj.seat_height - pos_w[:, 2]


def _worse(measure: Callable[[np.ndarray, ObjectInfo], np.ndarray], body: BodyPoints, obj: ObjectInfo) -> np.ndarray:
    """(N,) of the ankle of which it is more."""
    return np.maximum(measure(body.ankle_pos_w[:, 0], obj), measure(body.ankle_pos_w[:, 1], obj))


TASK = Task(
    name="lie-bed",
    abbreviation="LB",
    title="Lie on a bed",
    action="lying down",
    family="bed",
    time_limit=20.0,
    hold_time=0.3,
    holds=pelvis_and_ankles_on_bed,
    shortfalls=(
        Shortfall("pelvis {} beside the bed", lambda body, obj: _beside(body.pelvis_pos_w, obj)),
        Shortfall("pelvis {} too high", lambda body, obj: _above(body.pelvis_pos_w, obj)),
        Shortfall("pelvis {} too low", lambda body, obj: _below(body.pelvis_pos_w, obj)),
        Shortfall("an ankle {} beside the bed", lambda body, obj: _worse(_beside, body, obj)),
        Shortfall("an ankle {} too high", lambda body, obj: _worse(_above, body, obj)),
        Shortfall("an ankle {} too low", lambda body, obj: _worse(_below, body, obj)),
    ),
    goal=berth(window=3.6, near=1.3),
    in_last_frame=False,
    requires_seat=True,
    upright=False,
    max_start_distance=2.0,
    rig=PELVIS_RIG,
    map_cell=0.04,
    rest=5.0,  # trunks come down after 2.5 s, hands and legs a second later
)
