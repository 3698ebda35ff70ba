"""The clips that a tracker follows, laid end to end at the control rate."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from scipy.interpolate import CubicSpline

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion
from mimicbench.core.motion import RobotMotion
from mimicbench.robots.description import Robot
from mimicbench.sim.scene import CONTROL_DT


@dataclass(frozen=True)
class Frame:
    """One reference frame for each of N robots."""

    root_pos_w: torch.Tensor
    """(N, 3) [m]."""
    root_quat_w: torch.Tensor
    """(N, 4)."""
    root_lin_vel_w: torch.Tensor
    """(N, 3) [m/s]."""
    root_ang_vel_w: torch.Tensor
    """(N, 3) [rad/s]."""
    joint_pos: torch.Tensor
    """(N, J) [rad]."""
    joint_vel: torch.Tensor
    """(N, J) [rad/s]."""


class ReferenceBank:
    """C clips in one table of frames. A clip that is over stays at its last frame, at rest."""

    def __init__(self, motions: Sequence[RobotMotion], robot: Robot, device: str = "cpu") -> None:
        """Resample to the control rate by cubic splines, whose derivatives are the velocities.

        `device` is where the table and all its frames live.
        """
        if not motions:
            raise BadMotion("no clips to track; run `mimicbench retarget` first, or see why it kept none")
        rows = [_at_control_rate(motion, robot) for motion in motions]
        self.ids = [motion.id for motion in motions]
        self.object_ids = [motion.object_id for motion in motions]
        self.lengths = torch.tensor([len(row) for row in rows], device=device)
        """(C,) frames of each clip."""
        self.starts = torch.cumsum(self.lengths, 0) - self.lengths
        """(C,) row of each clip's first frame."""
        self._table = torch.from_numpy(np.concatenate(rows).astype(np.float32)).to(device)
        self._joints = len(robot.joints)

    def __len__(self) -> int:
        return len(self.ids)

    def frame(self, clip: torch.Tensor, index: torch.Tensor) -> Frame:
        """The frames `index` (N,) of clips `clip` (N,), the last one where a clip is over."""
        last = self.lengths[clip] - 1
        row = self._table[self.starts[clip] + torch.minimum(index, last)]
        j = self._joints
        pos, quat, joint_pos, lin, ang, joint_vel = row.split([3, 4, j, 3, 3, j], -1)
        return Frame(pos, quat, lin, ang, joint_pos, joint_vel)


def _at_control_rate(motion: RobotMotion, robot: Robot) -> np.ndarray:
    """(T', 13 + 2 J + ...) rows of pose and velocity at the control rate."""
    if motion.joint_names != robot.joint_names:
        raise BadMotion(
            f"clip {motion.id} is for {motion.robot!r} with other joints than {robot.name!r}; retarget it again"
        )
    times = np.arange(motion.frames) / motion.fps
    at = np.arange(int(times[-1] / CONTROL_DT + 1e-6) + 1) * CONTROL_DT
    quat = motion.root_quat_w.copy()
    # a quaternion and its negative are the same turn; keep to one side so that a spline may pass through them
    flips = np.cumprod(np.where((quat[1:] * quat[:-1]).sum(-1) < 0, -1.0, 1.0))
    quat[1:] *= flips[:, None]
    splines = [CubicSpline(times, values) for values in (motion.root_pos_w, quat, motion.joint_pos)]
    pos, quat, joint_pos = (spline(at) for spline in splines)
    quat = rot.normalize(quat)
    joint_pos = np.clip(joint_pos, robot.joint_range[:, 0], robot.joint_range[:, 1])
    lin, joint_vel = splines[0](at, 1), splines[2](at, 1)
    ang = rot.angular_velocity(quat, 1 / CONTROL_DT)
    lin[-1], ang[-1], joint_vel[-1] = 0, 0, 0
    return np.concatenate([pos, quat, joint_pos, lin, ang, joint_vel], -1)
