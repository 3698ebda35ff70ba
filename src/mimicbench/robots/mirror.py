"""A robot in a mirror: which joint is on the other side, and whether it turns the same way there.

The mirror stands upright along x, so left and right are exchanged, and y changes its sign.
"""

from collections.abc import Sequence

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion
from mimicbench.robots.description import Robot

SPECULAR = np.array([1.0, -1.0, 1.0])
"""What positions (..., 3) are multiplied by."""
SPECULAR_QUAT = np.array([1.0, -1.0, 1.0, -1.0])
"""What quaternions (..., 4) are multiplied by: turns about y stay, those about x and z go the other way."""
TOLERANCE = 1e-3
"""[m, rad] by which the sides of a robot may differ."""


def other_side(name: str) -> str:
    """With left in place of right and right in place of left."""
    return name.replace("left", "\0").replace("right", "left").replace("\0", "right")


def mirrored_labels(clip_id: str, names: Sequence[str]) -> list[int]:
    """Of each contact label of a clip, which is that of the other side. Raises BadMotion if there is none."""
    if missing := {other_side(name) for name in names} - set(names):
        raise BadMotion(f"clip {clip_id} has no labels of {', '.join(sorted(missing))}: it has no mirror image")
    return [names.index(other_side(name)) for name in names]


def toggled(name: str) -> str:
    """An id with `~mirror` at its end, or without it."""
    return name.removesuffix("~mirror") if name.endswith("~mirror") else f"{name}~mirror"


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
