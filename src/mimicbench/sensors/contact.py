"""What bears: by the labels of the clips that are followed, and by the forces that the physics measures."""

import torch
from torch import Tensor

from mimicbench.core.errors import MimicbenchError
from mimicbench.robots.description import Robot
from mimicbench.sensors.context import Frame, StepContext

BEARING = ("left_foot", "right_foot", "pelvis", "left_hand", "right_hand")
"""Parts of the body whose labels count, B of them."""


def told_to_bear(frame: Frame) -> Tensor:
    """(N, B) 1 where a part bears on floor or object in the reference, else 0.

    Raises MimicbenchError where references are planned as poses, of which nobody says what bears.
    """
    if frame.bears is None:
        raise MimicbenchError("these plans do not say what bears, which this tracker is told; choose another tracker")
    return frame.bears


def bears(context: StepContext, least: float) -> Tensor:
    """(N, B) bool whether more than `least` [N] presses on some link of a part, whatever touches it."""
    pressed = context.contact_force.norm(dim=-1) > least
    return torch.stack([pressed[:, links].any(-1) for links in bearers(context.robot)], -1)


def bearers(robot: Robot) -> list[list[int]]:
    """For each part, the links that bear for it, as the robot's mappings from people say."""
    names = [{link for mapping in robot.mappings for link in mapping.bearers.get(part, ())} for part in BEARING]
    return [sorted(robot.link_names.index(link) for link in some) for some in names]
