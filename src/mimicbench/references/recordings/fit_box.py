"""The box that a person lifts: the recorded object's, or one fitted between the hands; and what a person touches."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion
from mimicbench.core.seeds import rng
from mimicbench.objects.families.box import build_box
from mimicbench.objects.importing.convex import box_around
from mimicbench.objects.importing.mesh import read_mesh
from mimicbench.objects.shape import SceneObject
from mimicbench.references.importers.recording import ObjectTrack

PALM = 0.03
"""Between a wrist that clasps and the side of the box [m]."""
FINGERS = 0.12
"""Between a wrist that reaches out and what it reaches for [m]."""
GRIP = 0.8
"""Where on its height hands clasp a box."""
SIZES = (0.08, 2.5)
"""Shortest and longest side [m]."""
MASS_PER_VOLUME = 12.0
"""[kg/m^3], as of the family's boxes: 1 to 4 kg in a quarter of a cubic meter."""


@dataclass(frozen=True)
class BoxTrack:
    """A box and where it is: its origin is on its lower side, in the middle, its x axis points to the person at
    first.
    """

    obj: SceneObject
    pos_w: np.ndarray
    """(T, 3) [m]"""
    quat_w: np.ndarray
    """(T, 4)"""
    raised: float
    """How far the recorded object was moved up to stand on the floor [m]."""


def boxed(mesh: Path, track: ObjectTrack) -> tuple[ObjectTrack, np.ndarray]:
    """The track of the middle of the smallest box around a tracked mesh, turned as that box is, and the box's sides
    (3,) [m].

    Raises BadFile or BadMotion.
    """
    corners = read_mesh(mesh).vertices
    sides = np.ptp(corners, axis=0)
    if not ((sides >= 0.01) & (sides <= SIZES[1])).all():
        raise BadMotion(
            f"{mesh} is {' x '.join(f'{side:.3g}' for side in sides)} large; a tracked mesh is in "
            "meters: scale it first"
        )
    middle, quat, half = box_around(corners[ConvexHull(corners).vertices])
    return ObjectTrack(track.pos_w + rot.rotate(track.quat_w, middle), rot.multiply(track.quat_w, quat)), 2 * half


def box_of_mesh(object_id: str, track: ObjectTrack, sides: np.ndarray, person_xy: np.ndarray) -> BoxTrack:
    """The box around a tracked mesh that rests on the floor at first.

    Args:
        object_id: name of the box.
        track: of the box's middle, as `boxed` has it.
        sides: (3,) of the box along its own axes [m].
        person_xy: (2,) where the person stands [m].
    """
    # which of its axes is up, and which points to the person, while it rests
    axes = rot.to_matrix(track.quat_w[0])  # columns: the box's axes in the world
    third = int(np.abs(axes[2]).argmax())
    up = np.eye(3)[third] * np.sign(axes[2, third])
    toward = axes[:2].T @ (person_xy - track.pos_w[0, :2])
    toward[third] = 0.0
    first = int(np.abs(toward).argmax())
    front = np.eye(3)[first] * np.sign(toward[first])
    turn = rot.from_matrix(np.stack([front, np.cross(up, front), up], -1))
    size = sides[[first, 3 - first - third, third]]
    pos = track.pos_w + rot.rotate(track.quat_w, -0.5 * size[2] * up)
    return _level(object_id, size, pos, rot.multiply(track.quat_w, turn), 0)


def box_between(
    object_id: str, wrists: np.ndarray, pelvis: np.ndarray, clasp: int, track: ObjectTrack | None
) -> BoxTrack:
    """A box between the hands, standing on the floor until the frame `clasp`, from wrists (T, 2, 3) and pelvis (T,
    3) [m].

    After that it goes with the track of what was recorded, or with the hands.
    """
    left, right = wrists[clasp]
    middle = (left + right) / 2
    width = float(np.linalg.norm((left - right)[:2])) - 2 * PALM
    height = max(float(middle[2]) / GRIP, 0.12)
    size = np.array([min(max(0.8 * width, 0.25), 0.6), width, height])
    if not (SIZES[0] <= width <= SIZES[1] and height <= SIZES[1]):
        raise BadMotion(
            f"no box fits between hands that are {width:.2f} m apart and {middle[2]:.2f} m high; leave the clip out"
        )
    facing = _headings(wrists)
    to_person = pelvis[clasp, :2] - middle[:2]
    if np.cos(facing[clasp]) * to_person[0] + np.sin(facing[clasp]) * to_person[1] < 0:
        facing = facing + np.pi
    held = track or ObjectTrack(wrists.mean(1), rot.from_yaw(facing))
    base, yaw = np.array([middle[0], middle[1], 0.0]), rot.from_yaw(np.array(facing[clasp]))
    # how the box lies in the frame of what moves it
    inside = rot.rotate_inverse(held.quat_w[clasp], base - held.pos_w[clasp])
    turn = rot.multiply(rot.conjugate(held.quat_w[clasp]), yaw)
    pos, quat = held.pos_w + rot.rotate(held.quat_w, inside), rot.multiply(held.quat_w, turn)
    pos[:clasp], quat[:clasp] = base, yaw
    return _level(object_id, size, pos, quat, clasp)


def touched_box(object_id: str, palms: np.ndarray, pelvis: np.ndarray) -> tuple[SceneObject, np.ndarray, float]:
    """A cabinet behind what hands (2, 3) reach for, seen from the pelvis (3,) [m].

    And where (2,) it stands, and its heading [rad] to the person.
    """
    out = palms[:, :2] - pelvis[:2]
    far = int(np.linalg.norm(out, axis=-1).argmax())
    away = float(np.linalg.norm(out[far]))
    direction = out[far] / away
    size = (0.4, 0.6, float(np.clip(palms[far, 2] + 0.15, 0.4, 2.0)))
    obj = build_box(object_id, "wooden case", size, 20.0, rng(0, "fitted", object_id))
    # in front of the fingers of the hand that reaches, and of the other hand
    centre = pelvis[:2] + direction * (max(away, float((out @ direction).max())) + FINGERS + size[0] / 2)
    fixed = SceneObject(obj.id, "household", "cabinet", obj.box_pos, obj.box_quat, obj.box_half, obj.box_rgb)
    return fixed, centre, float(np.arctan2(-direction[1], -direction[0]))


def _headings(wrists: np.ndarray) -> np.ndarray:
    """(T,) heading across the line between the wrists (T, 2, 3), without turns of 2 pi [rad]."""
    line = wrists[:, 0, :2] - wrists[:, 1, :2]
    return np.unwrap(np.arctan2(line[:, 1], line[:, 0]) - np.pi / 2)


def _level(object_id: str, size: np.ndarray, pos: np.ndarray, quat: np.ndarray, rests: int) -> BoxTrack:
    """The box with that size, on the floor while it rests."""
    if not ((size >= SIZES[0]) & (size <= SIZES[1])).all():
        raise BadMotion(
            f"the object would be {' x '.join(f'{side:.2f}' for side in size)} m large; that is "
            "nothing to lift with both arms"
        )
    sunk = float(pos[rests, 2])
    mass = float(np.clip(MASS_PER_VOLUME * np.prod(size), 1.0, 4.0))
    obj = build_box(
        object_id, "carton", (float(size[0]), float(size[1]), float(size[2])), mass, rng(0, "fitted", object_id)
    )
    return BoxTrack(obj, pos - np.array([0.0, 0.0, sunk]), rot.normalize(quat), -sunk)
