"""The preset `improved`: actions move the reference's joint angles a little, and the observation is what that needs."""

import torch

from mimicbench.core import rotations as rot
from mimicbench.robots.description import Robot
from mimicbench.sensors.proprioception import body_state
from mimicbench.sim.physics import RobotState
from mimicbench.track.reference import Frame
from mimicbench.track.tracker import Moment, Step, TrackerKind

LOOKAHEAD = (1, 5)
"""Control steps ahead that the tracker sees of its reference: 0.02 s to act on, 0.1 s to prepare for."""


def reference_observation(state: RobotState, frame: Frame) -> torch.Tensor:
    """(N, 12 + 2 J) one reference frame relative to the body.

    Position, orientation (6D) and velocity of the reference root in the robot's root frame; difference of the joint
    angles; joint velocities.
    """
    pos_r = rot.rotate_inverse(state.root_quat_w, frame.root_pos_w - state.root_pos_w)
    quat_r = rot.multiply(rot.conjugate(state.root_quat_w), frame.root_quat_w)
    vel_r = rot.rotate_inverse(state.root_quat_w, frame.root_lin_vel_w)
    return torch.cat([pos_r, rot.to_6d(quat_r), vel_r, frame.joint_pos - state.joint_pos, frame.joint_vel], -1)


def plan_observation(moment: Moment) -> torch.Tensor:
    """(N, 24 + 4 J) what the tracker is told to do: its reference, one and five frames from now."""
    return torch.cat([reference_observation(moment.state, moment.reference(k)) for k in LOOKAHEAD], -1)


def assemble(body: torch.Tensor, last_action: torch.Tensor, plan: torch.Tensor) -> torch.Tensor:
    """(N, 34 + 7 J) the tracker's observation from the robot's own state (sense.proprioception), last action and
    plan.
    """
    return torch.cat([body, last_action, plan], -1)


def observe(moment: Moment) -> torch.Tensor:
    """(N, 34 + 7 J): the robot, its last action, and two frames of the reference. 167 numbers for the H1."""
    return assemble(body_state(moment.state), moment.last_action, plan_observation(moment))


def planned_joint_pos(plan: torch.Tensor, joint_pos: torch.Tensor) -> torch.Tensor:
    """(N, J) joint angles [rad] of the next frame of a plan (N, 24 + 4 J), for robots at joint_pos (N, J)."""
    return joint_pos + plan[:, 12 : 12 + joint_pos.shape[1]]


def target(robot: Robot, frame: Frame, action: torch.Tensor) -> torch.Tensor:
    """(N, J) joint targets [rad]: reference joint angle + scale x action."""
    return residual_target(robot, frame.joint_pos, action)


def residual_target(robot: Robot, joint_pos: torch.Tensor, action: torch.Tensor) -> torch.Tensor:
    """(N, J) joint_pos + scale x action [rad]."""
    scale = torch.tensor(robot.gains["improved"].action_scale, dtype=action.dtype, device=action.device)
    return joint_pos + scale * action


def reward(moment: Moment, step: Step) -> torch.Tensor:
    """(N,) agreement of root pose, joints and velocities with the reference, at most 1, less a price on changing the
    action.
    """
    state, ref = moment.state, moment.reference(0)
    position = ((state.root_pos_w - ref.root_pos_w) ** 2).sum(-1)
    angle = rot.angle_between(state.root_quat_w, ref.root_quat_w)
    joints = ((state.joint_pos - ref.joint_pos) ** 2).sum(-1)
    velocity = ((state.root_lin_vel_w - ref.root_lin_vel_w) ** 2).sum(-1)
    joint_velocity = ((state.joint_vel - ref.joint_vel) ** 2).sum(-1)
    agreement = (
        0.35 * torch.exp(-10.0 * position)
        + 0.20 * torch.exp(-5.0 * angle**2)
        + 0.25 * torch.exp(-1.0 * joints)
        + 0.10 * torch.exp(-2.0 * velocity)
        + 0.10 * torch.exp(-0.02 * joint_velocity)
    )
    return agreement - 0.005 * ((step.action - step.previous_action) ** 2).sum(-1)


RESIDUAL = TrackerKind("improved", "improved", observe, target, reward)
