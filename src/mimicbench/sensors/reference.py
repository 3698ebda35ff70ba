"""References and objects as seen from a robot's root: what trackers are told to follow."""

import torch
from torch import Tensor

from mimicbench.core import rotations as rot
from mimicbench.robots.description import Robot
from mimicbench.sensors.arrays import own, tensor
from mimicbench.sensors.context import Frame
from mimicbench.sim.physics import LinkState, ObjectState, RobotState


def reference_in_root(state: RobotState, frame: Frame) -> Tensor:
    """(N, 12 + 2 J) one reference frame relative to the body.

    Position, orientation (6D) and velocity of the reference root in the robot's root frame; difference of the joint
    angles; joint velocities.
    """
    names = ("root_pos_w", "root_quat_w", "joint_pos")
    xp, (pos, quat, joint_pos, ref_pos, ref_quat, ref_joint_pos, ref_lin_vel, ref_joint_vel) = own(
        *(getattr(state, name) for name in names),
        *(getattr(frame, name) for name in (*names, "root_lin_vel_w", "joint_vel")),
    )
    turned = rot.to_6d(rot.multiply(rot.conjugate(quat), ref_quat))
    away, velocity = rot.rotate_inverse(quat, ref_pos - pos), rot.rotate_inverse(quat, ref_lin_vel)
    return tensor(xp, xp.concatenate([away, turned, velocity, ref_joint_pos - joint_pos, ref_joint_vel], -1))


def walk_of(frame: Frame) -> Tensor:
    """(N, 3) how a reference's root moves, in its own frame: forward and to the left [m/s], about its upward axis
    [rad/s]. It says nothing of where it is.
    """
    velocity, spin = (
        rot.rotate_inverse(frame.root_quat_w, vector) for vector in (frame.root_lin_vel_w, frame.root_ang_vel_w)
    )
    return torch.cat([velocity[:, :2], spin[:, 2:]], -1)


def object_in_root(state: RobotState, obj: ObjectState) -> Tensor:
    """(N, 12) position [m], orientation (rotation vector), linear [m/s] and angular velocity [rad/s] in the root frame.

    The object's state of the paper's tracker for lifting (F.1).
    """
    quat = state.root_quat_w
    ang_vel_w = rot.rotate(obj.quat_w, obj.ang_vel_b)
    parts = [
        rot.rotate_inverse(quat, obj.pos_w - state.root_pos_w),
        rot.to_rotvec(rot.multiply(rot.conjugate(quat), obj.quat_w)),
        rot.rotate_inverse(quat, obj.lin_vel_w),
        rot.rotate_inverse(quat, ang_vel_w),
    ]
    return torch.cat(parts, -1)


def reference_links(robot: Robot, frame: Frame) -> LinkState:
    """Link poses and velocities of a reference frame by forward kinematics, of all links of one depth at once."""
    offsets, rests, axes = (
        frame.root_pos_w.new_tensor(array) for array in (robot.link_pos, robot.link_quat, robot.link_axis)
    )
    turns = rot.from_rotvec(axes * frame.joint_pos[:, robot.link_joint, None])
    root = (frame.root_pos_w, frame.root_quat_w, frame.root_lin_vel_w, frame.root_ang_vel_w)
    links = [part[:, None].repeat(1, len(robot.links), 1) for part in root]
    xp, (offsets, rests, axes, turns, joint_vel, pos, quat, lin, ang) = own(
        offsets, rests, axes, turns, frame.joint_vel, *links
    )
    for level in robot.link_levels:
        parents = [robot.link_parents[link] for link in level]
        turned, spin = quat[:, parents], ang[:, parents]
        arm = rot.rotate(turned, offsets[level])
        turned = rot.multiply(turned, rests[level])
        axes_w, speeds = rot.rotate(turned, axes[level]), joint_vel[:, robot.link_joint[level], None]
        pos[:, level] = pos[:, parents] + arm
        quat[:, level] = rot.multiply(turned, turns[:, level])
        lin[:, level] = lin[:, parents] + rot.cross(spin, arm)
        ang[:, level] = spin + axes_w * speeds
    return LinkState(*(tensor(xp, part) for part in (pos, quat, lin, ang)))
