"""What lines of sight meet of objects, in closed form: the faces of many objects are filled into many pictures, row
by row.

Along the lines of sight of a picture, everything about a plane is linear in the pixel's row and column. For a pinhole
that is the inverse of
depth, for parallel lines depth itself. So are the edges of a face, and where they cut a row of pixels, those that see
the face begin and end.
Pixels get the value at their centers, as if a ray had been followed through each, and only those that see a face cost
anything.
No simulator is asked, so it is the same for all of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.spatial import ConvexHull

from mimicbench.core import rotations as rot
from mimicbench.objects.shape import SceneObject

_CRACK = 1e-6
"""[px] Faces are this much wider on either side, so that no pixel's center falls between two that share an edge."""
_EDGE_ON = 1e-9
"""Faces are not seen by who is so little before their plane [m], or looks along it but for so small a cosine."""
_BOX_FACES = np.array(
    [[0, 1, 2, 4, 5], [3, 1, 2, 4, 5], [1, 0, 2, 3, 5], [4, 0, 2, 3, 5], [2, 0, 1, 3, 4], [5, 0, 1, 3, 4]]
)
"""(6, 5) which of a box's planes, +x +y +z -x -y -z, a face lies in, and which bound it."""


@dataclass(frozen=True)
class Surfaces:
    """All faces of the objects of N scenes, one after the other, in the objects' frames."""

    scene: np.ndarray
    """(F,) whose face it is."""
    normals: np.ndarray
    """(F, 5, 3) of the plane that it lies in, outwards, and of the planes that bound it."""
    offsets: np.ndarray
    """(F, 5) of these planes: points x of the object have normal x <= offset [m]."""

    @staticmethod
    def of(objects: Sequence[SceneObject]) -> "Surfaces":
        """The faces of objects: of their convex pieces if they have some, else of their boxes."""
        boxes = [obj for obj in objects if not obj.hulls] if any(obj.hulls for obj in objects) else objects
        parts = [_hulls(index, obj) for index, obj in enumerate(objects) if obj.hulls]
        if boxes:
            pos, quat, half = (
                np.concatenate([getattr(obj, name) for obj in boxes]) for name in ("box_pos", "box_quat", "box_half")
            )
            axes = rot.to_matrix(quat).swapaxes(1, 2)
            middle = (axes @ pos[..., None])[..., 0]
            normals, offsets = np.concatenate([axes, -axes], 1), np.concatenate([middle + half, half - middle], 1)
            counts = [0 if obj.hulls else 6 * len(obj.box_pos) for obj in objects]
            scene = np.repeat(np.arange(len(objects)), counts)
            parts.append(
                Surfaces(scene, normals[:, _BOX_FACES].reshape(-1, 5, 3), offsets[:, _BOX_FACES].reshape(-1, 5))
            )
        if len(parts) == 1:
            return parts[0]
        return Surfaces(
            *(np.concatenate([getattr(part, name) for part in parts]) for name in ("scene", "normals", "offsets"))
        )

    def seen_from(self, eyes: np.ndarray, looks: np.ndarray) -> "Faces":
        """The faces that cameras see, by the inverse of depth [1/m]. Picture n C + c is that of camera c in scene n.

        What a camera is inside of it does not see, as in drawn pictures.

        Args:
            eyes: (N, C, 3) where the cameras are, in the objects' frames [m].
            looks: (N, C, 3, 3) lines of sight there, one meter long along the camera's axis; the last axis is their
                linear form in row and column.
        """
        away = np.einsum("fi,fci->fc", self.normals[:, 0], eyes[self.scene]) - self.offsets[:, :1]
        face, camera = np.nonzero(away > _EDGE_ON)
        scene, normals = self.scene[face], self.normals[face]
        across = normals @ looks[scene, camera]
        value = across[:, 0] / -away[face, camera, None]
        # a line of sight meets the plane at eye + look / value; whether that is within the bounds, all times value
        room = self.offsets[face, 1:] - (normals[:, 1:] @ eyes[scene, camera, :, None])[..., 0]
        return Faces(scene * eyes.shape[1] + camera, value, room[..., None] * value[:, None] - across[:, 1:])

    def seen_along(self, starts: np.ndarray, looks: np.ndarray) -> "Faces":
        """The faces that parallel lines of sight meet, by how far they are from the starts against the lines'
        direction [m]. Picture n is that of scene n.

        Args:
            starts: (N, 3, 3) points that the lines go through, in the objects' frames; the last axis is their
                linear form in row and column [m].
            looks: (N, 3) where they look, of unit length.
        """
        facing = -(self.normals @ looks[self.scene, :, None])[..., 0]
        face = np.flatnonzero(facing[:, 0] > _EDGE_ON)
        facing, scene = facing[face], self.scene[face]
        room = -(self.normals[face] @ starts[scene])
        room[..., 0] += self.offsets[face]
        value = room[:, 0] / facing[:, :1]
        return Faces(scene, value, room[:, 1:] - facing[:, 1:, None] * value[:, None])


@dataclass(frozen=True)
class Faces:
    """Faces in pictures. A linear form (a, b, c) is a + b row + c column."""

    picture: np.ndarray
    """(F,) which picture it is in."""
    value: np.ndarray
    """(F, 3) form of what pixels get that see it; of several faces the largest value is seen."""
    edges: np.ndarray
    """(F, 4, 3) forms that are not negative where it is."""

    def fill(self, pictures: np.ndarray) -> None:
        """Raise the pixels of pictures (P, height, width), float32, to the faces that they see."""
        _, height, width = pictures.shape
        # a form that is negative in all corners of the picture is so all over it
        top = (
            self.edges[..., 0]
            + np.maximum(self.edges[..., 1] * (height - 1), 0)
            + np.maximum(self.edges[..., 2] * (width - 1), 0)
        )
        face = np.flatnonzero((top >= -1e-9).all(1))
        picture, value, edges = self.picture[face], self.value[face], self.edges[face]
        rows = np.arange(height)
        begin, end = np.zeros((len(face), height)), np.full((len(face), height), width - 1.0)
        for edge in range(edges.shape[1]):
            base, down, along = (edges[:, edge, i, None] for i in range(3))
            with np.errstate(divide="ignore", invalid="ignore"):
                cut = -(base / along) - (down / along) * rows
            np.maximum(begin, cut - _CRACK, out=begin, where=along > 0)
            np.minimum(end, cut + _CRACK, out=end, where=along < 0)
            level = np.flatnonzero(along[:, 0] == 0)
            end[level] = np.where(base[level] + down[level] * rows < 0, -1, end[level])
        begin = np.ceil(begin)
        length = np.floor(end) - begin + 1
        span, row = np.nonzero(length > 0)
        begin, length = begin[span, row].astype(np.intp), length[span, row].astype(np.intp)
        # all pixels of all rows of all faces in one line
        first = value[span, 0] + value[span, 1] * row + value[span, 2] * begin
        place = np.arange(length.sum()) - np.repeat(np.cumsum(length) - length, length)
        seen = np.repeat(value[span, 2].astype(np.float32), length)
        seen *= place
        seen += np.repeat(first.astype(np.float32), length)
        place += np.repeat((picture[span] * height + row) * width + begin, length)
        np.maximum.at(pictures.reshape(-1), place, seen)


def _hulls(index: int, obj: SceneObject) -> Surfaces:
    normals, offsets = (
        np.concatenate(parts)
        for parts in zip(*(_hull(hull.astype(float).tobytes()) for hull in obj.hulls), strict=True)
    )
    return Surfaces(np.full(len(normals), index), normals, offsets)


@lru_cache(maxsize=4096)
def _hull(corners: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Normals (T, 5, 3) and offsets (T, 5) of the triangles of the convex hull around (V, 3).

    Of four bounds two are the same.
    """
    hull = ConvexHull(np.frombuffer(corners).reshape(-1, 3))
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
    return np.concatenate([normals[:, None], bounds], 1), np.concatenate([offsets[:, None], limits], 1)
