"""Lifting a box (L): approach a large, unseen box, clasp it with both arms and lift it from the floor."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.objects.shape import SceneObject
from mimicbench.robots.rigs import HEAD_RIG
from mimicbench.tasks.goal import Field, GoalSpec
from mimicbench.tasks.task import Array, BodyPoints, ObjectInfo, Shortfall, Task

if TYPE_CHECKING:
    from torch import Tensor

LIFT = 0.2
"""[m] How high the middle of the box is to be above where it was (appendix D.1)."""
NEAR = 0.1
"""[m] The wrists hold it while they are no farther from its surface than this (appendix D.1)."""
MASS = 2.5
"""[kg] Of a box that nobody has weighed: the middle of what boxes weigh."""
WIDEST = 0.58
"""[m] Nobody clasps sides farther apart. Those of the widest box that people learn to clasp are 0.57 m apart."""


def rise(obj: ObjectInfo) -> Array:
    """(N,) how much higher the middle of the box is than where it stood [m].

    Its origin is the middle of its base, which rises by half a depth where a box is toppled.
    """
    middle = (obj.low + obj.high) / 2
    return obj.pos_w[:, 2] + rot.rotate(obj.quat_w, middle)[:, 2] - middle[:, 2]


def box_lifted_by_the_wrists(body: BodyPoints, obj: ObjectInfo) -> Array:
    """(N,) whether the box is 0.2 m higher than at the start, with both wrists within 0.1 m of its surface."""
    return (rise(obj) >= LIFT) & obj.within(body.wrist_pos_w, NEAR).all(-1)


def describe_box(obj: SceneObject) -> np.ndarray:
    """(7,) the middle of the box, its front, which is +x, and its half sizes, front to back, left to right, and up."""
    low, high = obj.bounds()
    return np.array([*(low + high)[:2] / 2, 0.0, 1.0, *(high - low) / 2])


def box_like(goal: np.ndarray, around: np.ndarray) -> tuple[SceneObject]:
    """A box of such sizes and of the usual weight."""
    half = goal[4:7]
    pos, quat, grey = np.array([[0.0, 0.0, half[2]]]), rot.IDENTITY[None], np.full((1, 3), 0.6)
    return (SceneObject("stand-in", "stand-in", "box", pos, quat, half[None], grey, movable=True, mass=MASS),)


def from_the_nearer_side(goal: Tensor) -> Tensor:
    """Boxes (N, 7), seen from the origin, with another side for a front where that faces who looks more, and the box
    is narrow enough to be clasped from there: nobody walks around a box that can be lifted from where one stands.
    """
    import torch

    x, y, sine, cosine, depth, width, height = goal.unbind(-1)
    faces, faces_aside = -(cosine * x + sine * y), sine * x - cosine * y
    sign = torch.where(faces_aside < 0, -1.0, 1.0)
    other = torch.stack([x, y, sign * cosine, -sign * sine, width, depth, height], -1)
    nearer = (2 * depth <= WIDEST) & (faces_aside.abs() > faces.abs())
    return torch.where(nearer[:, None], other, goal)


TASK = Task(
    name="lift-box",
    abbreviation="L",
    title="Lift a box",
    action="lifting",
    family="box",
    time_limit=10.0,
    hold_time=0.0,
    holds=box_lifted_by_the_wrists,
    shortfalls=(
        Shortfall("box {} too low", lambda _, obj: LIFT - rise(obj)),
        Shortfall("a wrist {} too far from the box", lambda body, obj: obj.away(body.wrist_pos_w).max(-1) - NEAR),
    ),
    goal=GoalSpec(
        fields=(
            Field("middle", "place", noise=0.03, spread=0.1),
            Field("front", "direction", noise=0.05, spread=0.4),
            Field("half depth", "scalar", noise=0.015, spread=0.04, middle=0.3),
            Field("half width", "scalar", noise=0.015, spread=0.04, middle=0.22),
            Field("half height", "scalar", noise=0.01, spread=0.05, middle=0.44),
        ),
        describe=describe_box,
        stand_ins=box_like,
        taken=from_the_nearer_side,
        window=1.28,
        near=0.75,
    ),
    in_last_frame=True,
    requires_seat=False,
    upright=False,
    max_start_distance=None,
    rig=HEAD_RIG,
    map_cell=0.04,
    moves_object=True,
)
