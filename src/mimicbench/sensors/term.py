"""What an observation is: a name, a shape, how it is worked out, and, in words, what it holds."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from mimicbench.robots.description import Robot
from mimicbench.sensors.context import StepContext
from mimicbench.tasks.task import Task

BOUND = 1000.0
"""Observations beyond this are out of every space; no robot that is still in one piece comes near it."""


@dataclass(frozen=True)
class Term:
    """One thing that N robots can observe."""

    name: str
    """As policies, trackers and environments ask for it."""
    shape: Callable[[Robot, Task], tuple[int, ...]]
    """Of one robot's part."""
    compute: Callable[[StepContext], Tensor]
    """(N, *shape)."""
    privileged: bool = False
    """Whether no robot can know it: simulators and trainers only."""
    exists: Callable[[Task], bool] = lambda task: True
    """Whether the task has it."""
    some: Callable[[StepContext, Tensor], Tensor] | None = None
    """(n, *shape) of robots (n,) alone, if that is cheaper than picking them out of all."""
    turns: tuple[int, ...] = ()
    """Where in it rotation vectors begin: half a turn is the same to the left and to the right."""
    low: float = -BOUND
    high: float = BOUND
    dtype: torch.dtype = torch.float32


_LINKS = (
    "joint angles and velocities, and of all links position, rotation vector, linear and angular velocity, "
    "in the root frame"
)
WORDS: Mapping[str, str] = {
    "gravity": "direction of gravity in the root frame",
    "tilt": "roll and pitch of the root [rad]",
    "root_height": "height of the root above the floor [m]",
    "root_ang_vel": "how fast the root turns, in its own frame [rad/s]",
    "joint_offset": "joint angles from those of the rest pose [rad]",
    "joint_target+1": "joint angles of the reference one control step ahead [rad]",
    "bears+1": "which of feet, hands and pelvis are in contact in the reference one control step ahead, 1 or 0",
    "walk+1": "how the reference goes one control step ahead: forward and left [m/s], turning [rad/s]",
    "joint_pos": "joint angles [rad]",
    "joint_vel": "joint velocities [rad/s]",
    "proprio": "what a robot measures of itself: direction of gravity in the root frame (3), root height (1) [m], "
    "linear (3) [m/s] and angular velocity (3) [rad/s] of the root in its own frame, joint angles [rad] and velocities "
    "[rad/s]",
    "body": f"{_LINKS} (the paper's F.1)",
    "state": "S_current of the paper (G.1): the body, the last targets, and the direction of gravity",
    "last_action": "the action before; zeros at the start",
    "last_target": "the targets that the joints were given before [rad]; zeros at the start",
    "time": "seconds since the episode began",
    "odometry": "x and y [m] and heading [rad] since the start, in the heading frame of the start, by adding up the "
    "robot's own velocity",
    "elevation": "height relative to the root of the highest point that the cameras see in each cell [m]",
    "heightmap": "the same map by rays straight down, so that nothing hides anything [m]",
    "gray": "`elevation` as a picture: 0 at 1.3 m below the root to 255 at 0.7 m above it",
    "scene": "the box around the object: center [m] and orientation (6 numbers) in the root frame, half its size [m]",
    "target_elevation": "a map with nothing on the floor but the two targets of the wrists [m]",
    "targets": "where left and right wrist are to go, in the root frame [m]",
    "hands": "which of left and right wrist have a target, 1 or 0",
    "views": "color, 0 to 1, and depth, as a share of 6 m, of all cameras side by side, in small, without the robot",
    "depth": "along the axis of each camera, at most 50 m [m]",
    "color": "what each camera sees, 0 to 255",
    "labels": "what each pixel is of: nothing, floor, object, or a link of the robot",
    "root_pose": "position [m] and quaternion (wxyz) of the root in the world",
    "object": "position, rotation vector, linear and angular velocity of the object in the root frame",
    "body_target": f"of the next reference frame: {_LINKS}",
    "body_difference": "difference to the next reference frame: positions and rotation vectors of all links",
    **{
        f"reference+{steps}": f"the reference {steps / 50:g} s ahead, from the robot's root: the root's position, "
        "orientation (6 numbers) and velocity, differences of the joint angles, joint velocities"
        for steps in (1, 2, 5, 10, 25)
    },
    **{
        f"object+{steps}": f"the object as the reference has it {steps / 50:g} s ahead, in the root frame"
        for steps in (1, 2, 5, 10, 25)
    },
}
"""By the term's name."""
