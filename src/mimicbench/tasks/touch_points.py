"""Touching points near an object (T): move both wrists to targets from where an unseen household object can be
handled.
"""

from functools import partial

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.objects.shape import SceneObject
from mimicbench.objects.touch import WRIST_OFF
from mimicbench.robots.rigs import HEAD_RIG
from mimicbench.tasks.around import extent
from mimicbench.tasks.goal import Field, GoalSpec
from mimicbench.tasks.task import Array, BodyPoints, ObjectInfo, Shortfall, Task

REACHED = 0.1
"""[m] A wrist is at its target while it is no farther away than this (appendix D.1)."""
WIDE = 0.1
"""[m] What nobody has seen reaches so far beyond what is to be touched."""
THIN = 0.02
"""[m] Half of what is between the hands, at least."""
DEEP, BROAD, HIGH, FAR = 0.145, 0.065, 0.12, 0.295
"""[m] Halves of how far places of both hands may be apart front to back, must be left to right, may be in height, and
in all (objects.touch)."""
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


def touchable(goal: np.ndarray, around: np.ndarray) -> tuple[SceneObject, ...]:
    """Blocks up to below both places (6,): one as wide as what rises around them (M, 3) [m], on which hands come down;
    a narrow one between them; and one that leaves free what is before them, where it would be too far to reach.
    """
    room = extent(around)
    wrists = _within_reach(goal.reshape(2, 3))
    low, high = np.minimum(room[0], wrists[:, :2].min(0) - WIDE), np.maximum(room[1], wrists[:, :2].max(0) + WIDE)
    front = float(wrists[:, 0].max())
    high[0] = max(room[1, 0], front)  # who touches it stands before it
    middle, half = wrists[:, 1].mean(), max(THIN, float(np.ptp(wrists[:, 1])) / 2 - WIDE)
    sides = middle - half, middle + half
    up, aside = np.tile([0.0, 0.0, 1.0], (2, 1)), np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
    return (
        _block(wrists, up, low, high),
        _block(wrists, aside, np.array([low[0], sides[0]]), np.array([high[0], sides[1]])),
        _block(wrists, aside, np.array([low[0], sides[0]]), np.array([front, sides[1]])),
    )


def _within_reach(wrists: np.ndarray) -> np.ndarray:
    """Wrists (2, 3) [m] at most as far apart as a pair may be, and at least: as seen by who comes from aside, they may
    seem to be a little more, or less.
    """
    middle, half = wrists.mean(0), (wrists[1] - wrists[0]) / 2
    half = np.clip(half, [-DEEP, BROAD, -HIGH], [DEEP, np.inf, HIGH])
    half *= min(1.0, FAR / float(np.linalg.norm(half)))
    return np.stack([middle - half, middle + half])


def _block(wrists: np.ndarray, normals: np.ndarray, low: np.ndarray, high: np.ndarray) -> SceneObject:
    """Between two corners (2,) as seen from above [m], up to below the wrists (2, 3) that touch along normals."""
    top = max(LOWEST, float(wrists[:, 2].min()) - WRIST_OFF)
    pos, half = np.array([[*(low + high) / 2, top / 2]]), np.array([[*(high - low) / 2, top / 2]])
    grey, points = np.full((1, 3), 0.6), wrists - WRIST_OFF * normals
    named = "stand-in", "stand-in", "household"
    return SceneObject(*named, pos, rot.IDENTITY[None], half, grey, touch_points=points, touch_normals=normals)


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
        stand_ins=touchable,
    ),
    in_last_frame=False,
    requires_seat=False,
    upright=False,
    max_start_distance=None,
    wrist_goals=True,
    rig=HEAD_RIG,
    map_cell=0.01,
)
