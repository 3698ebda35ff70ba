"""Boxes as furniture has them: leaning boards, bolsters, rows of cushions, feet.

Frame and units are those of `parts`.
"""

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.objects.families.parts import Color, Parts

SEAM = 0.005
"""Half of the groove between two cushions [m]."""
GROOVE = 0.012
"""Depth of that groove [m]."""


def lean(
    parts: Parts,
    foot: np.ndarray,
    facing: float,
    angle: float,
    out: tuple[float, float],
    across: tuple[float, float],
    up: tuple[float, float],
    rgb: Color,
) -> None:
    """Add a box that leans backwards.

    Args:
        parts: where it goes.
        foot: (3,) the point that its extents count from.
        facing: yaw of the direction that its front looks in [rad].
        angle: to the vertical, away from where it looks [rad].
        out: its extent towards the front, at right angles to it [m].
        across: its extent to the left of where it looks [m].
        up: its extent along it [m].
        rgb: its color.
    """
    quat = rot.multiply(rot.from_yaw(np.array(facing)), rot.from_rotvec(np.array([0.0, -angle, 0.0])))
    low, high = np.array([out[0], across[0], up[0]]), np.array([out[1], across[1], up[1]])
    parts.add(foot + rot.rotate(quat, (low + high) / 2), (high - low) / 2, rgb, quat)


def roll(parts: Parts, center: np.ndarray, axis: int, radius: float, half_length: float, rgb: Color) -> None:
    """Add an eight-sided bolster along x (axis 0) or y (axis 1), on top of an upright panel `radius` * 2 tan(pi / 8)
    thick that is its fourth box.
    """
    half = np.full(3, radius)
    half[1 - axis] = radius * np.tan(np.pi / 8)
    for eighth in (1, 2, 3):
        half[axis] = half_length - 0.004 * (eighth - 1)  # faces in one plane would flicker in pictures
        turn = np.zeros(3)
        turn[axis] = eighth * np.pi / 4
        parts.add(center, half.copy(), rgb, rot.from_rotvec(turn))


def cushions(
    parts: Parts, count: int, x: tuple[float, float], y: tuple[float, float], z: tuple[float, float], rgb: Color
) -> None:
    """Add a row of cushions along y with seams between them."""
    edges = np.linspace(*y, count + 1)
    for i in range(count):
        parts.box(x, (edges[i] + (SEAM if i else 0.0), edges[i + 1] - (SEAM if i + 1 < count else 0.0)), z, rgb)


def feet(
    parts: Parts, x: tuple[float, float], y: tuple[float, float], height: float, thickness: float, rgb: Color
) -> None:
    """Add four feet inside a rectangle."""
    half = thickness / 2
    for foot_x in (x[0] + half, x[1] - half):
        for foot_y in (y[0] + half, y[1] - half):
            parts.box((foot_x - half, foot_x + half), (foot_y - half, foot_y + half), (0.0, height), rgb)
