"""From which sides an object looks alike: its front is then anybody's guess."""

import numpy as np

from mimicbench.objects.heights import surface_height
from mimicbench.objects.shape import SceneObject

GRID = 41
"""Heights are compared at so many places along each side of a square around the object."""
LEVEL = 0.02
"""[m] Heights that differ by less look alike."""
SHARE = 0.95
"""Of the places where something is, that must look alike."""
_TURNS = [
    np.array([[1, 0], [0, 1]]),
    np.array([[0, -1], [1, 0]]),
    np.array([[-1, 0], [0, -1]]),
    np.array([[0, 1], [-1, 0]]),
]
MOTIONS: tuple[np.ndarray, ...] = (*_TURNS, *(turn @ np.array([[1, 0], [0, -1]]) for turn in _TURNS))
"""(2, 2) turns by quarters, and the same after mirroring left and right; the first leaves everything as it is."""


def symmetries(obj: SceneObject) -> list[np.ndarray]:
    """Those of MOTIONS, about the object's origin, after which the object shows the same heights from above.

    A stool has all eight, a bed without head is the same turned by half a circle, a chair only mirrored.
    """
    low, high = obj.bounds()
    reach = float(np.maximum(high, -low)[:2].max())
    axis = np.linspace(-reach, reach, GRID)
    places = np.stack(np.meshgrid(axis, axis, indexing="ij"), -1).reshape(-1, 2)
    here = surface_height(obj, places)
    found = []
    for motion in MOTIONS:
        there = surface_height(obj, places @ motion.T)
        something = (here > 0) | (there > 0)
        if np.mean(np.abs(here - there)[something] < LEVEL) > SHARE:
            found.append(motion)
    return found
