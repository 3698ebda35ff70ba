"""The elevation map (appendix C.2) by casting rays into the physical scene.

Two ways that fill the same map: through the four cameras around the pelvis, which do not see what is hidden behind
something else, and straight down, which is what many looks from all sides would add up to. Both see shapes only. The
robot's own body is left out. See heightmap.py for the map's layout.
"""

import numpy as np
import torch

from mimicbench.core import rotations as rot
from mimicbench.sense.heightmap import CELL, CELLS, cell_centers
from mimicbench.sim.native import NativePhysics
from mimicbench.sim.scene import FLOOR_GROUP, OBJECT_GROUP

RANGE = 6.0
"""[m] Depth beyond this is left out (C.2)."""
PITCH = np.deg2rad(35.0)
"""Every camera looks down by this (C.2)."""
FIELD_OF_VIEW = np.deg2rad(120.0)
"""Horizontal opening of every camera (C.2)."""
BEARINGS = np.deg2rad([-45.0, 45.0, 135.0, -135.0])
"""Right front, left front, left back, right back (C.2)."""


def camera_rays(height: int, width: int) -> np.ndarray:
    """(4 * height * width, 3) unit directions of all pixels of the four cameras, in the root frame."""
    focal = 0.5 * width / np.tan(0.5 * FIELD_OF_VIEW)
    u = (np.arange(width) + 0.5 - width / 2) / focal
    v = (np.arange(height) + 0.5 - height / 2) / focal
    v, u = np.meshgrid(v, u, indexing="ij")
    # camera looking along +x: image right is -y, image down is -z
    rays = np.stack([np.ones_like(u), -u, -v], -1).reshape(-1, 3)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    turns = rot.multiply(rot.from_yaw(BEARINGS), rot.from_rotvec(np.array([0.0, PITCH, 0.0]))[None].repeat(4, 0))
    return rot.rotate(turns[:, None], rays[None]).reshape(-1, 3)


def camera_map(physics: NativePhysics, ids: np.ndarray | None = None, height: int = 90, width: int = 120) -> torch.Tensor:
    """(N, 128, 128) elevation maps of scenes `ids` (None: all) as the pelvis cameras see them; unseen cells are at floor level."""
    ids = np.arange(physics.num_envs) if ids is None else ids
    rays = camera_rays(height, width)
    maps = []
    for chunk in np.array_split(ids, max(1, len(ids) // 32)):  # 32 robots at a time bound the memory
        root_pos, root_quat = physics.qpos()[chunk, :3], physics.qpos()[chunk, 3:7]
        directions = rot.rotate(root_quat[:, None], rays[None])
        depth, _ = physics.batch.ray(root_pos[:, None], directions, geomgroup=_groups(), ids=chunk)
        points = directions * depth[..., None]
        hit = (depth > 0) & (depth < RANGE)
        maps.append(_project(points, hit, root_pos, root_quat))
    return torch.from_numpy(np.concatenate(maps))


def down_map(physics: NativePhysics, ids: np.ndarray | None = None) -> torch.Tensor:
    """(N, 128, 128) elevation maps of scenes `ids` (None: all) by vertical rays through the cells' centres."""
    ids = np.arange(physics.num_envs) if ids is None else ids
    axis = cell_centers(CELLS, CELL)
    x, y = (part.ravel() for part in np.meshgrid(axis, axis, indexing="ij"))
    root_pos, yaw = physics.qpos()[ids, :3], rot.yaw_of(physics.qpos()[ids, 3:7])
    cos, sin = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    top = 4.0
    origin = np.stack([root_pos[:, :1] + cos * x - sin * y, root_pos[:, 1:2] + sin * x + cos * y, np.full((len(ids), x.size), top)], -1)
    depth, _ = physics.batch.ray(origin, np.array([0.0, 0.0, -1.0]), geomgroup=_groups(), ids=ids)
    maps = (top - depth - root_pos[:, 2:]).astype(np.float32)
    return torch.from_numpy(maps.reshape(-1, CELLS, CELLS))


def _project(points: np.ndarray, hit: np.ndarray, root_pos: np.ndarray, root_quat: np.ndarray) -> np.ndarray:
    """Highest point of each cell: E(g) = max{p_z : proj(p) in g}. Points (N, R, 3) are relative to the root, world axes [m]."""
    n = len(points)
    yaw = rot.yaw_of(root_quat)[:, None]
    x = np.cos(yaw) * points[..., 0] + np.sin(yaw) * points[..., 1]
    y = np.cos(yaw) * points[..., 1] - np.sin(yaw) * points[..., 0]
    row, column = np.floor(x / CELL + CELLS / 2).astype(int), np.floor(y / CELL + CELLS / 2).astype(int)
    inside = hit & (row >= 0) & (row < CELLS) & (column >= 0) & (column < CELLS)
    maps = np.repeat(-root_pos[:, 2:].astype(np.float32), CELLS * CELLS, 1)
    env = np.broadcast_to(np.arange(n)[:, None], row.shape)
    np.maximum.at(maps.reshape(-1), (env * CELLS * CELLS + row * CELLS + column)[inside], points[..., 2][inside].astype(np.float32))
    return maps.reshape(n, CELLS, CELLS)


def _groups() -> np.ndarray:
    """Geom groups that the rays see."""
    groups = np.zeros(6, np.uint8)
    groups[[OBJECT_GROUP, FLOOR_GROUP]] = 1
    return groups
