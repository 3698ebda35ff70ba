"""Triangles of faces that may have any number of corners, convex or not."""

import numpy as np

from mimicbench.core.errors import BadFile

MAX_CORNERS = 1000
"""Of a face that is not convex: cutting one takes time that grows with their square."""


def triangles(vertices: np.ndarray, lengths: np.ndarray, flat: np.ndarray) -> np.ndarray:
    """(F, 3) triangles of polygons with corners `flat` (sum of lengths,) of `vertices` (V, 3), `lengths` (N,) each.

    Convex ones become fans around their first corner; of the others, a fan would fill notches. Raises BadFile.
    """
    if flat.size and (flat.min() < 0 or flat.max() >= len(vertices)):
        raise BadFile("a face has a corner that does not exist; it is cut off or damaged")
    first = np.cumsum(lengths) - lengths
    fans = np.maximum(lengths - 2, 0)
    face = np.repeat(np.arange(len(lengths)), fans)
    within = np.arange(fans.sum()) - np.repeat(np.cumsum(fans) - fans, fans)
    start = first[face]
    found = np.stack([flat[start], flat[start + within + 1], flat[start + within + 2]], -1)
    corners = vertices[found]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    whole = np.stack([np.bincount(face, normals[:, axis], len(lengths)) for axis in range(3)], -1)
    against = (normals * whole[face]).sum(-1) < -1e-9 * (whole[face] ** 2).sum(-1)
    for number in np.unique(face[against]):
        count = lengths[number]
        if count > MAX_CORNERS:
            raise BadFile(f"a face of {count} corners is not convex; make triangles of it first")
        polygon = flat[first[number] : first[number] + count]
        found[face == number] = polygon[_ears(_flattened(vertices[polygon], whole[number]))]
    return found


def _flattened(corners: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """(N, 2) corners (N, 3) in a plane across `normal`, counter-clockwise."""
    normal = normal / np.linalg.norm(normal)
    along = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    along /= np.linalg.norm(along)
    return (corners - corners[0]) @ np.stack([along, np.cross(normal, along)], -1)


def _ears(outline: np.ndarray) -> np.ndarray:
    """(N - 2, 3) triangles of a simple polygon (N, 2), by cutting off ears (Meisters 1975); a fan of what has none."""
    left, found = list(range(len(outline))), []
    while len(left) > 3:
        k = next((k for k in range(len(left)) if _is_ear(outline, left, k)), None)
        if k is None:
            break  # it crosses itself, or is flat
        found.append((left[k - 1], left[k], left[(k + 1) % len(left)]))
        del left[k]
    found += [(left[0], left[k], left[k + 1]) for k in range(1, len(left) - 1)]
    return np.array(found)


def _is_ear(outline: np.ndarray, left: list[int], k: int) -> bool:
    """Whether the corner bends outward and no other one lies in the triangle that it makes with its neighbors."""
    ear = outline[[left[k - 1], left[k], left[(k + 1) % len(left)]]]
    if _area(*ear) <= 0:
        return False
    others = outline[left]
    others = others[(others[:, None] != ear).any(-1).all(-1)]  # a bridge to a hole has its ends twice
    sides = [_area(ear[i], ear[(i + 1) % 3], others) >= 0 for i in range(3)]
    return not np.all(sides, axis=0).any()


def _area(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Twice the signed area of triangles a, b, c (..., 2)."""
    return (b[0] - a[0]) * (c[..., 1] - a[1]) - (b[1] - a[1]) * (c[..., 0] - a[0])
