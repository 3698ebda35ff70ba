"""The elevation map (appendix C.2) of the physical scene. See heightmap.py for the map's layout.

Three makers of the same map. From depth images, as the paper does it: depth beyond 6 m is left out, every other pixel becomes
a point in the robot's frame, and each cell keeps its highest point. By rays through the cameras' pixels, which is the
same without drawing anything. And by rays straight down, which is what many looks from all sides would add up to: the
cameras do not see what is hidden behind something else, and miss cells that lie between their pixels.

All see shapes only, never labels, and leave out the robot's own body. The frame is the heading frame: its origin is the
root and its x axis the root's heading, but z is up, so that the floor stays level when the robot leans. A cell without
a point is at floor level, as the root's height is known; so lines of sight that can only meet the floor need not be followed.
"""

import numpy as np
import torch

from mimicbench.core import rotations as rot
from mimicbench.sense.heightmap import CELL, CELLS, cell_centers
from mimicbench.sense.rays import bounding_spheres, cast
from mimicbench.sense.rigs import PELVIS_RIG, Rig
from mimicbench.sim.physics import Physics

RANGE = 6.0
"""[m] Depth beyond this is left out (C.2)."""
_AT_ONCE = 64
"""Robots whose lines of sight are in memory at a time, up to 2 MB each."""


def map_from_depth(depth: np.ndarray, root_pos: np.ndarray, root_quat: np.ndarray, rig: Rig = PELVIS_RIG, cell: float = CELL) -> torch.Tensor:
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
        points = np.concatenate([origin + (ray * d[..., None])[d <= RANGE] for origin, ray, d in zip(origins, rays, seen, strict=True)])
        _raise(maps[i], points @ turn.T, cell)
    return torch.from_numpy(maps)


def camera_map(physics: Physics, ids: np.ndarray | None = None, height: int = 90, width: int = 120, rig: Rig = PELVIS_RIG, cell: float = CELL) -> torch.Tensor:
    """(N, 128, 128) elevation maps of scenes `ids` (None: all) by the lines of sight of cameras of `height` x `width` pixels."""
    ids = np.arange(physics.num_envs) if ids is None else ids
    if len(ids) > _AT_ONCE:
        parts = [ids[first : first + _AT_ONCE] for first in range(0, len(ids), _AT_ONCE)]
        return torch.cat([camera_map(physics, some, height, width, rig, cell) for some in parts])
    root_pos, root_quat = physics.qpos()[ids, :3], physics.qpos()[ids, 3:7]
    rays, origins = rig.rays(height, width).reshape(len(rig.mounts), -1, 3), rig.origins()
    units = (rays / np.linalg.norm(rays, axis=-1, keepdims=True)).astype(np.float32)
    center, radius = bounding_spheres(physics, ids)
    maps = _floors(root_pos)
    eyes, looks = [], []
    for pos, quat, middle, reach in zip(root_pos, root_quat, center, radius, strict=True):
        to_object = rot.rotate_inverse(quat, middle - pos) - origins
        near = [_within(unit, to, reach) for unit, to in zip(units, to_object, strict=True)]
        eyes.append(np.repeat(origins, [len(some) for some in near], 0))
        looks.append(np.concatenate([ray[some] for ray, some in zip(rays, near, strict=True)]))
    turns = rot.to_matrix(root_quat)
    depths = cast(physics, ids, [pos + eye @ turn.T for pos, turn, eye in zip(root_pos, turns, eyes, strict=True)],
                   [look @ turn.T for turn, look in zip(turns, looks, strict=True)])  # fmt: skip
    for i, (turn, eye, look, depth) in enumerate(zip(_tilts(root_quat), eyes, looks, depths, strict=True)):
        hit = (depth >= 0) & (depth <= RANGE)
        _raise(maps[i], (eye[hit] + look[hit] * depth[hit, None]).astype(np.float32) @ turn.T, cell)
    return torch.from_numpy(maps)


def down_map(physics: Physics, ids: np.ndarray | None = None, cell: float = CELL) -> torch.Tensor:
    """(N, 128, 128) elevation maps of scenes `ids` (None: all) by vertical rays through the cells' centers."""
    ids = np.arange(physics.num_envs) if ids is None else ids
    root_pos, yaw = physics.qpos()[ids, :3], rot.yaw_of(physics.qpos()[ids, 3:7])
    center, radius = bounding_spheres(physics, ids)
    axis = cell_centers(CELLS, cell)
    maps = _floors(root_pos).reshape(len(ids), -1)
    cells, starts = [], []
    for pos, cos, sin, middle, reach in zip(root_pos, np.cos(yaw), np.sin(yaw), center, radius, strict=True):
        dx, dy = middle[:2] - pos[:2]
        x, y = axis - (cos * dx + sin * dy), axis - (cos * dy - sin * dx)
        row, column = np.nonzero(x[:, None] ** 2 + y[None, :] ** 2 <= reach**2)
        cells.append(row * CELLS + column)
        x, y = axis[row], axis[column]
        starts.append(np.stack([pos[0] + cos * x - sin * y, pos[1] + sin * x + cos * y, np.full(len(x), middle[2] + reach)], -1))
    depths = cast(physics, ids, starts, [np.broadcast_to([0.0, 0.0, -1.0], start.shape) for start in starts])
    for i, (some, start, depth) in enumerate(zip(cells, starts, depths, strict=True)):
        hit = depth >= 0
        maps[i, some[hit]] = np.maximum(maps[i, some[hit]], start[hit, 2] - depth[hit] - root_pos[i, 2])
    return torch.from_numpy(maps.reshape(-1, CELLS, CELLS))


def _within(units: np.ndarray, to_object: np.ndarray, radius: float) -> np.ndarray:
    """Which of the directions (R, 3) can meet a sphere at `to_object` (3,)."""
    distance = float(np.linalg.norm(to_object))
    if distance <= radius:
        return np.arange(len(units))
    # a hair wider than the cone around the sphere, for directions are rounded
    return np.flatnonzero(units @ (to_object / distance).astype(np.float32) >= np.sqrt(1 - (radius / distance) ** 2) - 1e-6)


def _floors(root_pos: np.ndarray) -> np.ndarray:
    """(N, 128, 128) maps of nothing but floor."""
    return np.repeat(-root_pos[:, 2].astype(np.float32), CELLS * CELLS).reshape(-1, CELLS, CELLS)


def _tilts(root_quat: np.ndarray) -> np.ndarray:
    """(N, 3, 3) float32: from the root's frame to its heading frame."""
    return rot.to_matrix(rot.multiply(rot.from_yaw(-rot.yaw_of(root_quat)), root_quat)).astype(np.float32)


def _raise(heights: np.ndarray, points: np.ndarray, cell: float) -> None:
    """Raise the cells of a map (128, 128) to the points (P, 3) of the heading frame that lie in them."""
    place = np.floor(points[:, :2] / np.float32(cell)).astype(np.int32) + CELLS // 2
    inside = ((place >= 0) & (place < CELLS)).all(-1)
    np.maximum.at(heights.reshape(-1), place[inside, 0] * CELLS + place[inside, 1], points[inside, 2])
