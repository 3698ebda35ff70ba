"""Elevation maps of many robots on the threads of a processor, in NumPy.

Robots are independent of each other, so they are shared out in parts, and a part gives the same bytes in any thread
and beside any others. NumPy and torch let other threads run while they work on large arrays, so parts are of several
robots, and what is done to single pixels is done to as many at a time as a processor's cache holds.
"""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.parallel import cpu_count
from mimicbench.robots.rigs import Rig
from mimicbench.sensors.heightmap import CELLS, cell_centers
from mimicbench.sensors.sight.faces import Faces, raise_to
from mimicbench.sensors.sight.surfaces import ObjectFaces, Surfaces

RANGE = 6.0
"""[m] Depth beyond this is left out (C.2)."""
_ROBOTS = 64
"""In a part, at most."""
_PIXELS = 1 << 16
"""Of pictures that become points at a time."""
_SIDE = CELLS + 2
"""Cells along either side of a map with one more around it, for all that is beyond."""


@dataclass(frozen=True)
class Poses:
    """Where N robots and their objects are, float64, as arrays or as tensors."""

    root_pos_w: rot.Array
    """(N, 3) [m]."""
    root_quat_w: rot.Array
    """(N, 4)."""
    object_pos_w: rot.Array
    """(N, 3) [m]."""
    object_quat_w: rot.Array
    """(N, 4)."""

    def part(self, some: slice) -> "Poses":
        """Those of some robots."""
        return Poses(self.root_pos_w[some], self.root_quat_w[some], self.object_pos_w[some], self.object_quat_w[some])


def maps_by_cameras(
    faces: Sequence[ObjectFaces],
    poses: Poses,
    rig: Rig,
    size: tuple[int, int],
    cell: float,
    workers: int = 0,
) -> np.ndarray:
    """(N, 128, 128) float32 maps of what the lines of sight through all pixels of a rig's cameras meet.

    Args:
        faces: (N,) of the objects beside the robots.
        poses: Of robots and objects.
        rig: The cameras.
        size: Rows and columns of their pictures [px].
        cell: Side of a cell [m].
        workers: Threads; 0 for all processors. Changes no byte.
    """
    maps = np.empty((len(faces), CELLS, CELLS), np.float32)

    def make(some: slice) -> None:
        _Pictures.of(faces[some], poses.part(some), rig, size).raise_cells(maps[some], cell)

    in_threads(make, len(faces), workers)
    return maps


def maps_by_rays(faces: Sequence[ObjectFaces], poses: Poses, cell: float, workers: int = 0) -> np.ndarray:
    """(N, 128, 128) float32 maps of what vertical rays through the cells' centers meet; see `maps_by_cameras`."""
    maps = np.empty((len(faces), CELLS, CELLS), np.float32)
    first = cell_centers(CELLS, cell)[0]
    centers = np.array([[first, cell, 0.0], [first, 0.0, cell], [0.0, 0.0, 0.0]])

    def make(some: slice) -> None:
        part = poses.part(some)
        starts = rot.to_matrix(rot.from_yaw(rot.yaw_of(part.root_quat_w))) @ centers
        starts[..., 0] += part.root_pos_w - part.object_pos_w
        outward = rot.to_matrix(part.object_quat_w).swapaxes(1, 2)
        seen = Surfaces.of(faces[some]).seen_along(outward @ starts, -outward[:, :, 2], CELLS, CELLS)
        maps[some] = -part.root_pos_w[:, 2].astype(np.float32)[:, None, None]
        seen.fill(maps[some].reshape(-1, CELLS), np.arange(len(maps[some])) * CELLS)

    in_threads(make, len(faces), workers)
    return maps


def tilts(root_quat: np.ndarray) -> np.ndarray:
    """(N, 3, 3) float32: from the root's frame to its heading frame."""
    return rot.to_matrix(rot.multiply(rot.from_yaw(-rot.yaw_of(root_quat)), root_quat)).astype(np.float32)


def in_threads(make: Callable[[slice], None], robots: int, workers: int) -> None:
    """Call `make` for parts of the robots, on several threads; 0 for all processors."""
    workers = workers or cpu_count()
    step = min(_ROBOTS, max(4, -(-robots // workers)))
    parts = [slice(first, first + step) for first in range(0, robots, step)]

    def quietly(part: slice) -> None:
        with np.errstate(all="ignore"):  # of a scene that broke nothing is seen, and whoever steps it says so
            make(part)

    if min(workers, len(parts)) <= 1:
        for part in parts:
            quietly(part)
    else:
        for _ in _threads(workers, os.getpid()).map(quietly, parts):
            pass


@lru_cache(maxsize=1)
def _threads(workers: int, process: int) -> ThreadPoolExecutor:
    """Threads to be used again, for a few maps cost less than to start some; a forked process has to have its own."""
    return ThreadPoolExecutor(workers, f"maps-of-{process}")


def faces_seen(surfaces: Sequence[ObjectFaces], poses: Poses, rig: Rig, size: tuple[int, int]) -> Faces:
    """The faces of N objects that the C cameras of N robots see, picture n C + c being that of camera c of robot n, by
    the inverse of depth [1/m].
    """
    turn, object_turn = rot.to_matrix(poses.root_quat_w), rot.to_matrix(poses.object_quat_w)
    # cameras and lines of sight in the objects' frames
    eyes = (poses.root_pos_w - poses.object_pos_w)[:, None] + (turn[:, None] @ rig.origins()[..., None])[..., 0]
    eyes = (eyes[..., None, :] @ object_turn[:, None])[:, :, 0]
    looks = (object_turn.swapaxes(1, 2) @ turn)[:, None] @ rig.sights(*size)
    return Surfaces.of(surfaces).seen_from(eyes, looks, *size)


@dataclass(frozen=True)
class _Pictures:
    """What the cameras of some robots see. Of each picture there are only the rows that have something in them."""

    rows: np.ndarray
    """(R, width) float32 inverse depth [1/m], 0 where nothing is."""
    places: np.ndarray
    """(11, R) float32 of each row: looks at its column 0 (3) and how they change from column to column (3), the
    camera (3), all in the heading frame [m]; the entry of the map's middle in the maps of all robots, of 130 x 130
    cells each; and the place of column 0 among all pixels, which whoever takes some of the rows writes."""
    root_height: np.ndarray
    """(N,) [m] float32."""

    @staticmethod
    def of(surfaces: Sequence[ObjectFaces], poses: Poses, rig: Rig, size: tuple[int, int]) -> "_Pictures":
        """Of some robots."""
        origins, sights = rig.origins(), rig.sights(*size)
        faces = faces_seen(surfaces, poses, rig, size)
        first, last = np.full(len(surfaces) * len(sights), size[0]), np.full(len(surfaces) * len(sights), -1)
        np.minimum.at(first, faces.picture, faces.first)
        np.maximum.at(last, faces.picture, faces.last)
        count = np.maximum(last - first + 1, 0)
        start = np.cumsum(count) - count - first
        rows = np.zeros((count.sum(), size[1]), np.float32)
        faces.fill(rows, start)
        # the same cameras and lines of sight in the heading frames
        tilt = tilts(poses.root_quat_w)[:, None]
        cameras = (tilt @ origins.astype(np.float32)[..., None])[..., 0].reshape(-1, 3).T
        looks = (tilt @ sights.astype(np.float32)).reshape(-1, 3, 3).transpose(2, 1, 0)
        picture = np.repeat(np.arange(len(count)), count)
        row = (np.arange(len(rows)) - start[picture]).astype(np.float32)
        looks = looks[..., picture]
        places = np.empty((11, len(rows)), np.float32)
        places[:3], places[3:6], places[6:9] = looks[0] + looks[1] * row, looks[2], cameras[:, picture]
        places[9] = picture // len(sights) * _SIDE**2 + _SIDE // 2 * (_SIDE + 1)
        return _Pictures(rows, places, poses.root_pos_w[:, 2].astype(np.float32))

    def raise_cells(self, maps: np.ndarray, cell: float) -> None:
        """Write the maps (N, 128, 128): floor, and the cells raised to the points that are in them."""
        padded = np.repeat(-self.root_height, _SIDE**2)
        step = max(1, _PIXELS // self.rows.shape[1])
        for first in range(0, len(self.rows), step):
            self._raise(padded, slice(first, first + step), np.float32(cell))
        maps[:] = padded.reshape(-1, _SIDE, _SIDE)[:, 1:-1, 1:-1]

    def _raise(self, padded: np.ndarray, some: slice, cell: np.float32) -> None:
        """Raise the cells of all maps (N * 130 * 130,) to the points of some rows."""
        rows, places = self.rows[some], self.places[:, some]
        begins = np.arange(len(rows) + 1) * rows.shape[1]
        places[10] = begins[:-1]
        pixel = np.flatnonzero(rows >= np.float32(1 / RANGE))
        slopes = np.repeat(places, np.diff(np.searchsorted(pixel, begins)), axis=1)
        looks, points, cameras, middle, begin = slopes[:3], slopes[3:6], slopes[6:9], slopes[9], slopes[10]
        column = pixel.astype(np.float32)
        column -= begin
        points *= column
        points += looks
        points *= 1 / rows.reshape(-1)[pixel]
        points += cameras
        # what is beyond the map goes to the cells around it
        place = points[:2] / cell
        np.floor(place, out=place)
        np.clip(place, -CELLS // 2 - 1, CELLS // 2, out=place)
        entry = place[0]
        entry *= np.float32(_SIDE)
        entry += place[1]
        entry += middle
        raise_to(padded, entry.astype(np.intp), points[2])
