"""A file's axes, such as `y+`, and how they are turned to x forward, z up."""

from typing import Literal

import numpy as np

Axis = Literal["x+", "x-", "y+", "y-", "z+", "z-"]


def usual_front(up: str) -> str:
    """ShapeNet has y up and -z in front; with z up, -y is usual."""
    return {"x": "z-", "y": "z-", "z": "y-"}[up[0]]


def _vector(axis: str) -> np.ndarray:
    vector = np.zeros(3)
    vector["xyz".index(axis[0])] = 1.0 if axis[1] == "+" else -1.0
    return vector


def rotation(up: str, front: str) -> np.ndarray:
    """(3, 3) that turns the file's `front` to +x and its `up` to +z."""
    x, z = _vector(front), _vector(up)
    return np.stack([x, np.cross(z, x), z])
