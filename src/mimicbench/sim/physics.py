"""The one interface to batched physics, and what it reports.

`native.py` implements it on CPU threads, `warp.py` on NVIDIA GPUs; `backends.py` chooses by device.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import mujoco
import numpy as np
import torch

from mimicbench.objects.shape import SceneObject
from mimicbench.robots.description import Robot
from mimicbench.sim.broken import BrokenLog


@dataclass(frozen=True)
class RobotState:
    """Joint-space state of N robots, float32 on the physics' device."""

    root_pos_w: torch.Tensor
    """(N, 3) [m]."""
    root_quat_w: torch.Tensor
    """(N, 4)."""
    root_lin_vel_w: torch.Tensor
    """(N, 3) [m/s]."""
    root_ang_vel_b: torch.Tensor
    """(N, 3) [rad/s], in the root's own frame."""
    joint_pos: torch.Tensor
    """(N, J) [rad]."""
    joint_vel: torch.Tensor
    """(N, J) [rad/s]."""


@dataclass(frozen=True)
class LinkState:
    """Poses and velocities of all L links of N robots."""

    pos_w: torch.Tensor
    """(N, L, 3) [m]."""
    quat_w: torch.Tensor
    """(N, L, 4)."""
    lin_vel_w: torch.Tensor
    """(N, L, 3) velocity of the link's origin [m/s]."""
    ang_vel_w: torch.Tensor
    """(N, L, 3) [rad/s]."""


class Physics(Protocol):
    """N scenes of one robot, each with its own object, stepped together at the control rate."""

    robot: Robot
    num_envs: int
    device: str
    """Where its tensors live, as torch calls it."""
    objects: Sequence[SceneObject]
    """The object in each scene."""
    broken: BrokenLog
    """What was told of scenes whose physics broke."""

    def model(self, env: int) -> mujoco.MjModel:
        """The compiled scene `env`, for rendering or replaying it."""
        ...

    def qpos(self) -> np.ndarray:
        """(N, nq) MuJoCo's positions now, to be read: root, joints, then the object's if it moves."""
        ...

    def qvel(self) -> np.ndarray:
        """(N, nv) MuJoCo's velocities now, to be read."""
        ...

    def set_objects(self, objects: Sequence[SceneObject], ids: np.ndarray | None = None) -> None:
        """Exchange the objects of scenes `ids` (None: all)."""
        ...

    def reset(
        self,
        ids: np.ndarray,
        root_pos_w: np.ndarray,
        root_quat_w: np.ndarray,
        joint_pos: np.ndarray,
        root_lin_vel_w: np.ndarray | None = None,
        root_ang_vel_b: np.ndarray | None = None,
        joint_vel: np.ndarray | None = None,
    ) -> None:
        """Put the robots of scenes `ids` into a state; velocities default to zero, objects return to the origin."""
        ...

    def step(self, target: torch.Tensor, measure_effort: bool = False, ids: np.ndarray | None = None) -> None:
        """Advance scenes `ids` (None: all) one control step with targets (N, J): joint angles, velocities or torques
        by the control mode.

        With `measure_effort`, `effort` holds e = sum_j (tau_j v_j)^2 of this control step, tau and v being means over
        its substeps (appendix D.2). Targets may be on the CPU, too.
        """
        ...

    def advance(self, target: torch.Tensor) -> None:
        """One control step of all scenes with targets (N, J), and nothing else: no reports, no effort.

        Returns when it is over.

        This is the least that a step can cost, beside which everything else is measured.
        """
        ...

    def state(self) -> RobotState:
        """Joint-space state now."""
        ...

    def links(self) -> LinkState:
        """Poses and velocities of all links now."""
        ...

    def object_pose(self) -> tuple[np.ndarray, np.ndarray]:
        """Positions (N, 3) [m] and orientations (N, 4) of the objects now; the origin where they do not move."""
        ...

    def ray(
        self, starts: np.ndarray, rays: np.ndarray, groups: Sequence[int], ids: np.ndarray | None = None
    ) -> np.ndarray:
        """How many lengths of its ray (n, R, 3) it is from each start (n, R, 3) to a geom of `groups`: (n, R), -1
        for a miss.

        In scenes `ids`, ascending (None: all). One start (n, 1, 3) may serve all rays of a scene.
        """
        ...

    def push(self, ids: np.ndarray, lin_vel_w: np.ndarray) -> None:
        """Add (n, 3) [m/s] to the root's velocity in scenes `ids`."""
        ...

    @property
    def effort(self) -> torch.Tensor:
        """(N,) e of the last step that measured it [W^2]."""
        ...

    @property
    def diverged(self) -> torch.Tensor:
        """(N,) whether a scene's physics broke since its reset: something not finite or far too large, or more
        contacts than there is room for.

        It was reported to `broken`, goes on from some other state, and must be reset. Other scenes are as they would be
        without it.
        """
        ...
