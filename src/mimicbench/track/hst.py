"""Improved HST as the paper has it (appendix F): the preset `paper`."""

import torch

from mimicbench.core import rotations as rot
from mimicbench.robots.description import Robot
from mimicbench.sim.physics import LinkState
from mimicbench.sim.scene import CONTROL_DT
from mimicbench.track.reference import Frame
from mimicbench.track.tracker import Moment, Step, TrackerKind

HEIGHT_WEIGHT = 100.0
"""lambda_height of the two sitting tasks (F.3)."""


def observe(moment: Moment) -> torch.Tensor:
    """(N, 578) S of F.1: joints, link poses and velocities in the current root frame, of the robot and of its next
    target; last action; gravity.
    """
    state = moment.state
    nxt = moment.reference(1)
    down = state.root_pos_w.new_tensor([0.0, 0.0, -1.0]).expand_as(state.root_pos_w)
    current = [state.joint_pos, state.joint_vel, *_in_root_frame(moment, moment.links())]
    wanted = [nxt.joint_pos, nxt.joint_vel, *_in_root_frame(moment, reference_links(moment.robot, nxt))]
    return torch.cat([*current, *wanted, moment.last_action, rot.rotate_inverse(state.root_quat_w, down)], -1)


def _in_root_frame(moment: Moment, links: LinkState) -> list[torch.Tensor]:
    """t, R (rotation vectors), v, omega of all links in the current root frame, each (N, 3 L)."""
    root_quat = moment.state.root_quat_w[:, None]
    pos = rot.rotate_inverse(root_quat, links.pos_w - moment.state.root_pos_w[:, None])
    turn = rot.to_rotvec(rot.multiply(rot.conjugate(root_quat).expand_as(links.quat_w), links.quat_w))
    velocities = [rot.rotate_inverse(root_quat, v) for v in (links.lin_vel_w, links.ang_vel_w)]
    return [part.flatten(1) for part in (pos, turn, *velocities)]


def reference_links(robot: Robot, frame: Frame) -> LinkState:
    """Link poses and velocities of a reference frame by forward kinematics."""
    parents, drives = robot.link_parents, {int(link): j for j, link in enumerate(robot.joint_link)}
    offsets, rests, axes = (
        frame.root_pos_w.new_tensor(array) for array in (robot.link_pos, robot.link_quat, robot.joint_axis)
    )
    pos, quat, lin, ang = [frame.root_pos_w], [frame.root_quat_w], [frame.root_lin_vel_w], [frame.root_ang_vel_w]
    for i, parent in enumerate(parents):
        if parent < 0:
            continue
        arm = rot.rotate(quat[parent], offsets[i].expand_as(frame.root_pos_w))
        turned = rot.multiply(quat[parent], rests[i].expand_as(frame.root_quat_w))
        spin = ang[parent]
        if i in drives:
            j = drives[i]
            axis_w = rot.rotate(turned, axes[j].expand_as(frame.root_pos_w))
            turned = rot.multiply(turned, rot.from_rotvec(axes[j] * frame.joint_pos[:, j, None]))
            spin = spin + axis_w * frame.joint_vel[:, j, None]
        pos.append(pos[parent] + arm)
        quat.append(turned)
        lin.append(lin[parent] + torch.linalg.cross(ang[parent], arm))
        ang.append(spin)
    return LinkState(torch.stack(pos, 1), torch.stack(quat, 1), torch.stack(lin, 1), torch.stack(ang, 1))


def target(robot: Robot, frame: Frame, action: torch.Tensor) -> torch.Tensor:
    """(N, J) joint targets [rad]: the action is the joint angle itself (F.2), kept within the limits."""
    low, high = action.new_tensor(robot.joint_range).T
    return torch.clamp(action, low, high)


def reward(moment: Moment, step: Step) -> torch.Tensor:
    """(N,) r_human + r_reg of F.3 as written, with the sign of r_energy mended: the text says that it penalizes."""
    state, ref = moment.state, moment.reference(0)
    links, wanted = moment.links(), reference_links(moment.robot, ref)
    r_pos = torch.exp(-5.0 * ((links.pos_w - wanted.pos_w) ** 2).sum((-1, -2)))
    r_ori = torch.exp(-rot.angle_between(links.quat_w, wanted.quat_w)).sum(-1)
    height = (state.root_pos_w[:, 2] - ref.root_pos_w[:, 2]) ** 2
    r_root = 5.0 * torch.exp(-10.0 * (state.root_pos_w - ref.root_pos_w).abs().sum(-1)) - HEIGHT_WEIGHT * height
    acceleration = (state.joint_vel - step.previous_joint_vel) / CONTROL_DT
    wanted_acceleration = (ref.joint_vel - step.previous_reference_joint_vel) / CONTROL_DT
    r_reg = (
        -1e-3 * ((step.action - step.previous_action) ** 2).sum(-1)
        - 2e-3 * ((state.joint_vel - ref.joint_vel) ** 2).sum(-1)
        - 5e-7 * ((acceleration - wanted_acceleration) ** 2).sum(-1)
        - 1e-6 * step.effort
    )
    return r_pos + r_ori + r_root + r_reg


HST_PAPER = TrackerKind("paper", "paper", observe, target, reward, measures_effort=True)
