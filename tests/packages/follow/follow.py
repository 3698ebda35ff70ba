"""A tracker of somebody else: it adds small angles to those of the clip, and is rewarded for the joints alone."""

from dataclasses import dataclass

import torch
from torch import Tensor

from mimicbench.robots.description import Robot
from mimicbench.sensors.context import StepContext, Transition
from mimicbench.track.spec import Terms, TrackerSpec


@dataclass(frozen=True)
class FollowConfig:
    """Of the action and the reward."""

    reach: float = 0.2
    """[rad] by which an action of 1 moves a target."""
    joints: float = 1.0
    """Of exp(-joints * sum dq^2) [1/rad^2]."""


def target(robot: Robot, next_joint_pos: Tensor, action: Tensor, settings: FollowConfig) -> Tensor:
    """(N, J) joint targets [rad]."""
    return next_joint_pos + settings.reach * action


def next_joint_pos(robot: Robot, terms: Terms) -> Tensor:
    """(N, J) joint angles [rad] of the next frame: those now, and the difference that the plan tells."""
    joints = len(robot.joints)
    return terms["proprio"][:, -2 * joints : -joints] + terms["reference+1"][:, 12 : 12 + joints]


def reward(context: StepContext, step: Transition, settings: FollowConfig) -> Tensor:
    """(N,) agreement of the joints, at most 1."""
    away = context.state.joint_pos - context.reference(0).joint_pos
    return torch.exp(-settings.joints * (away**2).sum(-1))


TRACKER = TrackerSpec("follow", "improved", ("proprio", "reference+1"), target, next_joint_pos, reward, FollowConfig)
