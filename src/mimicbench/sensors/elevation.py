"""The elevation map (appendix C.2) of the physical scene. See heightmap.py for the map's layout.

Three makers of the same map. From depth images, as the paper does it: depth beyond 6 m is left out, every other pixel
becomes a point in the robot's frame, and each cell keeps its highest point. By rays through the cameras' pixels, which
is the same without drawing anything. And by rays straight down, which is what many looks from all sides would add up
to: the cameras do not see what is hidden behind something else, and miss cells that lie between their pixels. Rays are
not followed one by one: `sight/faces.py` knows what all of them meet.

All see shapes only, never labels, and leave out the robot's own body. The frame is the heading frame: its origin is the
root and its x axis the root's heading, but z is up, so that the floor stays level when the robot leans. A cell without
a point is at floor level, as the root's height is known; so the floor itself need not be looked at.
"""

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from mimicbench.objects.shape import SceneObject
from mimicbench.robots.rigs import PELVIS_RIG, Rig
from mimicbench.sensors.elevation_cpu import RANGE, Poses, maps_by_cameras, maps_by_rays, tilts
from mimicbench.sensors.elevation_torch import TorchMaps
from mimicbench.sensors.heightmap import CELL, CELLS, MapView
from mimicbench.sensors.sight.surfaces import ObjectFaces, faces_of
from mimicbench.sim.physics import Physics


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
    faces, poses = _scenes(physics, ids)
    size = MapView(rig, cell).pixels
    return torch.from_numpy(maps_by_cameras(faces, poses, rig, (height or size[0], width or size[1]), cell, workers))


def down_map(physics: Physics, ids: np.ndarray | None = None, cell: float = CELL, workers: int = 0) -> torch.Tensor:
    """(N, 128, 128) elevation maps of scenes `ids` (None: all) by vertical rays through the cells' centers."""
    return torch.from_numpy(maps_by_rays(*_scenes(physics, ids), cell, workers))


def _scenes(physics: Physics, ids: np.ndarray | None) -> tuple[list[ObjectFaces], Poses]:
    """The objects of some scenes, and where everything is."""
    ids = np.arange(physics.num_envs) if ids is None else ids
    qpos, (pos, quat), scenes = physics.qpos()[ids], physics.object_pose(), physics.objects
    return [faces_of(scenes[env]) for env in ids], Poses(qpos[:, :3], qpos[:, 3:7], pos[ids], quat[ids])


class ElevationMaps:
    """The maps of N robots, each beside its own object, which may move, as tensors on a device.

    On a processor the threads share the robots, and the maps are the bytes that `camera_map` and `down_map` make of the
    same poses in double precision, whatever the number of threads. On any other device all work is done there, and
    nothing is copied to the processor's memory.
    """

    def __init__(
        self,
        objects: Sequence[SceneObject],
        view: MapView | None = None,
        device: str | torch.device = "cpu",
        workers: int = 0,
    ) -> None:
        """Prepare the objects' faces; they are kept while they are in a scene, and of others the last 2048.

        Args:
            objects: (N,) one beside each robot.
            view: How the maps are looked at.
            device: Where the maps are made and wanted.
            workers: Threads on a processor; 0 for all processors.
        """
        self.view, self.device, self._workers = view or MapView(), torch.device(device), workers
        self._faces = [faces_of(obj) for obj in objects]
        self._there = None if self.device.type == "cpu" else TorchMaps(self._faces, self.view, self.device)

    def set_objects(self, objects: Sequence[SceneObject], ids: np.ndarray | None = None) -> None:
        """Exchange the objects of scenes `ids` (None: all)."""
        ids = np.arange(len(self._faces)) if ids is None else ids
        faces = [faces_of(obj) for obj in objects]
        for env, part in zip(ids, faces, strict=True):
            self._faces[env] = part
        if self._there is not None:
            self._there.put(faces, ids)

    def sample(
        self,
        root_pos_w: Tensor,
        root_quat_w: Tensor,
        object_pos_w: Tensor | None = None,
        object_quat_w: Tensor | None = None,
        ids: Tensor | None = None,
    ) -> Tensor:
        """(M, 128, 128) float32 maps of scenes `ids` (None: all), heights relative to the root [m].

        Args:
            root_pos_w: (M, 3) where the robots' roots are [m].
            root_quat_w: (M, 4) how they are turned.
            object_pos_w: (M, 3) where the objects are [m]; None: at the origin.
            object_quat_w: (M, 4) how they are turned; None: not at all.
            ids: (M,) which scenes.
        """
        ids = torch.arange(len(self._faces), device=self.device) if ids is None else ids
        root_pos_w, root_quat_w = root_pos_w.double(), root_quat_w.double()
        object_pos_w = torch.zeros_like(root_pos_w) if object_pos_w is None else object_pos_w.double()
        if object_quat_w is None:
            object_quat_w = torch.zeros_like(root_quat_w)
            object_quat_w[:, 0] = 1
        poses = root_pos_w, root_quat_w, object_pos_w, object_quat_w.double()
        if self._there is not None:
            return self._there.sample(ids, Poses(*poses))
        faces, arrays = [self._faces[env] for env in ids.tolist()], Poses(*(pose.numpy() for pose in poses))
        if self.view.rig is None:
            return torch.from_numpy(maps_by_rays(faces, arrays, self.view.cell, self._workers))
        maps = maps_by_cameras(faces, arrays, self.view.rig, self.view.pixels, self.view.cell, self._workers)
        return torch.from_numpy(maps)


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
