"""The elevation map (appendix C.2) of the physical scene. See heightmap.py for the map's layout.

Three makers of the same map. From depth images, as the paper does it: depth beyond 6 m is left out, every other pixel
becomes
a point in the robot's frame, and each cell keeps its highest point. By rays through the cameras' pixels, which is the
same without drawing anything. And by rays straight down, which is what many looks from all sides would add up to: the
cameras do not see what is hidden behind something else, and miss cells that lie between their pixels. Rays are not
followed one by one: `faces.py` knows what all of them meet.

All see shapes only, never labels, and leave out the robot's own body. The frame is the heading frame: its origin is the
root and its x axis the root's heading, but z is up, so that the floor stays level when the robot leans. A cell without
a point is at floor level, as the root's height is known; so the floor itself need not be looked at.
"""

from collections.abc import Sequence

import numpy as np
import torch

from mimicbench.objects.shape import SceneObject
from mimicbench.robots.rigs import HEIGHT, PELVIS_RIG, WIDTH, Rig
from mimicbench.sensors.elevation_cpu import RANGE, Poses, maps_by_cameras, maps_by_rays, tilts
from mimicbench.sensors.heightmap import CELL, CELLS
from mimicbench.sim.physics import Physics

SMALL = 90, 120
"""[px] Rows and columns of cameras whose pictures are only to fill cells of 4 cm."""


def map_from_depth(
    depth: np.ndarray, root_pos: np.ndarray, root_quat: np.ndarray, rig: Rig = PELVIS_RIG, cell: float = CELL
) -> torch.Tensor:
    """(N, 128, 128) elevation maps of depth images: E(g) = max{p_z : proj(p) in g}, relative to the root [m].

    Args:
        depth: (N, C, height, width) of N robots' cameras, along the cameras' axes [m].
        root_pos: (N, 3) where their roots are [m]; only the height is used.
        root_quat: (N, 4) how they are turned.
        rig: The cameras.
        cell: Side of a cell [m].
    """
    rays, origins = rig.rays(*depth.shape[2:]).astype(np.float32), rig.origins().astype(np.float32)
    maps = _floors(root_pos)
    for i, (turn, seen) in enumerate(zip(tilts(root_quat), depth, strict=True)):
        points = np.concatenate(
            [origin + (ray * d[..., None])[d <= RANGE] for origin, ray, d in zip(origins, rays, seen, strict=True)]
        )
        _raise(maps[i], (points @ turn.T).T, cell)
    return torch.from_numpy(maps)


def camera_map(
    physics: Physics,
    ids: np.ndarray | None = None,
    height: int | None = None,
    width: int | None = None,
    rig: Rig = PELVIS_RIG,
    cell: float = CELL,
    workers: int = 0,
) -> torch.Tensor:
    """(N, 128, 128) elevation maps of scenes `ids` (None: all) by the lines of sight of cameras.

    Args:
        physics: The scenes.
        ids: Which of them.
        height: Rows of pixels of each camera; None: 90, and for cells smaller than 4 cm the paper's 360, so that
            few cells are between the pixels.
        width: Columns; None: 120, or 480.
        rig: The cameras.
        cell: Side of a cell [m].
        workers: Threads; 0 for all processors. Changes no byte.
    """
    usual = SMALL if cell >= CELL else (HEIGHT, WIDTH)
    size = height or usual[0], width or usual[1]
    return torch.from_numpy(maps_by_cameras(*_scenes(physics, ids), rig, size, cell, workers))


def down_map(physics: Physics, ids: np.ndarray | None = None, cell: float = CELL, workers: int = 0) -> torch.Tensor:
    """(N, 128, 128) elevation maps of scenes `ids` (None: all) by vertical rays through the cells' centers."""
    return torch.from_numpy(maps_by_rays(*_scenes(physics, ids), cell, workers))


def _scenes(physics: Physics, ids: np.ndarray | None) -> tuple[list[SceneObject], Poses]:
    """The objects of some scenes, and where everything is."""
    ids = np.arange(physics.num_envs) if ids is None else ids
    qpos, (pos, quat) = physics.qpos()[ids], physics.object_pose()
    return [physics.objects[env] for env in ids], Poses(qpos[:, :3], qpos[:, 3:7], pos[ids], quat[ids])


def _floors(root_pos: np.ndarray) -> np.ndarray:
    """(N, 128, 128) maps of nothing but floor."""
    return np.repeat(-root_pos[:, 2].astype(np.float32), CELLS * CELLS).reshape(-1, CELLS, CELLS)


def _raise(heights: np.ndarray, points: Sequence[np.ndarray], cell: float) -> None:
    """Raise the cells of a map (128, 128) to the points of the heading frame that lie in them, given as x, y and z
    (P,).
    """
    row, column = (np.floor(along / np.float32(cell)).astype(np.int32) + CELLS // 2 for along in points[:2])
    inside = (row >= 0) & (row < CELLS) & (column >= 0) & (column < CELLS)
    np.maximum.at(heights.reshape(-1), (row * CELLS + column)[inside], points[2][inside])
