"""What a robot feels of itself."""

import torch

from mimicbench.core import rotations as rot
from mimicbench.sim.physics import LinkState, RobotState


def gravity(state: RobotState) -> torch.Tensor:
    """(N, 3) g: direction of gravity in the root frame."""
    down = torch.tensor([0.0, 0.0, -1.0], device=state.root_quat_w.device).expand_as(state.root_pos_w)
    return rot.rotate_inverse(state.root_quat_w, down)


def s_current(state: RobotState, links: LinkState, last_action: torch.Tensor) -> torch.Tensor:
    """(N, 300 for the H1) S_current of the paper (G.1): J, dJ, t, R, v, omega, last action, g.

    t, R, v and omega are the positions, orientations (rotation vectors), linear and angular velocities of all links in
    the root frame, three numbers a link.
    """
    root = state.root_quat_w[:, None]
    pos_r = rot.rotate_inverse(root, links.pos_w - state.root_pos_w[:, None])
    turn_r = rot.to_rotvec(rot.multiply(rot.conjugate(root).expand_as(links.quat_w), links.quat_w))
    lin_r, ang_r = rot.rotate_inverse(root, links.lin_vel_w), rot.rotate_inverse(root, links.ang_vel_w)
    of_links = [part.flatten(1) for part in (pos_r, turn_r, lin_r, ang_r)]
    return torch.cat([state.joint_pos, state.joint_vel, *of_links, last_action, gravity(state)], -1)


def body_state(state: RobotState) -> torch.Tensor:
    """(N, 48 for the H1) what a robot can measure of itself: g, root height, root velocities in the root frame, J, dJ."""
    lin_r = rot.rotate_inverse(state.root_quat_w, state.root_lin_vel_w)
    return torch.cat([gravity(state), state.root_pos_w[:, 2:], lin_r, state.root_ang_vel_b, state.joint_pos, state.joint_vel], -1)


class Odometry:
    """Where each robot is relative to its start, by adding up its own velocity and turning rate.

    The position is in the heading frame of the start. Nothing but the robot's own motion goes in.
    """

    def __init__(self, num_envs: int) -> None:
        self.pos = torch.zeros(num_envs, 2)
        """(N, 2) [m]."""
        self.yaw = torch.zeros(num_envs)
        """(N,) [rad]."""
        self._heading = torch.zeros(num_envs)
        self._velocity = torch.zeros(num_envs, 2)

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
