"""How episodes begin: one of them in NumPy arrays, as rules and files give it, or many as tensors of a device."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from scipy.interpolate import CubicSpline
from torch import Tensor

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion
from mimicbench.core.motion import RobotMotion
from mimicbench.objects.shape import SceneObject
from mimicbench.robots.description import Robot
from mimicbench.sim.physics import ObjectState, Physics, RobotState
from mimicbench.sim.timing import CONTROL_DT
from mimicbench.tasks.task import Task

_HEAD = 40
"""Frames of a motion that its first frame's velocity is taken from; what comes later changes it by less than rounding
does."""


@dataclass(frozen=True)
class InitialState:
    """The first frame of one episode, the object being at the origin."""

    obj: SceneObject
    root_pos_w: np.ndarray
    """(3,) [m]."""
    root_quat_w: np.ndarray
    """(4,)."""
    joint_pos: np.ndarray
    """(J,) [rad]."""
    root_lin_vel_w: np.ndarray
    """(3,) [m/s]."""
    root_ang_vel_b: np.ndarray
    """(3,) in the root's own frame [rad/s]."""
    joint_vel: np.ndarray
    """(J,) [rad/s]."""
    wrist_goal_w: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    """(2, 3) where left and right wrist are to go [m]; empty if the task has no such goal."""
    reference_id: str = ""
    """The motion that it is the first frame of; empty if it was drawn by rule."""


@dataclass(frozen=True)
class InitialStates:
    """How n episodes begin: everything that moves, and what they are for."""

    object_index: Tensor
    """(n,) places of their objects in the physics' catalog."""
    robot: RobotState
    object: ObjectState | None
    """None: at the origin, at rest."""
    wrist_goal_w: Tensor
    """(n, 2, 3) where left and right wrist are to go [m]; NaN without such a goal."""
    clip: Tensor
    """(n,) which clip of the bank they follow; any number where there is no bank."""
    frame: Tensor
    """(n,) at which of its frames they begin."""


def stacked(states: Sequence[InitialState], physics: Physics, clip: Tensor | None = None) -> InitialStates:
    """Initial states of n episodes for a physics, whose catalog learns their objects; clips are followed from 0 on."""
    device, n = physics.device, len(states)

    def tensor(name: str) -> Tensor:
        return torch.from_numpy(np.stack([getattr(state, name) for state in states])).to(device)

    names = ("root_pos_w", "root_quat_w", "root_lin_vel_w", "root_ang_vel_b", "joint_pos", "joint_vel")
    nowhere = np.full((2, 3), np.nan)
    goals = np.array([state.wrist_goal_w if len(state.wrist_goal_w) else nowhere for state in states])
    zeros = torch.zeros(n, dtype=torch.long, device=device)
    return InitialStates(
        torch.tensor(physics.add_objects([state.obj for state in states]), device=device),
        RobotState(**{name: tensor(name) for name in names}),
        None,
        torch.from_numpy(goals).to(device),
        zeros if clip is None else clip,
        zeros,
    )


def start_of(motion: RobotMotion, obj: SceneObject, robot: Robot, task: Task) -> InitialState:
    """The first frame of a motion, velocities included, no farther from the origin than the task allows.

    Raises BadMotion.
    """
    if motion.joint_names != robot.joint_names:
        raise BadMotion(
            f"clip {motion.id} is for {motion.robot!r} with other joints than {robot.name!r}; retarget it again"
        )
    head = slice(0, _HEAD)
    times = np.arange(motion.frames)[head] / motion.fps
    quat = motion.root_quat_w[head].copy()
    # a quaternion and its negative are the same turn; keep to one side so that a spline may pass through them
    quat[1:] *= np.cumprod(np.where((quat[1:] * quat[:-1]).sum(-1) < 0, -1.0, 1.0))[:, None]
    turning = rot.normalize(CubicSpline(times, quat)(np.array([0.0, CONTROL_DT])))
    lin_vel_w, joint_vel = (
        CubicSpline(times, values[head])(0.0, 1) for values in (motion.root_pos_w, motion.joint_pos)
    )
    spin_w, joint_pos = (
        rot.angular_velocity(turning, 1 / CONTROL_DT)[0],
        np.clip(motion.joint_pos[0], *robot.joint_range.T),
    )
    # rounded as a tracker's references are, so that both start from the same bits
    pos, quat_w, joint_pos, lin_vel_w, spin_w, joint_vel = (
        np.asarray(values, np.float32).astype(float)
        for values in (motion.root_pos_w[0], turning[0], joint_pos, lin_vel_w, spin_w, joint_vel)
    )
    quat_w = rot.normalize(quat_w)
    return InitialState(
        obj,
        clipped(pos, task.max_start_distance),
        quat_w,
        joint_pos,
        lin_vel_w,
        rot.rotate_inverse(quat_w, spin_w),
        joint_vel,
        motion.wrist_goal_w,
        motion.id,
    )


def clipped(root_pos_w: np.ndarray, limit: float | None) -> np.ndarray:
    """(3,) the position, moved towards the origin until it is within `limit` [m] of it seen from above (None:
    anywhere).
    """
    pos = np.array(root_pos_w, float)
    if limit is not None:
        pos[:2] *= min(1.0, limit / max(float(np.linalg.norm(pos[:2])), 1e-9))
    return pos
