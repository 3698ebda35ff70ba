"""The faces of objects, and which of them cameras and parallel lines of sight can see, and where in their pictures."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull

from mimicbench.core import rotations as rot
from mimicbench.objects.shape import SceneObject
from mimicbench.sensors.sight.faces import Faces

EDGE_ON = 1e-9
"""Faces are not seen by who is so little before their plane [m], or looks along it but for so small a cosine."""
_NEAR = 1e-6
"""[m] What is so little before a camera, or behind it, has no place in the picture."""
_MARGIN = 1.0
"""[px] Rows and columns beside the corners of a face that are looked at too."""
_KEPT = 2048
"""Objects of boxes whose faces are kept for when they come again: 50 MB if all are of 16 boxes."""
_KEPT_HULLS = 256
"""The same of convex pieces: 60 MB if all are of 16 pieces of 60 triangles."""
_BOX_FACES = np.array(
    [[0, 1, 2, 4, 5], [3, 1, 2, 4, 5], [1, 0, 2, 3, 5], [4, 0, 2, 3, 5], [2, 0, 1, 3, 4], [5, 0, 1, 3, 4]]
)
"""(6, 5) which of a box's planes, +x +y +z -x -y -z, a face lies in, and which bound it."""
_BOX_CORNERS = np.array([[4, 5, 7, 6], [0, 1, 3, 2], [2, 3, 7, 6], [0, 1, 5, 4], [1, 3, 7, 5], [0, 2, 6, 4]])
"""(6, 4) which of the corners that `SceneObject.corners` lists a face has, in turn."""
_NEXT = np.array([1, 2, 3, 0])
"""The corner after each of a face's."""


class ObjectFaces(NamedTuple):
    """The faces of one object, in its frame: of its convex pieces if it has some, else of its boxes."""

    normals: np.ndarray
    """(F, 5, 3) of the plane that a face lies in, outwards, and of the planes that bound it."""
    offsets: np.ndarray
    """(F, 5) of these planes: points x of the object have normal x <= offset [m]."""
    corners: np.ndarray
    """(F, 4, 3) [m]; of a triangle the first comes twice."""
    most_seen: int
    """How many of them one eye can see at most."""
    piece: np.ndarray
    """(F,) which of the object's pieces or boxes it is of."""


@dataclass(frozen=True)
class Surfaces:
    """All faces of the objects of N scenes, one after the other, in the objects' frames."""

    scene: np.ndarray
    """(F,) whose face it is."""
    normals: np.ndarray
    """(F, 5, 3) of the plane that it lies in, outwards, and of the planes that bound it."""
    offsets: np.ndarray
    """(F, 5) of these planes: points x of the object have normal x <= offset [m]."""
    corners: np.ndarray
    """(F, 4, 3) [m]; of a triangle the first comes twice."""

    @staticmethod
    def of(faces: Sequence[ObjectFaces]) -> "Surfaces":
        """The faces of N objects."""
        scene = np.repeat(np.arange(len(faces)), [len(part.normals) for part in faces])
        return Surfaces(scene, *(np.concatenate(arrays) for arrays in list(zip(*faces, strict=True))[:3]))

    def seen_from(self, eyes: np.ndarray, looks: np.ndarray, height: int, width: int) -> "Faces":
        """The faces that cameras see, by the inverse of depth [1/m]. Picture n C + c is that of camera c in scene n.

        What a camera is inside of it does not see, as in drawn pictures.

        Args:
            eyes: (N, C, 3) where the cameras are, in the objects' frames [m].
            looks: (N, C, 3, 3) lines of sight there, one meter long along the camera's axis; the last axis is their
                linear form in row and column.
            height: Rows of the pictures.
            width: Columns of the pictures.
        """
        away = np.einsum("fi,fci->fc", self.normals[:, 0], eyes[self.scene]) - self.offsets[:, :1]
        face, camera = np.nonzero(away > EDGE_ON)
        picture = self.scene[face] * eyes.shape[1] + camera
        # a corner is at eye + look (1, row, column) depth
        # a scene that broke sees nothing, whatever its numbers are
        broken = ~(np.abs(np.linalg.det(looks)) > 1e-20)[..., None, None]
        inverse = np.linalg.inv(np.where(broken, np.eye(3), looks)).reshape(-1, 3, 3)
        eye = (inverse @ eyes.reshape(-1, 3, 1))[..., 0]
        depth, *places = _into(inverse, eye, picture, self.corners[face])
        some, first, last = _between(*_bounds(depth, np.stack(places)), height, width)
        face, picture, away = face[some], picture[some], away[face[some], camera[some]]
        normals, looks, eyes = self.normals[face], looks.reshape(-1, 3, 3)[picture], eyes.reshape(-1, 3, 1)[picture]
        across = normals @ looks
        value = across[:, 0] / -away[:, None]
        # a line of sight meets the plane at eye + look / value; whether that is within the bounds, all times value
        room = self.offsets[face, 1:] - (normals[:, 1:] @ eyes)[..., 0]
        edges = room[..., None] * value[:, None] - across[:, 1:]
        return Faces(picture, value, edges, first, last, face)

    def seen_along(self, starts: np.ndarray, looks: np.ndarray, height: int, width: int) -> "Faces":
        """The faces that parallel lines of sight meet, by how far they are from the starts against the lines'
        direction [m]. Picture n is that of scene n.

        Args:
            starts: (N, 3, 3) points that the lines go through, in the objects' frames; the last axis is their
                linear form in row and column [m].
            looks: (N, 3) where they look, of unit length.
            height: Rows of the pictures.
            width: Columns of the pictures.
        """
        facing = -(self.normals @ looks[self.scene, :, None])[..., 0]
        face = np.flatnonzero(facing[:, 0] > EDGE_ON)
        # a corner is at start (1, row, column) + look depth
        inverse = np.linalg.inv(np.concatenate([looks[..., None], starts[..., 1:]], -1))
        _, *places = _into(inverse, (inverse @ starts[..., :1])[..., 0], self.scene[face], self.corners[face])
        some, first, last = _between(np.min(places, 1), np.max(places, 1), height, width)
        face = face[some]
        facing, scene = facing[face], self.scene[face]
        room = -(self.normals[face] @ starts[scene])
        room[..., 0] += self.offsets[face]
        value = room[:, 0] / facing[:, :1]
        edges = room[:, 1:] - facing[:, 1:, None] * value[:, None]
        return Faces(scene, value, edges, first, last, face)


def _into(inverse: np.ndarray, origin: np.ndarray, picture: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(3, 4, F) corners (F, 4, 3) in their pictures (F,): inverse (P, 3, 3) of them, less origin (P, 3)."""
    turn, origin = inverse.reshape(-1, 9).T[:, picture], origin.T[:, picture]
    x, y, z = np.ascontiguousarray(corners.T)
    return np.stack([turn[3 * k] * x + turn[3 * k + 1] * y + turn[3 * k + 2] * z - origin[k] for k in range(3)])


def _bounds(depth: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest row and column (2, F) of faces, of their corners' depth (4, F), and places (2, 4, F) times
    it.

    Where a face reaches behind the camera it leaves the picture, at infinity, on the sides where its edges do so.
    """
    before = depth > _NEAR
    with np.errstate(divide="ignore", invalid="ignore"):
        seen = places / depth
    low, high = np.where(before, seen, np.inf).min(1), np.where(before, seen, -np.inf).max(1)
    corner, face = np.nonzero(before != before[_NEXT])
    other = _NEXT[corner]
    share = depth[corner, face] / (depth[corner, face] - depth[other, face])
    leaves = places[:, corner, face] + share * (places[:, other, face] - places[:, corner, face])
    for axis in range(2):
        low[axis, face[leaves[axis] < _NEAR]] = -np.inf
        high[axis, face[leaves[axis] > -_NEAR]] = np.inf
    return low, high


def _between(low: np.ndarray, high: np.ndarray, height: int, width: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which faces between bounds (2, F) are in a picture, and the first and the last row that each of these can be
    in.
    """
    first, last = np.ceil(np.maximum(low[0] - _MARGIN, 0)), np.floor(np.minimum(high[0] + _MARGIN, height - 1))
    some = np.flatnonzero((first <= last) & (low[1] - _MARGIN <= width - 1) & (high[1] + _MARGIN >= 0))
    return some, first[some].astype(np.intp), last[some].astype(np.intp)


def faces_of(obj: SceneObject) -> ObjectFaces:
    """The faces of an object, made or from those at hand."""
    return _of_hulls(obj) if obj.hulls else _of_boxes(obj)


@lru_cache(maxsize=_KEPT)
def _of_boxes(obj: SceneObject) -> ObjectFaces:
    axes, (pos, half) = rot.to_matrix(obj.box_quat).swapaxes(1, 2), (obj.box_pos, obj.box_half)
    middle = (axes @ pos[..., None])[..., 0]
    normals, offsets = np.concatenate([axes, -axes], 1), np.concatenate([middle + half, half - middle], 1)
    return ObjectFaces(
        normals[:, _BOX_FACES].reshape(-1, 5, 3),
        offsets[:, _BOX_FACES].reshape(-1, 5),
        obj.corners()[:, _BOX_CORNERS].reshape(-1, 4, 3),
        3 * len(pos),  # of two that are opposite one is turned away
        np.repeat(np.arange(len(pos)), len(_BOX_FACES)),
    )


@lru_cache(maxsize=_KEPT_HULLS)
def _of_hulls(obj: SceneObject) -> ObjectFaces:
    made = [_hull(hull.astype(float)) for hull in obj.hulls]
    normals, offsets, corners = map(np.concatenate, zip(*made, strict=True))
    piece = np.repeat(np.arange(len(made)), [len(part[0]) for part in made])
    return ObjectFaces(normals, offsets, corners, len(normals), piece)


def _hull(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Normals (T, 5, 3), offsets (T, 5) and corners (T, 4, 3) of the triangles of the convex hull around (V, 3).

    Of four bounds two are the same.
    """
    hull = ConvexHull(corners)
    normals, offsets, ends = hull.equations[:, :3], -hull.equations[:, 3], hull.points[hull.simplices]
    bounds = np.empty((len(ends), 4, 3))
    limits = np.empty((len(ends), 4))
    for edge in range(4):
        a, b, c = (ends[:, (edge + i) % 3] for i in range(3))
        side = np.cross(b - a, normals)
        side *= np.sign(((a - c) * side).sum(-1, keepdims=True)) / np.maximum(
            np.linalg.norm(side, axis=-1, keepdims=True), 1e-12
        )
        bounds[:, edge], limits[:, edge] = side, (side * a).sum(-1)
    return (
        np.concatenate([normals[:, None], bounds], 1),
        np.concatenate([offsets[:, None], limits], 1),
        ends[:, [0, 1, 2, 0]],
    )
