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

from mimicbench.core import rotations as rot
from mimicbench.sensors.faces import Surfaces
from mimicbench.sensors.heightmap import CELL, CELLS, cell_centers
from mimicbench.sensors.rigs import HEIGHT, PELVIS_RIG, WIDTH, Rig
from mimicbench.sim.physics import Physics

RANGE = 6.0
"""[m] Depth beyond this is left out (C.2)."""
SMALL = 90, 120
"""[px] Rows and columns of cameras whose pictures are only to fill cells of 4 cm."""
_PIXELS_AT_ONCE = 1 << 18
"""Of lines of sight that are in memory at a time, so that a processor's cache holds much of it: up to 20 MB."""


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
    for i, (turn, seen) in enumerate(zip(_tilts(root_quat), depth, strict=True)):
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
    """
    ids = np.arange(physics.num_envs) if ids is None else ids
    usual = SMALL if cell >= CELL else (HEIGHT, WIDTH)
    height, width = height or usual[0], width or usual[1]
    qpos = physics.qpos()[ids]
    root_pos, turn, tilt = qpos[:, :3], rot.to_matrix(qpos[:, 3:7]), _tilts(qpos[:, 3:7])
    object_pos, object_turn = _object_frames(physics, ids)
    origins, sights = rig.origins(), rig.sights(height, width)
    # cameras in the objects' frames, and their lines of sight in the heading frame
    eyes = ((root_pos - object_pos)[:, None] + (turn[:, None] @ origins[..., None])[..., 0])[
        ..., None, :
    ] @ object_turn[:, None]
    looks = (object_turn.swapaxes(1, 2) @ turn)[:, None] @ sights
    origin_h, look_h = (
        (tilt[:, None] @ origins.astype(np.float32)[..., None])[..., 0],
        tilt[:, None] @ sights.astype(np.float32),
    )
    rows, columns = (place.ravel().astype(np.float32) for place in np.indices((height, width)))
    maps = _floors(root_pos)
    for some in _parts(len(ids), len(sights) * height * width):
        inverse = np.zeros((len(ids[some]) * len(sights), height, width), np.float32)
        Surfaces.of([physics.objects[env] for env in ids[some]]).seen_from(eyes[some, :, 0], looks[some]).fill(inverse)
        for seen, n, camera in zip(
            inverse.reshape(len(inverse), -1), *np.divmod(np.arange(len(inverse)), len(sights)), strict=True
        ):
            pixel = np.flatnonzero(seen >= 1 / RANGE)
            depth, row, column = 1 / seen[pixel], rows[pixel], columns[pixel]
            origin, look = origin_h[some][n, camera], look_h[some][n, camera]
            _raise(
                maps[some][n],
                [
                    at + depth * (form[0] + form[1] * row + form[2] * column)
                    for at, form in zip(origin, look, strict=True)
                ],
                cell,
            )
    return torch.from_numpy(maps)


def down_map(physics: Physics, ids: np.ndarray | None = None, cell: float = CELL) -> torch.Tensor:
    """(N, 128, 128) elevation maps of scenes `ids` (None: all) by vertical rays through the cells' centers."""
    ids = np.arange(physics.num_envs) if ids is None else ids
    qpos = physics.qpos()[ids]
    root_pos, heading = qpos[:, :3], rot.to_matrix(rot.from_yaw(rot.yaw_of(qpos[:, 3:7])))
    object_pos, object_turn = _object_frames(physics, ids)
    first = cell_centers(CELLS, cell)[0]
    starts = heading @ np.array([[first, cell, 0.0], [first, 0.0, cell], [0.0, 0.0, 0.0]])
    starts[..., 0] += root_pos - object_pos
    outward = object_turn.swapaxes(1, 2)
    starts, looks = outward @ starts, -outward[:, :, 2]
    maps = _floors(root_pos)
    for some in _parts(len(ids), CELLS * CELLS):
        Surfaces.of([physics.objects[env] for env in ids[some]]).seen_along(starts[some], looks[some]).fill(maps[some])
    return torch.from_numpy(maps)


def _object_frames(physics: Physics, ids: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where the objects are (N, 3) [m], and matrices (N, 3, 3) from their frames to the world's."""
    pos, quat = physics.object_pose()
    return pos[ids], rot.to_matrix(quat[ids])


def _parts(robots: int, pixels: int) -> list[slice]:
    """Some robots at a time."""
    step = max(1, _PIXELS_AT_ONCE // pixels)
    return [slice(first, first + step) for first in range(0, robots, step)]


def _floors(root_pos: np.ndarray) -> np.ndarray:
    """(N, 128, 128) maps of nothing but floor."""
    return np.repeat(-root_pos[:, 2].astype(np.float32), CELLS * CELLS).reshape(-1, CELLS, CELLS)


def _tilts(root_quat: np.ndarray) -> np.ndarray:
    """(N, 3, 3) float32: from the root's frame to its heading frame."""
    return rot.to_matrix(rot.multiply(rot.from_yaw(-rot.yaw_of(root_quat)), root_quat)).astype(np.float32)


def _raise(heights: np.ndarray, points: Sequence[np.ndarray], cell: float) -> None:
    """Raise the cells of a map (128, 128) to the points of the heading frame that lie in them, given as x, y and z
    (P,).
    """
    row, column = (np.floor(along / np.float32(cell)).astype(np.int32) + CELLS // 2 for along in points[:2])
    inside = (row >= 0) & (row < CELLS) & (column >= 0) & (column < CELLS)
    np.maximum.at(heights.reshape(-1), (row * CELLS + column)[inside], points[2][inside])
