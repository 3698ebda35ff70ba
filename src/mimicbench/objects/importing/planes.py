"""Finds the planes of a mesh to sit or lie on: level, free above, and large enough.

Vertical lines stand on a grid of 2 cm. Where one passes through the mesh, there is a surface; it can be sat on if it is
level, at the right height, faces up, and nothing is above it for the headroom. Neighboring lines with such surfaces
within a few centimetres of one height make a plane, and the largest is the one.
"""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage
from scipy.spatial import ConvexHull

from mimicbench.core.errors import BadObject
from mimicbench.objects.importing.mesh import Mesh

CELL = 0.02
"""[m] between the vertical lines."""
MAX_CROSSINGS = 8_000_000
"""Pairs of line and triangle that are looked at, before a mesh is refused."""
LEVEL = 0.94
"""Least vertical part of the normal of a level surface: 20 degrees."""
BAND = 0.03
"""[m]; a plane's surface is within this of one height; cushions are curved."""


@dataclass(frozen=True)
class PlaneNeeds:
    """What a plane must have to be of use."""

    heights: tuple[float, float]
    """Least and largest height above the floor [m]."""
    headroom: float
    """Nothing is above it for this [m]."""
    size: tuple[float, float]
    """Shorter and longer side of a rectangle that must fit on it [m]."""


SIT = PlaneNeeds((0.25, 0.75), 0.5, (0.30, 0.34))
LIE = PlaneNeeds((0.20, 0.80), 0.5, (0.45, 1.40))


@dataclass(frozen=True)
class Surfaces:
    """Where vertical lines pass through a mesh, ordered by line and then by height; N of them."""

    cell: np.ndarray
    """(N, 2) which line, as row (x) and column (y) of the grid."""
    height: np.ndarray
    """(N,) [m]."""
    level: np.ndarray
    """(N,) vertical part of the unit normal, in 0..1."""
    gap: np.ndarray
    """(N,) to the next surface above [m]; infinity if there is none."""
    up: np.ndarray
    """(N,) whether it faces up, or nobody knows."""
    low: np.ndarray
    """(2,) place of line (0, 0) [m]."""
    shape: tuple[int, int]
    """Lines along x and y."""

    def xy(self, cell: np.ndarray) -> np.ndarray:
        """Places (..., 2) [m] of lines (..., 2)."""
        return self.low + cell * CELL


@dataclass(frozen=True)
class LevelPlane:
    """A surface to sit or lie on."""

    height: float
    """Median above the floor [m]."""
    polygon: np.ndarray
    """(P, 2) outline seen from above [m], counter-clockwise."""
    area: float
    """Of all of its surface, also beyond the outline [m^2]."""
    spread: float
    """Its heights are within this of the median, for 95 % of it [m]."""
    rectangle: tuple[float, float]
    """Sides along x and y of the largest rectangle on it [m]."""


def surfaces(mesh: Mesh, sided: np.ndarray | None = None) -> Surfaces:
    """Pass vertical lines through a mesh that stands on the floor.

    Args:
        mesh: the mesh, z up, metres.
        sided: (F,) whether a face's order of corners tells which of its sides is outside; all do if not given.

    Raises BadObject if it would take too long.
    """
    corners = mesh.vertices[mesh.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    steep = np.abs(normal[:, 2]) > 1e-6 * np.linalg.norm(normal, axis=1)  # vertical faces are never passed through
    corners, normal = corners[steep], normal[steep]
    up = normal[:, 2] > 0 if sided is None else (normal[:, 2] > 0) | ~sided[steep]
    low, high = mesh.bounds()
    # half a cell off, so that lines stand clear of edges at round numbers
    low = low[:2] + 0.5137 * CELL
    rows, columns = (int(n) for n in np.maximum(np.ceil((high[:2] - low) / CELL), 1))
    first = np.clip(np.ceil((corners[..., :2].min(1) - low) / CELL), 0, None).astype(np.int64)
    last = np.minimum(np.floor((corners[..., :2].max(1) - low) / CELL).astype(np.int64), np.array([rows, columns]) - 1)
    spans = np.maximum(last - first + 1, 0)
    counts = spans.prod(1)
    if counts.sum() > MAX_CROSSINGS:
        raise BadObject(
            "its faces overlap too often to look for planes; reduce the mesh to some ten thousand faces first"
        )
    found = [_cross(corners, first, spans, counts, chunk, low) for chunk in _chunks(counts)]
    face, cell, height = (np.concatenate([part[i] for part in found]) for i in range(3))
    order = np.lexsort((height, cell[:, 1], cell[:, 0]))
    face, cell, height = face[order], cell[order], height[order]
    gap = np.full(len(face), np.inf)
    same = (cell[1:] == cell[:-1]).all(1)
    gap[:-1][same] = (height[1:] - height[:-1])[same]
    level = np.abs(normal[face, 2]) / np.linalg.norm(normal[face], axis=1)
    # two faces that lie on each other are one surface
    keep = gap > 1e-6
    return Surfaces(cell[keep], height[keep], level[keep], gap[keep], up[face][keep], low, (rows, columns))


def find_plane(found: Surfaces, needs: PlaneNeeds) -> LevelPlane | None:
    """The largest plane that fulfils the needs, or None."""
    fits = (found.level >= LEVEL) & found.up & (found.gap >= needs.headroom)
    fits &= (found.height >= needs.heights[0]) & (found.height <= needs.heights[1])
    cell, height = found.cell[fits], found.height[fits]
    best = 0.0
    best_cells: tuple[np.ndarray, np.ndarray] | None = None
    for middle in np.arange(needs.heights[0], needs.heights[1] + 0.005, 0.01):
        near = np.abs(height - middle) <= BAND
        if near.sum() <= best:
            continue
        mask = np.zeros(found.shape, bool)
        mask[tuple(cell[near].T)] = True
        # what is narrower than 6 cm is a rail or an armrest's edge
        wide = np.asarray(ndimage.binary_opening(mask, np.ones((3, 3))))
        if wide.any():
            names = np.zeros(found.shape, np.int32)
            ndimage.label(wide, output=names)
            sizes = np.bincount(names.ravel())[1:]
            if sizes.max() > best:
                best, best_cells = float(sizes.max()), (names == 1 + int(sizes.argmax()), near)
    if best_cells is None:
        return None
    mask, near = best_cells[0], best_cells[1]
    rows, columns = _rectangle(mask)
    sides = ((rows[1] - rows[0]) * CELL, (columns[1] - columns[0]) * CELL)
    if min(sides) < needs.size[0] - CELL or max(sides) < needs.size[1] - CELL:
        return None
    on_it = near & mask[tuple(cell.T)]
    middle = float(np.median(height[on_it]))
    spread = float(np.quantile(np.abs(height[on_it] - middle), 0.95))
    return LevelPlane(middle, _outline(found, mask, rows, columns), best * CELL**2, spread, sides)


def _chunks(counts: np.ndarray) -> list[np.ndarray]:
    """Faces, in lots of about a million pairs."""
    return np.split(np.arange(len(counts)), np.flatnonzero(np.diff(np.cumsum(counts) // 1_000_000)) + 1)


def _cross(
    corners: np.ndarray, first: np.ndarray, spans: np.ndarray, counts: np.ndarray, chunk: np.ndarray, low: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Face (N,), cell (N, 2) and height (N,) of every passage of a line through one of the faces of `chunk`."""
    face = np.repeat(chunk, counts[chunk])
    within = np.arange(len(face)) - np.repeat(np.cumsum(counts[chunk]) - counts[chunk], counts[chunk])
    cell = first[face] + np.stack([within // np.maximum(spans[face, 1], 1), within % np.maximum(spans[face, 1], 1)], -1)
    point = low + cell * CELL
    a, b, c = corners[face, 0], corners[face, 1], corners[face, 2]
    whole = _twice_area(a, b, c)
    u, v = _twice_area(point, b, c) / whole, _twice_area(a, point, c) / whole
    w = 1 - u - v
    inside = (u >= -1e-9) & (v >= -1e-9) & (w >= -1e-9)
    height = u * a[:, 2] + v * b[:, 2] + w * c[:, 2]
    return face[inside], cell[inside], height[inside]


def _twice_area(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    return (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])


def _rectangle(mask: np.ndarray) -> tuple[tuple[int, int], tuple[int, int]]:
    """Rows and columns, first and beyond the last, of the largest rectangle of a mask's set cells."""
    best, area = ((0, 0), (0, 0)), 0
    depth = np.zeros(mask.shape[1], int)
    for row in range(mask.shape[0]):
        depth = np.where(mask[row], depth + 1, 0)
        stack: list[tuple[int, int]] = []  # (first column, depth), deeper and deeper
        for column, now in enumerate([*depth.tolist(), 0]):
            start = column
            while stack and stack[-1][1] >= now:
                start, deep = stack.pop()
                if deep * (column - start) > area:
                    area, best = deep * (column - start), ((row + 1 - deep, row + 1), (start, column))
            stack.append((start, now))
    return best


def _outline(found: Surfaces, mask: np.ndarray, rows: tuple[int, int], columns: tuple[int, int]) -> np.ndarray:
    """The convex outline (P, 2) of a plane, or the largest rectangle on it if the outline would take in much that is
    no plane.
    """
    cells = np.argwhere(mask)
    corners = found.xy(np.concatenate([cells + np.array(step) / 2 for step in ((1, 1), (1, -1), (-1, 1), (-1, -1))]))
    hull = ConvexHull(corners)
    if hull.volume <= 1.08 * len(cells) * CELL**2:
        return corners[hull.vertices]
    low, high = found.xy(np.array([rows[0], columns[0]]) - 0.5), found.xy(np.array([rows[1], columns[1]]) - 0.5)
    return np.array([[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]])
