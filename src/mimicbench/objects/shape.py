"""An object as the benchmark sees it: a few boxes, what can be done with it, and which split it belongs to."""

from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path

import numpy as np

from mimicbench.core.errors import BadObject
from mimicbench.core.files import read_record, write_record
from mimicbench.core.seeds import digest

SLOTS = 16
"""Boxes that every scene reserves for its object, so that all scenes have the same size and can share a batch."""


LARGEST = 100.0
"""[m] Nothing of an object is farther from its origin."""


FITTED = "fitted-"
"""Begins the id of an object that was fitted to a recording; its name follows, and the number of the clip in it."""


def original_of(object_id: str) -> str:
    """What an object is a variant of, or the object itself: what stands behind a `~` names a variant, and objects that
    were fitted to one recording are variants of one another.
    """
    original = object_id.partition("~")[0]
    recording, _, number = original.rpartition("-")
    return recording if original.startswith(FITTED) and number.isdecimal() else original


def split_of(object_id: str) -> str:
    """`train` or `test`, 3:1, decided by an object's id alone; a variant goes with its original, and all of a recording
    together.
    """
    return "test" if digest(0, "split", original_of(object_id)) % 4 == 0 else "train"


@dataclass(frozen=True, eq=False)
class SceneObject:
    """A rigid object made of boxes, standing on the floor at the origin and facing +x.

    An object equals itself alone, so that what is derived from it can be kept beside it.
    """

    id: str
    family: str
    kind: str
    box_pos: np.ndarray
    """(B, 3) centres [m]."""
    box_quat: np.ndarray
    """(B, 4) orientations, wxyz."""
    box_half: np.ndarray
    """(B, 3) half sizes [m]."""
    box_rgb: np.ndarray
    """(B, 3) colours in 0..1, for pictures only."""
    seat_height: float | None = None
    """H of the metric: height of the surface to sit or lie on [m]."""
    seat_polygon: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    """(P, 2) outline of that surface seen from above [m], counter-clockwise."""
    head_xy: np.ndarray = field(default_factory=lambda: np.zeros(0))
    """(2,) where the head of who lies on it goes, seen from above [m]; empty if it is not for lying."""
    touch_points: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    """(P, 3) places on the surface that a hand can reach and use, such as handles and edges [m]."""
    touch_normals: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    """(P, 3) unit vectors out of the surface at these places."""
    movable: bool = False
    mass: float | None = None
    """[kg], of movable objects."""
    friction: float = 1.0
    """Sliding friction of its surface."""
    hulls: tuple[np.ndarray, ...] = ()
    """Of an imported object: per box, the corners (V, 3) [m] of the convex piece that the box encloses, and that
    collides in its place."""

    def __post_init__(self) -> None:
        boxes = len(self.box_pos)
        if not 1 <= boxes <= SLOTS:
            raise BadObject(f"object {self.id} has {boxes} boxes; a scene has room for 1 to {SLOTS}")
        for name, width in (("box_pos", 3), ("box_quat", 4), ("box_half", 3), ("box_rgb", 3)):
            array = getattr(self, name)
            if array.shape != (boxes, width) or not np.isfinite(array).all():
                raise BadObject(f"object {self.id}: {name} must be {boxes} x {width} finite numbers")
        if (self.box_half <= 0).any():
            raise BadObject(f"object {self.id} has a box without thickness")
        self._check_what_can_be_done()
        if self.touch_points.shape != self.touch_normals.shape or self.touch_points.shape[1:] != (3,):
            raise BadObject(f"object {self.id}: every touch point needs a normal, both of three numbers")
        if self.head_xy.shape not in ((0,), (2,)):
            raise BadObject(f"object {self.id}: head_xy must be two numbers, or none")
        if self.hulls and (
            len(self.hulls) != boxes
            or any(hull.ndim != 2 or hull.shape[1] != 3 or len(hull) < 4 for hull in self.hulls)
        ):
            raise BadObject(
                f"object {self.id}: there must be one convex piece of 4 or more corners for each box, or none at all"
            )

    def _check_what_can_be_done(self) -> None:
        """Refuse what is no object of a room: turned by no rotation, larger than a house, without weight."""
        numbers = (self.seat_polygon, self.head_xy, self.touch_points, self.touch_normals, *self.hulls)
        lengths = (self.box_pos, self.box_half, *numbers)
        if not all(np.isfinite(array).all() and (np.abs(array) < LARGEST).all() for array in lengths):
            raise BadObject(f"object {self.id} has numbers that are not finite, or not within {LARGEST:g} m")
        units = (self.box_quat, self.touch_normals)
        if any((np.abs(np.linalg.norm(array, axis=-1) - 1) > 1e-3).any() for array in units):
            raise BadObject(f"object {self.id}: quaternions and normals must be of length 1")
        if self.seat_polygon.shape[0] in (1, 2):
            raise BadObject(f"object {self.id}: a seat's outline has 3 or more corners")
        given = {"seat_height": self.seat_height, "mass": self.mass, "friction": self.friction}
        for name, value in given.items():
            if value is not None and not 0 < value < 1e4:
                raise BadObject(f"object {self.id}: {name} is {value}, which cannot be")
        if self.movable and self.mass is None:
            raise BadObject(f"object {self.id} can be moved but has no mass")

    @property
    def split(self) -> str:
        """`train` or `test`, 3:1, decided by the id alone."""
        return split_of(self.id)

    def corners(self) -> np.ndarray:
        """(B, 8, 3) corners of all boxes [m]."""
        from mimicbench.core import rotations as rot

        signs = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1], indexing="ij"), -1).reshape(8, 3)
        return self.box_pos[:, None] + rot.rotate(self.box_quat[:, None], signs * self.box_half[:, None])

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest corner (3,) of the bounding box [m]: x is length (front to back), y width, z height."""
        low, high = self._bounds
        return low.copy(), high.copy()

    @cached_property
    def _bounds(self) -> tuple[np.ndarray, np.ndarray]:
        corners = self.corners().reshape(-1, 3)
        return corners.min(0), corners.max(0)

    def contains_xy(self, points: np.ndarray) -> np.ndarray:
        """Whether points (..., 2+) lie in the object's interior in the bird-eye view: its bounding rectangle
        (appendix D.1).
        """
        low, high = self.bounds()
        return np.all((points[..., :2] >= low[:2]) & (points[..., :2] <= high[:2]), axis=-1)

    def distance(self, points: np.ndarray) -> np.ndarray:
        """(...,) from points (..., 3) in the object's frame to its boxes [m]; 0 inside of one."""
        from mimicbench.core import rotations as rot

        local = np.abs(rot.rotate_inverse(self.box_quat, points[..., None, :] - self.box_pos)) - self.box_half
        return np.linalg.norm(np.maximum(local, 0.0), axis=-1).min(-1)

    def require_seat(self) -> float:
        """The seat's height. Raises BadObject if there is none."""
        if self.seat_height is None:
            raise BadObject(f"object {self.id} has no seat; this task needs something to sit or lie on")
        return self.seat_height

    def to_dict(self) -> dict:
        """Plain JSON values."""
        return {
            "id": self.id,
            "family": self.family,
            "kind": self.kind,
            "box_pos": self.box_pos.tolist(),
            "box_quat": self.box_quat.tolist(),
            "box_half": self.box_half.tolist(),
            "box_rgb": self.box_rgb.tolist(),
            "seat_height": self.seat_height,
            "seat_polygon": self.seat_polygon.tolist(),
            "head_xy": self.head_xy.tolist(),
            "touch_points": self.touch_points.tolist(),
            "touch_normals": self.touch_normals.tolist(),
            "movable": self.movable,
            "mass": self.mass,
            "friction": self.friction,
            "hulls": [hull.tolist() for hull in self.hulls],
        }

    @staticmethod
    def from_dict(data: dict) -> "SceneObject":
        """The inverse of to_dict. Raises BadObject."""
        try:
            arrays = {
                name: np.array(data[name], dtype=float) for name in ("box_pos", "box_quat", "box_half", "box_rgb")
            }
            return SceneObject(
                id=data["id"],
                family=data["family"],
                kind=data["kind"],
                **arrays,
                seat_height=data["seat_height"],
                seat_polygon=np.array(data["seat_polygon"], dtype=float).reshape(-1, 2),
                head_xy=np.array(data["head_xy"], dtype=float),
                touch_points=np.array(data["touch_points"], dtype=float).reshape(-1, 3),
                touch_normals=np.array(data["touch_normals"], dtype=float).reshape(-1, 3),
                movable=data["movable"],
                mass=data["mass"],
                friction=data["friction"],
                hulls=tuple(np.array(hull, dtype=float) for hull in data["hulls"]),
            )
        except KeyError as error:
            raise BadObject(f"not an object description: it lacks {error}") from None
        except (TypeError, ValueError, AttributeError, OverflowError) as error:
            raise BadObject(f"not an object description: {error}") from None


def save_object(folder: Path, obj: SceneObject) -> None:
    """Write one object as `<folder>/<id>.json`."""
    write_record(folder / f"{obj.id}.json", obj.to_dict())


def load_object(folder: Path, object_id: str) -> SceneObject:
    """Read one object. Raises BadFile or BadObject."""
    path = folder / f"{object_id}.json"
    known = [entry.name for entry in fields(SceneObject)]
    obj = SceneObject.from_dict(read_record(path, known, max_bytes=1 << 20))
    if obj.id != object_id:
        raise BadObject(f"{path} holds the object {obj.id}; rename it, or make it again")
    return obj
