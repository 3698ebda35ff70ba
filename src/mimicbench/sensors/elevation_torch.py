"""Elevation maps of many robots on a graphics card, in torch: the same as `elevation_cpu`, but for rounding.

A card is fast where every robot does the same, and slow where it has to tell the processor how much there is to do.
So every face is filled into whole pictures, hidden ones and those beside the picture included, and no step depends on
what is seen: nothing is copied to the processor's memory.
"""

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from mimicbench.core import rotations as rot
from mimicbench.robots.rigs import Rig
from mimicbench.sensors.elevation_cpu import RANGE, Poses
from mimicbench.sensors.heightmap import CELLS, MapView, cell_centers
from mimicbench.sensors.sight.faces import CRACK
from mimicbench.sensors.sight.surfaces import EDGE_ON, ObjectFaces

_PIXELS = 1 << 23
"""Of pictures that are made at a time: 32 MB for each number of a pixel, and there are some ten."""
_SIDE = CELLS + 2
"""Cells along either side of a map with one more around it, for all that is beyond."""


class SurfaceTable:
    """The faces of the objects of N scenes on a device, in the objects' frames."""

    def __init__(self, faces: Sequence[ObjectFaces], device: str | torch.device) -> None:
        self.device = torch.device(device)
        self._most_seen = np.zeros(len(faces), int)
        self.normals = torch.zeros(len(faces), 0, 5, 3, dtype=torch.float64, device=device)
        """(N, F, 5, 3) of the plane that a face lies in, outwards, and of the planes that bound it."""
        self.offsets = torch.zeros(len(faces), 0, 5, dtype=torch.float64, device=device)
        """(N, F, 5) of these planes [m]; infinite where a scene has fewer faces."""
        self.put(faces, np.arange(len(faces)))

    def put(self, faces: Sequence[ObjectFaces], ids: np.ndarray) -> None:
        """Exchange the objects of scenes `ids`."""
        more = max((len(part.offsets) for part in faces), default=0) - self.offsets.shape[1]
        if more > 0:
            self.normals = torch.nn.functional.pad(self.normals, (0, 0, 0, 0, 0, more))
            self.offsets = torch.nn.functional.pad(self.offsets, (0, 0, 0, more), value=torch.inf)
        normals = np.zeros((len(faces), *self.normals.shape[1:]))
        offsets = np.full((len(faces), *self.offsets.shape[1:]), np.inf)
        for n, part in enumerate(faces):
            normals[n, : len(part.normals)], offsets[n, : len(part.offsets)] = part.normals, part.offsets
        self._most_seen[ids] = [part.most_seen for part in faces]
        index = torch.from_numpy(ids).to(self.device)
        self.normals[index] = torch.from_numpy(normals).to(self.device)
        self.offsets[index] = torch.from_numpy(offsets).to(self.device)

    @property
    def most_seen(self) -> int:
        """How many faces of a scene one eye can see at most."""
        return int(self._most_seen.max(initial=0))


class TorchCameras:
    """Makes maps (M, 128, 128) of what the lines of sight through all pixels of a rig's cameras meet."""

    def __init__(self, rig: Rig, view: MapView, device: str | torch.device) -> None:
        size = view.pixels
        self._origins = torch.from_numpy(rig.origins()).to(device)
        self._sights = torch.from_numpy(rig.sights(*size)).to(device)
        self._size, self._cell = size, view.cell
        self._rows, self._columns = (torch.arange(count, device=device, dtype=torch.float32) for count in size)

    def maps(self, table: SurfaceTable, ids: Tensor, poses: Poses) -> Tensor:
        """(M, 128, 128) float32 of scenes `ids` (M,)."""
        step = max(1, _PIXELS // (len(self._origins) * self._size[0] * self._size[1]))
        parts = [slice(first, first + step) for first in range(0, len(ids), step)]
        return torch.cat([self._part(table, ids[some], poses.part(some)) for some in parts])

    def _part(self, table: SurfaceTable, ids: Tensor, poses: Poses) -> Tensor:
        robots, cameras, (height, width) = len(ids), len(self._origins), self._size
        turn, object_turn = rot.to_matrix(poses.root_quat_w), rot.to_matrix(poses.object_quat_w)
        eyes = (poses.root_pos_w - poses.object_pos_w)[:, None] + self._origins @ turn.mT
        value, edges = _seen_from(table, ids, eyes @ object_turn, (object_turn.mT @ turn)[:, None] @ self._sights)
        inverse = torch.zeros(robots * cameras, height, width, device=table.device)
        _fill(inverse, value.flatten(0, 1), edges.flatten(0, 1))
        inverse = inverse.view(robots, cameras, height, width)
        # points in the heading frame, in single precision as everywhere
        yaw = rot.from_yaw(-rot.yaw_of(poses.root_quat_w))
        tilt = rot.to_matrix(rot.multiply(yaw, poses.root_quat_w)).float()[:, None]
        looks = (tilt[..., None] * self._sights.float()[None, :, None]).sum(-2)
        origins = (tilt * self._origins.float()[None, :, None]).sum(-1)
        depth = 1 / inverse.clamp(min=1 / RANGE)
        x, y, z = (
            origins[..., axis, None, None]
            + depth
            * (
                (looks[..., axis, 0, None] + looks[..., axis, 1, None] * self._rows)[..., None]
                + (looks[..., axis, 2, None] * self._columns)[..., None, :]
            )
            for axis in range(3)
        )
        seen = (inverse >= np.float32(1 / RANGE)) & z.isfinite()
        i, j = (
            torch.where(seen, torch.floor(along / self._cell), 0).clamp(-CELLS // 2 - 1, CELLS // 2).long()
            for along in (x, y)
        )
        entry = (i + _SIDE // 2) * _SIDE + j + _SIDE // 2
        floor = -poses.root_pos_w[:, 2].float()
        maps = floor[:, None].repeat(1, _SIDE * _SIDE)
        z = torch.where(seen, z, -torch.inf)
        maps.scatter_reduce_(1, entry.flatten(1), z.flatten(1), "amax")
        return maps.view(robots, _SIDE, _SIDE)[:, 1:-1, 1:-1]


class TorchRays:
    """Makes maps (M, 128, 128) of what vertical rays through the cells' centers meet."""

    def __init__(self, cell: float, device: str | torch.device) -> None:
        first = cell_centers(CELLS, cell)[0]
        centers = np.array([[first, cell, 0.0], [first, 0.0, cell], [0.0, 0.0, 0.0]])
        self._centers = torch.from_numpy(centers).to(device)

    def maps(self, table: SurfaceTable, ids: Tensor, poses: Poses) -> Tensor:
        """(M, 128, 128) float32 of scenes `ids` (M,)."""
        step = _PIXELS // CELLS**2
        parts = [slice(first, first + step) for first in range(0, len(ids), step)]
        return torch.cat([self._part(table, ids[some], poses.part(some)) for some in parts])

    def _part(self, table: SurfaceTable, ids: Tensor, poses: Poses) -> Tensor:
        starts = rot.to_matrix(rot.from_yaw(rot.yaw_of(poses.root_quat_w))) @ self._centers
        starts[..., 0] += poses.root_pos_w - poses.object_pos_w
        outward = rot.to_matrix(poses.object_quat_w).mT
        starts, up = outward @ starts, outward[:, :, 2]
        facing = (table.normals[ids] @ up[:, None, :, None])[..., 0]
        faces = _first(facing[..., 0] > EDGE_ON, table.most_seen)
        facing = facing.gather(1, faces[..., None].expand(-1, -1, 5))
        normals, offsets = table.normals[ids[:, None], faces], table.offsets[ids[:, None], faces]
        room = -(normals @ starts[:, None])
        room[..., 0] += offsets
        seen = (facing[..., 0] > EDGE_ON) & offsets[..., 0].isfinite()
        value = room[..., 0, :] / torch.where(seen, facing[..., 0], 1)[..., None]
        edges = room[..., 1:, :] - facing[..., 1:, None] * value[..., None, :]
        maps = (-poses.root_pos_w[:, 2].float())[:, None, None].repeat(1, CELLS, CELLS)
        _fill(maps, value, _where_seen(seen, edges))
        return maps


class TorchMaps:
    """The maps of N robots on a device."""

    def __init__(self, faces: Sequence[ObjectFaces], view: MapView, device: str | torch.device) -> None:
        self._table = SurfaceTable(faces, device)
        self._maker = TorchRays(view.cell, device) if view.rig is None else TorchCameras(view.rig, view, device)

    def put(self, faces: Sequence[ObjectFaces], ids: np.ndarray) -> None:
        """Exchange the objects of scenes `ids`."""
        self._table.put(faces, ids)

    def sample(self, ids: Tensor, poses: Poses) -> Tensor:
        """(M, 128, 128) float32 maps of scenes `ids` (M,)."""
        return self._maker.maps(self._table, ids, poses)


def _first(wanted: Tensor, count: int) -> Tensor:
    """(..., count) indices along the last axis, of those that are wanted first."""
    return torch.argsort((~wanted).to(torch.uint8), dim=-1, stable=True)[..., :count]


def _where_seen(seen: Tensor, edges: Tensor) -> Tensor:
    """Edges (..., 4, 3) of faces, of those that are not seen (...) such as no pixel is within."""
    edges = torch.where(seen[..., None, None], edges, 0)
    edges[..., 0] -= (~seen)[..., None].double()
    return edges


def _seen_from(table: SurfaceTable, ids: Tensor, eyes: Tensor, looks: Tensor) -> tuple[Tensor, Tensor]:
    """Values (M, C, K, 3) and edges (M, C, K, 4, 3) of faces from eyes (M, C, 3) with lines of sight (M, C, 3, 3);
    see `Surfaces.seen_from`.
    """
    normals, offsets = table.normals[ids], table.offsets[ids]
    away = eyes @ normals[:, :, 0].mT - offsets[:, None, :, 0]
    faces = _first(away > EDGE_ON, table.most_seen)
    away = away.gather(-1, faces)
    seen, robot = away > EDGE_ON, torch.arange(len(ids), device=ids.device)[:, None, None]
    normals, offsets = normals[robot, faces], torch.where(seen[..., None], offsets[robot, faces], 0)
    across = normals @ looks[:, :, None]
    value = across[..., 0, :] / torch.where(seen, -away, 1)[..., None]
    room = offsets[..., 1:] - (normals[..., 1:, :] @ eyes[:, :, None, :, None])[..., 0]
    edges = room[..., None] * value[..., None, :] - across[..., 1:, :]
    return value, _where_seen(seen, edges)


def _fill(pictures: Tensor, value: Tensor, edges: Tensor) -> None:
    """Raise pictures (P, height, width) to the faces with values (P, K, 3) and edges (P, K, 4, 3); see `Faces.fill`."""
    _, height, width = pictures.shape
    rows = torch.arange(height, device=pictures.device, dtype=torch.float64)[:, None]
    columns = torch.arange(width, device=pictures.device, dtype=torch.float32)
    for face in range(value.shape[1]):
        base, down, along = edges[:, face, None].unbind(-1)
        at, per_row = -(base / along), down / along
        cut = at - per_row * rows
        begin = torch.where(along > 0, cut - CRACK, 0).amax(-1).clamp(min=0).ceil()
        end = torch.where(along < 0, cut + CRACK, width - 1.0).amin(-1).floor()
        end = torch.where(((along == 0) & ~(base + down * rows >= 0)).any(-1), -1, end)
        form = value[:, face, None]
        first = (form[..., 0] + form[..., 1] * rows[:, 0] + form[..., 2] * begin).float()[..., None]
        begin, end = begin.float()[..., None], end.float()[..., None]
        seen = (columns - begin) * form[..., 2, None].float()
        seen += first
        within = (columns >= begin) & (columns <= end)
        torch.maximum(pictures, torch.where(within, seen, -torch.inf), out=pictures)
