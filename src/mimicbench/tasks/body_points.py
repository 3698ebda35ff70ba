"""The places of a body that the condition of K looks at, of robots and of people."""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.robots.description import Robot

Array = Any  # np.ndarray or torch.Tensor, the same kind throughout


@dataclass(frozen=True)
class BodyPoints:
    """Key positions of the robot, or of a person, in N scenes, world frame [m]."""

    pelvis_pos_w: Array
    """(N, 3) the root."""
    ankle_pos_w: Array
    """(N, 2, 3) left, right."""
    wrist_pos_w: Array
    """(N, 2, 3) left, right."""

    @staticmethod
    def of(robot: Robot, link_pos_w: Array, link_quat_w: Array) -> "BodyPoints":
        """From link poses (N, L, 3) and (N, L, 4); worked out when asked for."""
        return _LinkPoints(robot, link_pos_w, link_quat_w)


class _LinkPoints(BodyPoints):
    """Key positions of a robot's links. Most tasks ask for few of them."""

    _robot: Robot
    _pos_w: Array
    _quat_w: Array

    def __init__(self, robot: Robot, link_pos_w: Array, link_quat_w: Array) -> None:
        vars(self).update(_robot=robot, _pos_w=link_pos_w, _quat_w=link_quat_w)

    @cached_property
    def pelvis_pos_w(self) -> Array:  # type: ignore[override]
        return self._pos_w[:, 0]

    @cached_property
    def ankle_pos_w(self) -> Array:  # type: ignore[override]
        return self._pair("ankle")

    @cached_property
    def wrist_pos_w(self) -> Array:  # type: ignore[override]
        return self._pair("wrist")

    def _pair(self, name: str) -> Array:
        """(N, 2, 3) the keypoints of this name, left and right."""
        pair = (self._robot.keypoints[f"{side}_{name}"] for side in ("left", "right"))
        links, offsets = zip(*pair, strict=True)
        found = self._pos_w[:, list(links)]
        if any(any(offset) for offset in offsets):  # the others are their links' origins
            quat = self._quat_w[:, list(links)]
            found = found + rot.rotate(quat, _constant(offsets, quat))
        return found


def _constant(numbers: tuple[tuple[float, ...], ...], like: Array) -> Array:
    """Numbers as an array of the kind, precision and place of another."""
    return (
        np.array(numbers, like.dtype) if isinstance(like, np.ndarray) else _on_device(numbers, like.dtype, like.device)
    )


@lru_cache(maxsize=64)
def _on_device(numbers: tuple[tuple[float, ...], ...], dtype: Any, device: Any) -> Array:
    """Numbers as a tensor, copied from the host once and not in every step."""
    import torch

    return torch.tensor(numbers, dtype=dtype, device=device)
