"""Where robots, what they carry, and what stands in the way are, by the robots' own reckoning."""

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from mimicbench.core import rotations as rot
from mimicbench.sensors.context import StepContext
from mimicbench.sensors.heightmap import CELLS
from mimicbench.sim.physics import ObjectState, RobotState
from mimicbench.tasks.task import BodyPoints

RAISED = 0.12
"""[m] What is so high above the floor is in the way."""
LIFTED = 0.01
"""[m] What the plan has moved so far is in the hands."""
REACH = 2.0
"""[m] What is farther from a goal belongs to something else."""


def reckoned(proprio: Tensor, odometry: Tensor) -> RobotState:
    """Robots in the heading frames of their starts, by what they measure of themselves (N, 10 + 2 J) and odometry
    (N, 3).
    """
    joints = (proprio.shape[1] - 10) // 2
    gravity, height, lin_vel, ang_vel, joint_pos, joint_vel = proprio.split([3, 1, 3, 3, joints, joints], -1)
    zero = torch.zeros_like(height[:, 0])
    pitch, roll = torch.asin(gravity[:, 0].clamp(-1, 1)), torch.atan2(-gravity[:, 1], -gravity[:, 2])
    about_x = rot.from_rotvec(torch.stack([roll, zero, zero], -1))
    about_y = rot.from_rotvec(torch.stack([zero, pitch, zero], -1))
    quat = rot.multiply(rot.from_yaw(odometry[:, 2]), rot.multiply(about_y, about_x))
    pos = torch.cat([odometry[:, :2], height], -1)
    return RobotState(pos, quat, rot.rotate(quat, lin_vel), ang_vel, joint_pos, joint_vel)


def seen_from(state: RobotState, place: Tensor) -> RobotState:
    """The same robots in frames that stand at places (N, 3), x, y [m] and yaw [rad]."""
    back = rot.from_yaw(-place[:, 2])
    return replace(
        state,
        root_pos_w=rot.rotate(back, state.root_pos_w - _flat(place)),
        root_quat_w=rot.multiply(back, state.root_quat_w),
        root_lin_vel_w=rot.rotate(back, state.root_lin_vel_w),
    )


def in_hands(context: StepContext) -> ObjectState:
    """Where objects are that the plan moves: where they stand, and once lifted wherever the hands are as the plan has
    it.
    """
    planned, robot = context.reference(0), context.robot
    wrists = BodyPoints.of(robot, context.links.pos_w, context.links.quat_w).wrist_pos_w
    (left, right), (to_left, to_right) = wrists.unbind(1), planned.wrist_pos_w.unbind(1)
    yaw, to_yaw = (torch.atan2(away[:, 1], away[:, 0]) for away in (left - right, to_left - to_right))
    turn, obj = rot.from_yaw(rot.wrap_angle(yaw - to_yaw)), planned.object
    middle, to_middle = (left + right) / 2, (to_left + to_right) / 2
    carried = ObjectState(
        middle + rot.rotate(turn, obj.pos_w - to_middle),
        rot.multiply(turn, obj.quat_w),
        rot.rotate(turn, obj.lin_vel_w),
        obj.ang_vel_b,
    )
    lifted = (obj.pos_w.norm(dim=-1) > LIFTED)[:, None]
    pairs = zip(vars(carried).values(), vars(obj).values(), strict=True)
    return ObjectState(*(torch.where(lifted, hand, floor) for hand, floor in pairs))


def risen(elevation: Tensor, root_height: Tensor, place: Tensor, cell: float) -> list[np.ndarray]:
    """What rises from the floor near each of places (M, 3), in the frames of these: (P, 3) x, y and height above the
    floor [m].

    Args:
        elevation: (M, 128, 128) heights relative to the roots [m].
        root_height: (M,) of these above the floor [m].
        place: x, y [m] and yaw [rad] in the frames of the maps.
        cell: Side of a cell [m].
    """
    line = (torch.arange(CELLS, device=place.device) - (CELLS - 1) / 2) * cell
    x, y = (part - place[:, i, None, None] for i, part in enumerate((line[:, None], line[None, :])))
    cos, sin = (part[:, None, None] for part in (place[:, 2].cos(), place[:, 2].sin()))
    own = torch.stack(torch.broadcast_tensors(cos * x + sin * y, cos * y - sin * x), -1)
    height = elevation + root_height[:, None, None]
    taken = (height > RAISED) & (own.norm(dim=-1) < REACH)
    points = torch.cat([own, height[..., None]], -1)
    return [each[here].double().cpu().numpy() for each, here in zip(points, taken, strict=True)]


def _flat(place: Tensor) -> Tensor:
    """(N, 3) on the floor."""
    return torch.cat([place[:, :2], torch.zeros_like(place[:, :1])], -1)
