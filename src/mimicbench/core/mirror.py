"""Left and right exchanged: the mirror stands upright along x, so y changes its sign."""

import numpy as np

SPECULAR = np.array([1.0, -1.0, 1.0])
"""What positions (..., 3) are multiplied by."""
SPECULAR_QUAT = np.array([1.0, -1.0, 1.0, -1.0])
"""What quaternions (..., 4) are multiplied by: turns about y stay, those about x and z go the other way."""


def other_side(name: str) -> str:
    """With left in place of right and right in place of left."""
    return name.replace("left", "\0").replace("right", "left").replace("\0", "right")


def toggled(name: str) -> str:
    """An id with `~mirror` at its end, or without it."""
    return name.removesuffix("~mirror") if name.endswith("~mirror") else f"{name}~mirror"
