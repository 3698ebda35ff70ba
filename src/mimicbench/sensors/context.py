"""All that observations, rewards and targets may use of N robots at one control step, worked out when asked for."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from mimicbench.core import rotations as rot
from mimicbench.robots.description import Robot
from mimicbench.sensors.arrays import along_robots, own, tensor
from mimicbench.sensors.pictures import CameraPictures, Seen
from mimicbench.sensors.proprioception import root_turn
from mimicbench.sim.physics import LinkPoses, LinkState, ObjectState, Physics, RobotState
from mimicbench.tasks.task import BodyPoints, Task


@dataclass(frozen=True)
class Frame:
    """One reference frame for each of N robots: all that moves in it, and what it is for."""

    root_pos_w: Tensor
    """(N, 3) [m]."""
    root_quat_w: Tensor
    """(N, 4)."""
    root_lin_vel_w: Tensor
    """(N, 3) [m/s]."""
    root_ang_vel_w: Tensor
    """(N, 3) [rad/s]."""
    joint_pos: Tensor
    """(N, J) [rad]."""
    joint_vel: Tensor
    """(N, J) [rad/s]."""
    object: ObjectState
    """Where the object is to be; at the origin and at rest where it is fixed."""
    wrist_pos_w: Tensor
    """(N, 2, 3) where left and right wrist are in this frame [m]."""
    ankle_pos_w: Tensor
    """(N, 2, 3) where left and right ankle are in this frame [m]."""
    wrist_goal_w: Tensor
    """(N, 2, 3) where left and right wrist are to go in the end [m]; NaN without such a goal."""
    bears: Tensor | None = None
    """(N, B) 1 where a part of the body (sensors.contact) bears on floor or object, else 0; None where nobody knows."""


@dataclass(frozen=True)
class StepContext:
    """N robots beside their objects at one control step."""

    robot: Robot
    task: Task
    physics: Physics
    """For what is worked out of the scene: links, maps, pictures."""
    state: RobotState
    time: Tensor
    """(N,) since the episode's start [s]."""
    odometry_pos: Tensor
    """(N, 2) position relative to the start in the heading frame of the start, by the robot's own reckoning [m]."""
    odometry_yaw: Tensor
    """(N,) heading relative to the start [rad]."""
    last_action: Tensor
    """(N, A) the action that led here; zeros at the start."""
    last_target: Tensor
    """(N, J) the targets that the joints were given; zeros at the start."""
    wrist_goal_w: Tensor
    """(N, 2, 3) where left and right wrist are to go [m]; NaN without such a goal."""
    reference: Callable[[int], Frame]
    """The reference k control steps from now; raises MimicbenchError where episodes follow no clips."""
    pictures: CameraPictures
    """Draws what the cameras see, of the size that somebody asked for."""

    @cached_property
    def links(self) -> LinkState:
        """Poses and velocities of all links."""
        return self.physics.links()

    @cached_property
    def link_poses(self) -> LinkPoses:
        """Poses of all links, for less than their velocities cost."""
        return vars(self).get("links") or self.physics.link_poses()

    @cached_property
    def root_angle_error(self) -> Tensor:
        """(N,) angle between each root and its reference [rad]."""
        xp, (quat, wanted) = own(self.state.root_quat_w, self.reference(0).root_quat_w)
        return rot.angle_of(tensor(xp, rot.multiply(rot.conjugate(quat), wanted)))

    @cached_property
    def body_points(self) -> BodyPoints:
        """Where root, wrists and ankles are."""
        poses = self.link_poses
        xp, (pos_w, quat_w) = own(poses.pos_w, poses.quat_w)
        found = BodyPoints.of(self.robot, pos_w, quat_w)
        pairs = (tensor(xp, along_robots(xp, pair)) for pair in (found.ankle_pos_w, found.wrist_pos_w))
        return BodyPoints(poses.pos_w[:, 0], *pairs)

    @cached_property
    def object(self) -> ObjectState:
        """Where the objects are and how they move."""
        return self.physics.object_state()

    @cached_property
    def contact_force(self) -> Tensor:
        """(N, L, 3) sum of all forces of contact on each link [N], where the physics measures them."""
        return self.physics.contact_force()

    @cached_property
    def root_turn(self) -> Tensor:
        """(3, 3, N) rotation matrices from the root's frame to the world's."""
        return root_turn(self.state)

    @cached_property
    def views(self) -> Seen:
        """What all cameras see; needs OpenGL."""
        return self.pictures.views(self.physics, self.wrist_goal_w)

    @property
    def num_envs(self) -> int:
        """N."""
        return len(self.time)

    @property
    def device(self) -> torch.device:
        """Where all tensors live."""
        return self.time.device


@dataclass(frozen=True)
class Transition:
    """What only rewards need: the control step that led to a context."""

    action: Tensor
    """(N, A) the action just taken."""
    previous: StepContext
    """Everything one control step before, `last_action` being the action before this one."""
    effort: Tensor
    """(N,) sum_j (tau_j v_j)^2 [W^2]; zeros unless it is measured."""
