"""What a robot feels of itself."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch

from mimicbench.core import rotations as rot
from mimicbench.robots.description import Robot
from mimicbench.sensors.arrays import own, tensor
from mimicbench.sim.physics import LinkState, RobotState
from mimicbench.sim.rows import Rows


def gravity(state: RobotState) -> torch.Tensor:
    """(N, 3) g: direction of gravity in the root frame."""
    w, x, y, z = state.root_quat_w.unbind(-1)
    return torch.stack([2 * (w * y - x * z), -2 * (w * x + y * z), 2 * (x * x + y * y) - 1], -1)


def tilt(state: RobotState) -> torch.Tensor:
    """(N, 2) roll and pitch [rad]: the last two turns that bring the root to where it is are about y, then x."""
    xp, (quat,) = own(state.root_quat_w)
    w, x, y, z = _rows(xp, quat)
    roll = xp.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    return _table(xp, [roll[None], xp.arcsin((2 * (w * y - x * z)).clip(-1.0, 1.0))[None]])


def root_turn(state: RobotState) -> torch.Tensor:
    """(3, 3, N) rotation matrices from the root's frame to the world's, each number of all robots side by side.

    Both functions below need them.
    """
    xp, (quat,) = own(state.root_quat_w)
    q = _rows(xp, quat)
    (wx, wy, wz), (xx, xy, xz), (yy, yz), (zz,) = ((q[i] + q[i]) * q[max(i, 1) :] for i in range(4))
    rows = [1 - yy - zz, xy - wz, xz + wy, xy + wz, 1 - xx - zz, yz - wx, xz - wy, yz + wx, 1 - xx - yy]
    return tensor(xp, xp.stack(rows).reshape(3, 3, -1))


def s_current(
    state: RobotState, links: LinkState, last_action: torch.Tensor, turn: torch.Tensor | None = None
) -> torch.Tensor:
    """(N, 300 for the H1) S_current of the paper (G.1): J, dJ, t, R, v, omega, last action, g.

    t, R, v and omega are the positions, orientations (rotation vectors), linear and angular velocities of all links in
    the root frame, three numbers a link. `turn` is `root_turn(state)`, if it is at hand.
    """
    turn = root_turn(state) if turn is None else turn
    xp, parts = _seen_from_root(state, links, turn, state.joint_pos, state.joint_vel)
    _, (r, action) = own(turn, last_action)
    # the third row of R is gravity's direction in the root frame, but for its sign
    return _table(xp, [*parts, action.T, -r[2]])


def _seen_from_root(
    state: RobotState, links: LinkState, turn: torch.Tensor, joint_pos: torch.Tensor, joint_vel: torch.Tensor
) -> tuple[Any, list[Any]]:
    """The library, and J, dJ, t, R, v, omega of all robots side by side (.., N)."""
    xp, (r, root_pos, root_quat, joint_pos, joint_vel, pos_w, quat_w, lin_vel_w, ang_vel_w) = own(
        turn,
        state.root_pos_w,
        state.root_quat_w,
        joint_pos,
        joint_vel,
        links.pos_w,
        links.quat_w,
        links.lin_vel_w,
        links.ang_vel_w,
    )
    away = _along_robots(pos_w) - _rows(xp, root_pos)
    pos, lin, ang = (
        _turn_back(xp, r, vectors).reshape(-1, len(root_pos))
        for vectors in (away, _along_robots(lin_vel_w), _along_robots(ang_vel_w))
    )
    rotvec = _turns_between(xp, _rows(xp, root_quat), _along_robots(quat_w)).reshape(pos.shape)
    return xp, [joint_pos.T, joint_vel.T, pos, rotvec, lin, ang]


def s_current_names(robot: Robot) -> tuple[str, ...]:
    """What each number of S_current is, such as `left_knee_joint.vel` or `torso_link.pos.x`."""
    parts = [f"{joint}.{what}" for what in ("pos", "vel") for joint in robot.joint_names]
    for what in ("pos", "rotvec", "lin_vel", "ang_vel"):
        parts += [f"{link.name}.{what}.{axis}" for link in robot.links for axis in "xyz"]
    return (*parts, *(f"{joint}.last_action" for joint in robot.joint_names), *(f"gravity.{axis}" for axis in "xyz"))


def link_state(
    state: RobotState,
    links: LinkState,
    joint_pos: torch.Tensor | None = None,
    joint_vel: torch.Tensor | None = None,
    turn: torch.Tensor | None = None,
) -> torch.Tensor:
    """(N, 278 for the H1) J, dJ and all links' t, R, v, omega in the root frame of `state`, three numbers a link (F.1).

    Of the robots themselves, or of others that have `links`, `joint_pos` and `joint_vel`, such as their references.
    `turn` as in s_current.
    """
    joints = (state.joint_pos if joint_pos is None else joint_pos, state.joint_vel if joint_vel is None else joint_vel)
    return _table(*_seen_from_root(state, links, root_turn(state) if turn is None else turn, *joints))


def body_state(state: RobotState, turn: torch.Tensor | None = None) -> torch.Tensor:
    """(N, 48 for the H1) what a robot can measure of itself: g, root height, root velocities in the root frame, J, dJ.

    `turn` as in s_current.
    """
    xp, (r, root_pos, lin_vel, ang_vel, joint_pos, joint_vel) = own(
        root_turn(state) if turn is None else turn,
        state.root_pos_w,
        state.root_lin_vel_w,
        state.root_ang_vel_b,
        state.joint_pos,
        state.joint_vel,
    )
    return _table(
        xp, [-r[2], root_pos.T[2:], _turn_back(xp, r, _rows(xp, lin_vel)), ang_vel.T, joint_pos.T, joint_vel.T]
    )


def _table(xp: Any, rows: Sequence[Any]) -> torch.Tensor:
    """(N, C) of blocks of rows (., N).

    What is worked out has one row a number, so that every operation runs along the robots.
    """
    return tensor(xp, xp.concatenate(rows)).T.contiguous()


def _rows(xp: Any, array: Any) -> Any:
    """(C, N) of (N, C), with each row's numbers side by side in memory."""
    return np.ascontiguousarray(array.T) if xp is np else array.T.contiguous()


def _along_robots(array: Any) -> Any:
    """(L, C, N) of (N, L, C)."""
    return array.swapaxes(0, 1).swapaxes(1, 2)


def _turn_back(xp: Any, turn: Any, vectors: Any) -> Any:
    """R^T v of vectors (..., 3, N) by R (3, 3, N)."""
    return _summed(xp, [vectors[..., i : i + 1, :] for i in range(3)], turn)


def _summed(xp: Any, left: Sequence[Any], right: Sequence[Any]) -> Any:
    """Sum of products, from the first to the last, in two pieces of memory that stay near the processor."""
    total, part = left[0] * right[0], left[1] * right[1]
    total += part
    for a, b in zip(left[2:], right[2:], strict=True):
        total += xp.multiply(a, b, out=part)
    return total


def _turns_between(xp: Any, a: Any, b: Any) -> Any:
    """Rotation vectors (L, 3, N) of a^-1 b, for quaternions a (4, N) and b (L, 4, N)."""
    w, x, y, z = a
    # a^-1 b is linear in b
    columns = xp.stack([w, -x, -y, -z, x, w, -z, y, y, z, w, -x, z, -y, x, w]).reshape(4, 4, -1)
    turn = _summed(xp, [b[:, i : i + 1] for i in range(4)], columns)
    cosine, axis = turn[:, :1], turn[:, 1:]
    square = axis * axis
    sine = (
        square[:, :1] + square[:, 1:2] + square[:, 2:] + 1e-30
    ) ** 0.5  # never zero, so that its quotient has a limit
    # the shorter way: of the two quaternions of a turn, the one with w >= 0
    return axis * xp.copysign(2 * xp.arctan2(sine, abs(cosine)) / sine, cosine)


def _heading(state: RobotState) -> torch.Tensor:
    """(N,) where the roots' x axes point, seen from above [rad]."""
    xp, (quat,) = own(state.root_quat_w)
    w, x, y, z = _rows(xp, quat)
    sine, cosine = 2 * (x * y + w * z), 1 - 2 * (y * y + z * z)
    return tensor(xp, xp.arctan2(sine, cosine))


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
        self._cos, self._sin = torch.ones_like(self._heading), torch.zeros_like(self._heading)
        self._velocity = torch.zeros(num_envs, 2, device=device)

    def reset(self, rows: Rows, state: RobotState) -> None:
        """Robots `rows` begin anew where `state` says that all N are."""
        rows.put(self.pos, 0.0)
        rows.put(self.yaw, 0.0)
        rows.put(self._heading, _heading(state)[rows.ids])
        self._cos, self._sin = torch.cos(self._heading), torch.sin(self._heading)
        rows.put(self._velocity, self._in_start_frame(state)[rows.ids])

    def update(self, state: RobotState, dt: float, running: torch.Tensor | None = None) -> None:
        """One control step of `dt` seconds later, of the robots that are `running` (N,) bool; None: of all."""
        # the heading comes from an inertial sensor; wrapping keeps it continuous over many turns
        velocity = self._in_start_frame(state)
        xp, (yaw, heading, start, pos, now, before) = own(
            self.yaw, _heading(state), self._heading, self.pos, velocity, self._velocity
        )
        turned = tensor(xp, yaw + rot.wrap_angle(heading - start - yaw))
        moved = tensor(xp, pos + 0.5 * dt * (now + before))
        if running is not None:
            turned = torch.where(running, turned, self.yaw)
            moved = torch.where(running[:, None], moved, self.pos)
            velocity = torch.where(running[:, None], velocity, self._velocity)
        self.yaw, self.pos, self._velocity = turned, moved, velocity

    def _in_start_frame(self, state: RobotState) -> torch.Tensor:
        xp, (velocity, cos, sin) = own(state.root_lin_vel_w, self._cos, self._sin)
        x, y = velocity[:, 0], velocity[:, 1]
        return tensor(xp, xp.stack([cos * x + sin * y, cos * y - sin * x], -1))

    def state_tensors(self) -> dict[str, torch.Tensor]:
        """What it has added up."""
        return {name: getattr(self, name).clone() for name in ("pos", "yaw", "_heading", "_velocity")}

    def load_state_tensors(self, tensors: Mapping[str, torch.Tensor]) -> None:
        """The inverse of `state_tensors`."""
        for name, value in tensors.items():
            setattr(self, name, value.to(self.pos.device))
        self._cos, self._sin = torch.cos(self._heading), torch.sin(self._heading)
