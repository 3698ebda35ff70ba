"""A recording of a person as imported, not yet a clip of any task, and the checks that recordings of all formats go
through.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion, MimicbenchError
from mimicbench.core.motion_file import MAX_FRAMES
from mimicbench.core.names import safe_name
from mimicbench.core.skeleton import Skeleton, forward_kinematics
from mimicbench.references.body.body import Body, body_of
from mimicbench.references.checks.contacts import sole_points
from mimicbench.references.importers.lost import FASTEST, mend_lost_frames

MAX_BYTES = 256 << 20
"""Of a file, packed and unpacked."""
UNITS: Mapping[str, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "cmu": 0.0254 / 0.45}
"""Meters in a unit; `cmu` is that of the CMU library's skeletons."""
LEG = (0.55, 1.15)
"""Shortest and longest thigh and shin together of a person [m]."""
UPRIGHT, UPRIGHT_SHARE = 0.5, 0.2
"""A pelvis is upright if its z axis points up by more than this cosine; people are for more than this share of a
recording."""
HOP = 0.08
"""If the lower sole is usually so much above where it is lowest [m], people hop."""
BACKWARD = -0.02
"""[m] Of who is mirrored, knees are so far in front of the middle between hip and ankle; of others 1 cm or more."""
STATIC = 0.01
"""If no joint ever gets farther than this from where it was at first [m], nobody moves."""
STATURE = (1.4, 2.05)
"""Shortest and tallest person about whom nothing is said [m]."""


class WrongUnit(BadMotion):
    """A recording that has people's shape but not their size or speed: its unit of length is not as thought, or else
    something that is said. What helps depends on the format.
    """

    def __init__(self, what: str, other: str = "") -> None:
        super().__init__(what)
        self.other = other


@dataclass(frozen=True)
class Wishes:
    """What the user knows of the files; None where it is to be read or guessed."""

    fps: float | None = None
    """Frames per second."""
    up: str | None = None
    """The files' axis that points up: `x+`, `y+`, `z+`, `x-`, `y-` or `z-`."""
    unit: str | None = None
    """The files' unit of length, one of UNITS."""
    floor: float | None = None
    """Height of the floor [m], in the files' coordinates made metric."""
    mesh: Path | None = None
    """The mesh (OBJ, PLY, STL, GLB; meters) of the object that the files track."""
    scale: float | None = None
    """Meters in the files' unit of length, in place of a unit."""

    def __post_init__(self) -> None:
        """Raise MimicbenchError for numbers that cannot be."""
        if self.floor is not None and not abs(self.floor) < 1e3:
            raise MimicbenchError(f"a floor at {self.floor:g} m cannot be; give --floor in meters")
        if self.fps is not None and not 1 <= self.fps <= 1000:
            raise MimicbenchError(f"{self.fps:g} frames per second cannot be; give --fps between 1 and 1000")
        if self.scale is not None and not 1e-6 < self.scale < 1e6:
            raise MimicbenchError(f"a scale of {self.scale:g} cannot be; give --scale in meters per unit of the file")
        if self.scale is not None and self.unit is not None:
            raise MimicbenchError("give only one of --unit and --scale")


@dataclass(frozen=True)
class ObjectTrack:
    """Where a tracked object's mesh is."""

    pos_w: np.ndarray
    """(T, 3) its origin [m]."""
    quat_w: np.ndarray
    """(T, 4)"""


@dataclass(frozen=True)
class Recording:
    """A recording as imported, not yet next to any object: z up, the floor at z = 0."""

    name: str
    """The file's name without its ending, fit for ids."""
    skeleton: Skeleton
    """One of `SKELETONS` by name and joints, in their rest pose, with the person's own bone lengths."""
    fps: float
    root_pos_w: np.ndarray
    """(T, 3) pelvis [m]."""
    local_quat: np.ndarray
    """(T, J, 4) wxyz."""
    assumed: tuple[str, ...]
    """What was taken for granted, and what was mended, one sentence each."""
    track: ObjectTrack | None = None
    """Of the object, if the file has one."""
    wishes: Wishes = field(default_factory=Wishes)
    """What it was imported with."""

    @property
    def frames(self) -> int:
        """T."""
        return len(self.root_pos_w)

    def forward_kinematics(self) -> tuple[np.ndarray, np.ndarray]:
        """World positions (T, J, 3) [m] and orientations (T, J, 4) of all joints."""
        return forward_kinematics(self.skeleton, self.root_pos_w, self.local_quat)


def finish(path: Path, recording: Recording, stands: bool = True) -> Recording:
    """Check that a recording is of an upright person of human size, and move the floor to z = 0. Raises BadMotion.

    Args:
        path: the file, for messages.
        recording: with z up, the floor anywhere.
        stands: the person must stand upright in some frame; otherwise z is up because the format says so.
    """
    check_person(path, recording.skeleton)
    if stands:
        check_upright(path, recording.local_quat, recording.wishes.up)
    speed = np.linalg.norm(np.diff(recording.root_pos_w, axis=0), axis=-1) * recording.fps
    if np.quantile(speed, 0.98) > FASTEST:
        raise WrongUnit(f"{path}: the pelvis moves at {np.quantile(speed, 0.98):.3g} m/s", "frame rate (--fps)")
    root, local, mended = mend_lost_frames(path, recording.fps, recording.root_pos_w, recording.local_quat)
    recording = replace(recording, root_pos_w=root, local_quat=local)
    pos, quat = recording.forward_kinematics()
    check_knees(path, body_of(recording.skeleton), pos, quat)
    if np.linalg.norm(pos - pos[:1], axis=-1).max() < STATIC:
        raise BadMotion(f"{path} is a static pose: nobody moves in it; leave it out")
    tall = stature(body_of(recording.skeleton))
    doubt = "look whether the unit of length is right (--unit or --scale, for files that do not say it)"
    warned = () if STATURE[0] <= tall <= STATURE[1] else (f"the person would be {tall:.2f} m tall: {doubt}",)
    if recording.wishes.floor is None:
        floor, where = floor_height(recording.skeleton, pos, quat)
        said = f"the floor was taken to be where the soles {where}, at z = {floor:.3f} m"
    else:
        floor = recording.wishes.floor
        said = f"the floor is at z = {floor:.3f} m, as told"
    down = np.array([0.0, 0.0, floor])
    track = recording.track and replace(recording.track, pos_w=recording.track.pos_w - down)
    return replace(
        recording,
        name=safe_name(recording.name),
        root_pos_w=recording.root_pos_w - down,
        assumed=(*recording.assumed, *mended, *warned, said),
        track=track,
    )


def check_person(path: Path, skeleton: Skeleton) -> None:
    """A person's bones are of human length, and left is on the left. Raises BadMotion."""
    body = body_of(skeleton)
    for side, leg, sign in zip(("left", "right"), body.legs, (1, -1), strict=True):
        length = sum(body.length(leg))
        if not LEG[0] <= length <= LEG[1]:
            raise WrongUnit(f"{path}: its {side} leg is {length:.3g} m long without the foot, no person's")
        if skeleton.offsets[leg.root, 1] * sign <= 0.01:
            raise BadMotion(
                f"{path}: its {side} hip is not on the {side}; it is mirrored, or in left-handed "
                "coordinates: convert it first"
            )
    longest = np.linalg.norm(skeleton.offsets, axis=-1).max()
    if longest > 1.0:
        raise BadMotion(f"{path} has a bone of {longest:.3g} m, no person's; it is damaged, or mixes units of length")


def check_knees(path: Path, body: Body, pos: np.ndarray, quat: np.ndarray) -> None:
    """Knees bend forward; pos is (T, J, 3), quat (T, J, 4). Raises BadMotion.

    Formats whose files do not say which way people face take it from where left and right are: with these exchanged,
    people walk backward on knees that bend backward.
    """
    legs = [pos[:, leg.middle] - (pos[:, leg.root] + pos[:, leg.end]) / 2 for leg in body.legs]
    ahead = rot.rotate_inverse(quat[:, body.pelvis], np.mean(legs, 0))[:, 0]
    if np.median(ahead) < BACKWARD:
        raise BadMotion(
            f"{path}: its knees bend backward; left and right are exchanged, or it is in left-handed coordinates: "
            "convert it first"
        )


def stature(body: Body) -> float:
    """Of the person standing upright [m]: the head ends above the joint that carries the neck's last bone."""
    top, joint = 0.0, body.head
    while joint != body.pelvis:
        top += float(body.skeleton.offsets[joint, 2])
        joint = body.skeleton.parents[joint]
    crown = max(part.radius + max(part.start[2], part.end[2]) for part in body.parts if part.role == "head")
    return body.standing_height + top + crown


def check_upright(path: Path, quat: np.ndarray, told: str | None = None) -> None:
    """Somebody stands at some time, before a backflip perhaps; quat is (T, J, 4). Raises BadMotion.

    If only another order of the quaternion says so, the file is mixed up; unless the user has `told` which axis is up.
    """
    as_read, swapped = quat[:, 0], quat[:, 0][:, [1, 2, 3, 0]]
    share = [float((rot.rotate(q, np.array([0.0, 0.0, 1.0]))[:, 2] > UPRIGHT).mean()) for q in (as_read, swapped)]
    if share[0] < UPRIGHT_SHARE and told is not None:
        raise BadMotion(f"{path}: nobody stands upright in it with {told} up; give another --up, or leave that out")
    if share[0] < UPRIGHT_SHARE:
        hint = (
            "its quaternions seem to be wxyz where this format has xyzw"
            if share[1] > 0.7
            else "nobody stands upright in it, or z is not up"
        )
        raise BadMotion(f"{path}: {hint}; convert it first, or say which axis is up (--up)")


def floor_height(skeleton: Skeleton, pos: np.ndarray, quat: np.ndarray) -> tuple[float, str]:
    """Height of the floor [m], and where soles are on it: usually, while the person is up, by the lower sole.

    Who hops most of the time is on it when lowest. Some files put the lowest ankle of the whole recording at z = 0,
    which is some centimeters above the soles.
    """
    body = body_of(skeleton)
    # height above the lower ankle: the floor is not known yet
    height = pos[:, 0, 2] - pos[:, [leg.end for leg in body.legs], 2].min(-1)
    up = height >= 0.8 * np.quantile(height, 0.98)
    pos, quat = pos[up], quat[up]
    soles = [sole_points(body, pos[:, leg.end], quat[:, leg.end])[..., 2].min(-1) for leg in body.legs]
    low, usual = np.quantile(np.minimum(*soles), [0.05, 0.5])
    return (float(usual), "usually are") if usual - low < HOP else (float(low), "are at their lowest")


def check_array(path: Path, name: str, value: object, shape: tuple[int, ...], most: float = 1e4) -> np.ndarray:
    """Numbers of shape (T, *shape), finite and not beyond `most`, in double precision. Raises BadMotion."""
    if (
        not isinstance(value, np.ndarray)
        or value.dtype.kind not in "fiu"
        or value.shape[1:] != shape
        or value.ndim != len(shape) + 1
    ):
        found = f"an array of shape {value.shape}" if isinstance(value, np.ndarray) else type(value).__name__
        expected = ", ".join(map(str, ("frames", *shape)))
        raise BadMotion(
            f"{path}: {name} is {found}, expected numbers of shape ({expected}); it is damaged or in another format"
        )
    if not 2 <= len(value) <= MAX_FRAMES:
        raise BadMotion(
            f"{path} has {len(value)} frame{'s' * (len(value) != 1)}; a motion needs between 2 and "
            f"{MAX_FRAMES}: leave it out"
        )
    if not np.isfinite(value).all():
        raise BadMotion(f"{path}: {name} holds NaN or infinity; mend or drop the clip")
    largest = np.abs(value).max()
    if largest > most:
        raise BadMotion(f"{path}: {name} holds numbers as large as {largest:.2g}; it is damaged, or not in meters")
    return value.astype(float)


def check_rate(path: Path, fps: object, wishes: Wishes) -> float:
    """The frame rate: as told, or as the file has it. Raises BadMotion if that is none."""
    value = fps if wishes.fps is None else wishes.fps
    if isinstance(value, np.ndarray | np.generic) and value.size == 1:
        value = value.item()
    if isinstance(value, bool) or not isinstance(value, int | float | np.number) or not 1 <= value <= 1000:
        found = "no frames per second" if value is None else f"{value!r:.40} frames per second"
        raise BadMotion(f"{path} says {found}, which is no frame rate; say it (--fps)")
    return float(value)


def check_unit_quat(path: Path, quat: np.ndarray, order: str = "xyzw") -> np.ndarray:
    """Quaternions (..., 4) in the file's order, made wxyz and exactly of unit length.

    Raises BadMotion if they are far from it.
    """
    norm = np.linalg.norm(quat, axis=-1)
    if np.abs(norm - 1).max() > 1e-2:
        raise BadMotion(
            f"{path} has quaternions that are not of unit length (off by "
            f"{np.abs(norm - 1).max():.2g}); it is damaged or in another format"
        )
    return rot.normalize(quat[..., [order.index(letter) for letter in "wxyz"]])


def check_velocity(path: Path, pos: np.ndarray, stored: np.ndarray, fps: float) -> None:
    """Stored velocities (T, J, 3) [m/s] must be those of the positions at the stated rate. Raises BadMotion."""
    speed = np.linalg.norm(np.gradient(pos, 1 / fps, axis=0), axis=-1).mean()
    told = np.linalg.norm(stored, axis=-1).mean()
    if max(speed, told) > 0.05 and not 0.7 < speed / max(told, 1e-6) < 1.4:
        raise BadMotion(
            f"{path} says {fps:g} frames per second, but its stored velocities fit "
            f"{fps * told / max(speed, 1e-6):.0f}; mend its fps (--fps)"
        )
