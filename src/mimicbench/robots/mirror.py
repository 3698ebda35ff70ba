"""A robot in a mirror: which joint is on the other side, and whether it turns the same way there."""

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion
from mimicbench.core.mirror import SPECULAR, SPECULAR_QUAT, other_side
from mimicbench.robots.description import Robot

TOLERANCE = 1e-3
"""[m, rad] by which the sides of a robot may differ."""


def mirrored_joints(robot: Robot) -> tuple[np.ndarray, np.ndarray]:
    """For each joint (N,) the one on the other side, and 1 or -1 (N,): angles in the mirror are `sign * q[..., other]`.

    A turn by q about an axis (x, y, z) is, in the mirror, one by q about (-x, y, -z). Raises BadMotion if the robot is
    not the same on both sides.
    """
    links, joints = list(robot.link_names), list(robot.joint_names)
    try:
        link = [links.index(other_side(name)) for name in links]
        joint = [joints.index(other_side(name)) for name in joints]
    except ValueError as error:
        raise BadMotion(f"robot {robot.name} has no other side of something ({error}); it cannot be mirrored") from None
    seen = robot.joint_axis[joint] * -SPECULAR
    sign = np.sign((robot.joint_axis * seen).sum(-1))
    limits = np.sort(robot.joint_range[joint] * sign[:, None], -1)
    parents = [-1 if parent < 0 else link[parent] for parent in robot.link_parents]
    apart = (
        np.abs(robot.link_pos[link] * SPECULAR - robot.link_pos).max(),
        rot.angle_between(robot.link_quat[link] * SPECULAR_QUAT, robot.link_quat).max(),
        np.abs(robot.joint_axis - sign[:, None] * seen).max(),
        np.abs(limits - robot.joint_range).max(),
    )
    if max(apart) > TOLERANCE or [robot.link_parents[other] for other in link] != parents:
        raise BadMotion(f"robot {robot.name} is not the same on both sides; it cannot be mirrored")
    return np.array(joint), sign
