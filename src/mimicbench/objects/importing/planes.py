"""Finds the planes of a mesh to sit or lie on: level, free above, and large enough.

Vertical lines stand on a grid of 2 cm. Where one passes through the mesh, there is a surface; it can be sat on if it is
at the right height, faces up, and nothing is above it for the headroom. Neighboring lines with such surfaces within a
few centimeters of one plane that is nearly level make a plane, and the largest is the one.
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
LEVEL = np.radians(20.0)
"""Most slope of a level surface over 10 cm [rad]."""
LEANS = np.tan(np.radians(15.0)) * CELL
"""Most slope of a whole plane, from line to line [m]."""
BAND = 0.03
"""[m]; a plane's surface is within this of it; cushions are curved."""
SEAM = 3
"""Lines; a seam between cushions is narrower."""
ROUNDS = 4
"""How often a plane is fitted to what is near it."""


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
    tilt: float = 0.0
    """How much it leans [degrees]."""


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
    # two faces that lie on each other are one surface
    keep = gap > 1e-6
    return Surfaces(cell[keep], height[keep], gap[keep], up[face][keep], low, (rows, columns))


def find_plane(found: Surfaces, needs: PlaneNeeds) -> LevelPlane | None:
    """The largest plane that fulfills the needs, or None.

    From every height the surface within BAND of it is taken, then again that within BAND of its least-squares plane:
    seats lean back, cushions are curved and tufted. What counts is whether the surface is level over 10 cm, not whether
    every facet of it is.
    """
    height, top = _maps(found, needs)
    known = np.isfinite(height)
    levels = np.arange(needs.heights[0], needs.heights[1] + 0.005, 0.01)
    counts = [(int((np.abs(height[known] - level) <= BAND).sum()), level) for level in levels]
    best, area = None, 0
    for count, level in sorted(counts, reverse=True):
        if 2 * count <= area:
            break
        fit, mask = np.array([0.0, 0.0, level]), np.zeros(height.shape, bool)
        for _ in range(ROUNDS):
            mask, on_it = _region(height, top, fit)
            if mask.sum() > area:
                best, area = (mask, on_it, fit), int(mask.sum())
            leans = _least_squares(height, on_it) if on_it.sum() >= 9 else None
            if leans is None or np.hypot(*leans[:2]) > LEANS:
                break
            fit = leans
    if best is None:
        return None
    mask, on_it, fit = best
    rows, columns = _rectangle(mask)
    sides = ((rows[1] - rows[0]) * CELL, (columns[1] - columns[0]) * CELL)
    if min(sides) < needs.size[0] - CELL or max(sides) < needs.size[1] - CELL:
        return None
    middle = float(np.median(height[on_it]))
    spread = float(np.quantile(np.abs(height[on_it] - middle), 0.95))
    tilt = float(np.degrees(np.arctan(np.hypot(*fit[:2]) / CELL)))
    return LevelPlane(middle, _outline(found, mask, rows, columns), area * CELL**2, spread, sides, tilt)


def _maps(found: Surfaces, needs: PlaneNeeds) -> tuple[np.ndarray, np.ndarray]:
    """Height of what carries at every line, NaN where nothing does, and of the highest surface there is, -inf where
    there is none: both (X, Y) [m].
    """
    height, top = np.full(found.shape, np.nan), np.full(found.shape, -np.inf)
    top[tuple(found.cell.T)] = found.height  # the last of a line is its highest
    carries = found.up & (found.gap >= needs.headroom)
    carries &= (found.height >= needs.heights[0]) & (found.height <= needs.heights[1])
    height[tuple(found.cell[carries].T)] = found.height[carries]
    return height, top


def _region(height: np.ndarray, top: np.ndarray, fit: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The widest region (X, Y) near a plane, seams included, and the lines in it that are near the plane.

    The plane is `fit` (3,): its slopes per line along rows and columns, and its height at the first line [m].
    """
    rows, columns = np.indices(height.shape)
    plane = fit[0] * rows + fit[1] * columns + fit[2]
    near = np.nan_to_num(np.abs(height - plane), nan=np.inf) <= BAND
    near &= _level(np.where(near, height, 0.0), near)
    # cushions have seams and tufts; what stands up between two is no seam
    pad = np.pad(near, 3)
    seams = np.asarray(ndimage.binary_closing(pad, np.ones((SEAM, SEAM))))[3:-3, 3:-3] & (top <= plane + BAND)
    # what is narrower than 6 cm is a rail or an armrest's edge
    wide = np.asarray(ndimage.binary_opening(near | seams, np.ones((3, 3))))
    if not wide.any():
        return wide, wide
    names = np.zeros(height.shape, np.int32)
    ndimage.label(wide, output=names)
    mask = names == 1 + int(np.bincount(names.ravel())[1:].argmax())
    return mask, near & mask


def _level(height: np.ndarray, near: np.ndarray) -> np.ndarray:
    """(X, Y) whether the least-squares plane of what is near within 5 cm around a line is level."""
    x, y = (axis * CELL for axis in np.indices(height.shape).astype(float))

    def mean(values: np.ndarray) -> np.ndarray:
        return ndimage.uniform_filter(np.where(near, values, 0.0), 5, mode="constant")

    weight = np.maximum(mean(np.ones_like(height)), 1e-9)
    mx, my, mz = mean(x) / weight, mean(y) / weight, mean(height) / weight
    xx, yy, xy = mean(x * x) / weight - mx**2, mean(y * y) / weight - my**2, mean(x * y) / weight - mx * my
    xz, yz = mean(x * height) / weight - mx * mz, mean(y * height) / weight - my * mz
    inverse = 1.0 / np.maximum(xx * yy - xy**2, 1e-12)
    slope = np.hypot((yy * xz - xy * yz) * inverse, (xx * yz - xy * xz) * inverse)
    return slope <= np.tan(LEVEL)


def _least_squares(height: np.ndarray, on_it: np.ndarray) -> np.ndarray:
    """(3,) slopes per line along rows and columns, and the height at the first line, of the plane through the lines."""
    rows, columns = np.nonzero(on_it)
    return np.linalg.lstsq(np.stack([rows, columns, np.ones(len(rows))], -1), height[on_it], rcond=None)[0]


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
