"""What a robot sees to rise from the floor around its goal."""

import numpy as np


def extent(around: np.ndarray) -> np.ndarray:
    """(2, 2) lowest and highest x, y [m] of points (M, 3) and the origin."""
    places = np.concatenate([around[:, :2], np.zeros((1, 2))])
    return np.stack([places.min(0), places.max(0)])
