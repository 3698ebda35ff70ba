"""One picture of the documents: what it shows, and how to tell that it shows something else by now."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mimicbench.core.motion import HumanMotion, RobotMotion
from mimicbench.core.seeds import rng
from mimicbench.objects.shape import SceneObject

CHANGED = 2e-3
"""A number of a fingerprint that is farther off tells of another content: far above what machines round differently."""
Fingerprint = list[list[float]]
Clip = tuple[HumanMotion, SceneObject]


@dataclass(frozen=True)
class DocPicture:
    """One picture."""

    name: str
    """Its file in docs/images."""
    make: Callable[[], Any]
    """What it shows, made anew."""
    arrays: Callable[[Any], Sequence[np.ndarray]]
    """That as numbers."""
    draw: Callable[[Any], np.ndarray]
    """(H, W, 3), uint8."""


def fingerprint(arrays: Sequence[np.ndarray]) -> Fingerprint:
    """Of each array its size and three weighted sums."""
    found = []
    for array in arrays:
        values = np.asarray(array, float).ravel()
        weights = rng(0, "fingerprint", values.size).normal(size=(3, values.size)) / max(1.0, np.sqrt(values.size))
        found.append([float(values.size), *np.round(weights @ values, 4).tolist()])
    return found


def same(now: Fingerprint, then: Fingerprint | None) -> bool:
    """Whether two fingerprints are of one content, but for rounding."""
    return (
        then is not None
        and len(now) == len(then)
        and all(len(a) == len(b) and np.abs(np.subtract(a, b)).max() <= CHANGED for a, b in zip(now, then, strict=True))
    )


def of_objects(objects: Sequence[SceneObject]) -> list[np.ndarray]:
    """What is drawn of objects."""
    return [
        np.concatenate([part.ravel() for part in (obj.box_pos, obj.box_quat, obj.box_half, obj.box_rgb, *obj.hulls)])
        for obj in objects
    ]


def of_clips(clips: Sequence[Clip]) -> list[np.ndarray]:
    """What is drawn of people on objects."""
    return [array for motion, obj in clips for array in (*_of_motion(motion), *of_objects([obj]))]


def of_robots(motions: Sequence[RobotMotion]) -> list[np.ndarray]:
    """What is drawn of robots."""
    return [np.concatenate([motion.root_pos_w.ravel(), motion.joint_pos.ravel()]) for motion in motions]


def _of_motion(motion: HumanMotion) -> list[np.ndarray]:
    pos, _ = motion.forward_kinematics()  # signs and twists of rotations that nobody sees do not count
    return [np.concatenate([pos.ravel(), motion.object_pos_w.ravel()]), np.nan_to_num(motion.wrist_goal_w)]
