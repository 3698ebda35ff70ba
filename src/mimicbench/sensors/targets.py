"""The goal of touch-points as the robot sees it: where its two wrists are to go, in pictures and in the elevation
map (appendix C.2).
"""

import numpy as np
import torch

from mimicbench.core import rotations as rot
from mimicbench.robots.rigs import Rig
from mimicbench.sensors.heightmap import CELLS

TARGET_CELL = 0.01
"""[m] Side of a cell of the maps of touch-points."""
RED = (255, 0, 0)


def mark_targets(
    color: np.ndarray, rig: Rig, root_pos: np.ndarray, root_quat: np.ndarray, targets_w: np.ndarray, radius: int = 0
) -> np.ndarray:
    """The pictures (C, height, width, 3) with the targets' pixels red.

    Nothing hides a target, for a hand that moves before it must not put out the goal.

    Args:
        color: Pictures of all cameras, uint8; they stay as they are.
        rig: The cameras.
        root_pos: (3,) where the robot's root is [m].
        root_quat: (4,) how it is turned.
        targets_w: (K, 3) in the world [m]; NaN where there is none.
        radius: How many more pixels to color on each side, so that people see it too.
    """
    marked, targets_w = color.copy(), targets_w[np.isfinite(targets_w).all(-1)]
    height, width = color.shape[1:3]
    places, depth = rig.project(rot.rotate_inverse(root_quat, targets_w - root_pos), height, width)
    rows, columns = (np.floor(places[..., axis]).astype(int) for axis in (0, 1))
    for camera, target in zip(
        *np.nonzero((depth > 0) & (rows >= 0) & (rows < height) & (columns >= 0) & (columns < width)), strict=True
    ):
        row, column = rows[camera, target], columns[camera, target]
        marked[camera, max(row - radius, 0) : row + radius + 1, max(column - radius, 0) : column + radius + 1] = RED
    return marked


def target_map(
    root_pos: np.ndarray, root_quat: np.ndarray, targets_w: np.ndarray, cell: float = TARGET_CELL
) -> torch.Tensor:
    """(N, 128, 128) maps in the layout of the elevation map that show the targets' heights relative to the root [m],
    and else floor, which is black.

    A target outside of the map is not in it; of two in one cell the higher is.

    Args:
        root_pos: (N, 3) where the robots' roots are [m].
        root_quat: (N, 4) how they are turned; only the heading matters.
        targets_w: (N, K, 3) in the world [m]; NaN where there is none.
        cell: Side of a cell [m].
    """
    heading = rot.from_yaw(rot.yaw_of(root_quat))
    points = rot.rotate_inverse(heading[:, None], targets_w - root_pos[:, None])
    maps = np.repeat(-root_pos[:, 2].astype(np.float32), CELLS * CELLS).reshape(-1, CELLS, CELLS)
    with np.errstate(invalid="ignore"):
        place = np.floor(points[..., :2] / cell) + CELLS // 2
        inside = ((place >= 0) & (place < CELLS)).all(-1)
    n, k = np.nonzero(inside)
    row, column = place[n, k].astype(int).T
    np.maximum.at(maps, (n, row, column), points[n, k, 2].astype(np.float32))
    return torch.from_numpy(maps)
