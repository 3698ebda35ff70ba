"""What a robot feels of itself."""

from typing import Any

import numpy as np
import torch

from mimicbench.core import rotations as rot
from mimicbench.sim.physics import LinkState, RobotState


def gravity(state: RobotState) -> torch.Tensor:
    """(N, 3) g: direction of gravity in the root frame."""
    w, x, y, z = state.root_quat_w.unbind(-1)
    return torch.stack([2 * (w * y - x * z), -2 * (w * x + y * z), 2 * (x * x + y * y) - 1], -1)


def s_current(state: RobotState, links: LinkState, last_action: torch.Tensor) -> torch.Tensor:
    """(N, 300 for the H1) S_current of the paper (G.1): J, dJ, t, R, v, omega, last action, g.

    t, R, v and omega are the positions, orientations (rotation vectors), linear and angular velocities of all links in
    the root frame, three numbers a link.
    """
    arrays = [state.root_pos_w, state.root_quat_w, state.joint_pos, state.joint_vel, *vars(links).values(), last_action]
    # on the CPU by NumPy: it is quicker for few robots, and torch's arctan2 rounds by a robot's place in the batch
    on_cpu = state.root_pos_w.device.type == "cpu"
    rows = _s_current_rows(*((np, *(array.numpy() for array in arrays)) if on_cpu else (torch, *arrays)))
    return (torch.from_numpy(rows) if on_cpu else rows).T.contiguous()


def _s_current_rows(
    xp: Any, root_pos: Any, root_quat: Any, joint_pos: Any, joint_vel: Any, pos_w: Any, quat_w: Any, lin_vel_w: Any, ang_vel_w: Any, last_action: Any
) -> Any:
    """S_current as (300, N): one row a number, so that every operation runs along the robots, which lie side by side in memory.

    The arrays are those of RobotState and LinkState, and belong to `xp`: NumPy or torch.
    """
    count, links = pos_w.shape[:2]
    turn = _rows(xp, rot.to_matrix(root_quat).reshape(count, 9))
    xyz = [xp.concatenate([pos_w[..., i].T - root_pos[:, i], lin_vel_w[..., i].T, ang_vel_w[..., i].T]) for i in range(3)]
    # v_r = R^T v_w, all of a robot's vectors at once
    pos, lin, ang = (
        xp.stack(parts, 1).reshape(3 * links, count)
        for parts in zip(*((turn[i] * xyz[0] + turn[3 + i] * xyz[1] + turn[6 + i] * xyz[2]).reshape(3, links, count) for i in range(3)), strict=True)
    )
    rotvec = xp.stack(_turns_between(xp, _rows(xp, root_quat), [quat_w[..., i].T for i in range(4)]), 1).reshape(3 * links, count)
    down = -turn[6:]  # the third row of R: gravity's direction in the root frame, but for its sign
    return xp.concatenate([_rows(xp, joint_pos), _rows(xp, joint_vel), pos, rotvec, lin, ang, _rows(xp, last_action), down])


def _rows(xp: Any, array: Any) -> Any:
    """(C, N) of (N, C), with each row's numbers side by side in memory."""
    return np.ascontiguousarray(array.T) if xp is np else array.T.contiguous()


def _turns_between(xp: Any, a: Any, b: Any) -> list[Any]:
    """The three components (L, N) of the rotation vectors of a^-1 b, for quaternions a (4, N) and b of four (L, N)."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    w = aw * bw + ax * bx + ay * by + az * bz
    x = aw * bx - ax * bw - ay * bz + az * by
    y = aw * by + ax * bz - ay * bw - az * bx
    z = aw * bz - ax * by + ay * bx - az * bw
    sine = (x * x + y * y + z * z) ** 0.5
    # the shorter way: of the two quaternions of a turn, the one with w >= 0
    small = sine < 1e-7
    scale = xp.where(small, 2.0 + 0 * sine, 2 * xp.arctan2(sine, abs(w)) / xp.where(small, 1.0 + 0 * sine, sine))
    scale = xp.where(w < 0, -scale, scale)
    return [scale * x, scale * y, scale * z]


def body_state(state: RobotState) -> torch.Tensor:
    """(N, 48 for the H1) what a robot can measure of itself: g, root height, root velocities in the root frame, J, dJ."""
    lin_r = rot.rotate_inverse(state.root_quat_w, state.root_lin_vel_w)
    return torch.cat([gravity(state), state.root_pos_w[:, 2:], lin_r, state.root_ang_vel_b, state.joint_pos, state.joint_vel], -1)


class Odometry:
    """Where each robot is relative to its start, by adding up its own velocity and turning rate.

    The position is in the heading frame of the start. Nothing but the robot's own motion goes in.
    """

    def __init__(self, num_envs: int, device: str = "cpu") -> None:
        self.pos = torch.zeros(num_envs, 2, device=device)
        """(N, 2) [m]."""
        self.yaw = torch.zeros(num_envs, device=device)
        """(N,) [rad]."""
        self._heading = torch.zeros(num_envs, device=device)
        self._velocity = torch.zeros(num_envs, 2, device=device)

    def reset(self, ids: torch.Tensor, state: RobotState) -> None:
        """Robots `ids` begin anew here."""
        self.pos[ids], self.yaw[ids] = 0.0, 0.0
        self._heading[ids] = rot.yaw_of(state.root_quat_w)[ids]
        self._velocity[ids] = self._in_start_frame(state)[ids]

    def update(self, state: RobotState, dt: float) -> None:
        """One control step of `dt` seconds later."""
        # the heading comes from an inertial sensor; wrapping keeps it continuous over many turns
        self.yaw = self.yaw + rot.wrap_angle(rot.yaw_of(state.root_quat_w) - self._heading - self.yaw)
        velocity = self._in_start_frame(state)
        self.pos = self.pos + 0.5 * dt * (velocity + self._velocity)
        self._velocity = velocity

    def _in_start_frame(self, state: RobotState) -> torch.Tensor:
        cos, sin = torch.cos(self._heading), torch.sin(self._heading)
        x, y = state.root_lin_vel_w[:, 0], state.root_lin_vel_w[:, 1]
        return torch.stack([cos * x + sin * y, cos * y - sin * x], -1)
