"""What other packages' policies ask for: the object in a few numbers, and the elevation map as a gray picture."""

import numpy as np
import torch
from torch import Tensor

from mimicbench.core import rotations as rot
from mimicbench.sensors.context import StepContext

SCENE, PICTURE = ("scene", "targets"), "gray"
"""Observations that LeRobot calls `observation.environment_state`, one after the other where the task has them, and
the one that it calls `observation.images.elevation`."""
LOWEST, HIGHEST = -1.3, 0.7
"""[m] From the root: black and white in the gray picture of an elevation map. The floor is near -1."""


def scene_in_root(context: StepContext) -> Tensor:
    """(N, 12) the box around the object: center [m] and orientation (6D) in the root frame, and half its size [m].

    Not a rotation vector: who stands before a chair sees it turned by half a turn, where those jump.
    """
    corners = torch.from_numpy(np.array([obj.bounds() for obj in context.physics.objects], np.float32))
    low, high = corners.to(context.device).unbind(1)
    obj, state = context.object, context.state
    center_w = obj.pos_w + rot.rotate(obj.quat_w, (low + high) / 2)
    turned = rot.multiply(rot.conjugate(state.root_quat_w), obj.quat_w)
    away = rot.rotate_inverse(state.root_quat_w, center_w - state.root_pos_w)
    return torch.cat([away, rot.to_6d(turned), (high - low) / 2], -1)


def gray(elevation: Tensor) -> Tensor:
    """The same map, heights [m] relative to the root, as uint8 from LOWEST to HIGHEST."""
    return (255 * (elevation - LOWEST) / (HIGHEST - LOWEST)).clamp(0, 255).to(torch.uint8)
