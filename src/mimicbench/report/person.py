"""How a person looks in pictures: rounded solids in clothes, on the joints of a human skeleton."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.motion import Skeleton
from mimicbench.references.skeletons import UNIHSI

Vector = tuple[float, float, float]

SKIN: Vector = (0.86, 0.66, 0.54)
HAIR: Vector = (0.24, 0.17, 0.13)
SHIRT: Vector = (0.16, 0.45, 0.58)
TROUSERS: Vector = (0.25, 0.27, 0.34)
SHOES: Vector = (0.93, 0.92, 0.90)
SOLES: Vector = (0.55, 0.42, 0.32)


@dataclass(frozen=True)
class Solid:
    """A capsule, ellipsoid or box in the frame of a joint, at body size 1."""

    joint: str
    kind: str
    """`capsule` or `ellipsoid`."""
    rgb: Vector
    size: Vector
    """Half sizes [m]; of a capsule the radius first, and the rest is not read."""
    at: Vector
    """Center, or one end of a capsule [m]."""
    to: Vector | None = None
    """Other end of a capsule."""


def _capsule(joint: str, rgb: Vector, radius: float, at: Vector, to: Vector) -> Solid:
    return Solid(joint, "capsule", rgb, (radius, 0.0, 0.0), at, to)


def _unihsi() -> tuple[Solid, ...]:
    solids = [
        Solid("pelvis", "ellipsoid", TROUSERS, (0.104, 0.150, 0.095), (0.0, 0.0, 0.010)),
        _capsule("pelvis", TROUSERS, 0.084, (0.0, -0.062, -0.012), (0.0, 0.062, -0.012)),
        Solid("pelvis", "ellipsoid", SHIRT, (0.107, 0.145, 0.170), (0.0, 0.0, 0.150)),
        Solid("torso", "ellipsoid", SHIRT, (0.110, 0.164, 0.205), (0.002, 0.0, 0.060)),
        Solid("torso", "ellipsoid", SHIRT, (0.092, 0.186, 0.092), (-0.012, 0.0, 0.178)),
        _capsule("torso", SHIRT, 0.056, (-0.018, -0.135, 0.214), (-0.014, 0.135, 0.214)),
        _capsule("head", SKIN, 0.047, (-0.010, 0.0, 0.0), (0.004, 0.0, 0.10)),
        Solid("head", "ellipsoid", SKIN, (0.092, 0.074, 0.112), (0.022, 0.0, 0.165)),
        Solid("head", "ellipsoid", HAIR, (0.098, 0.082, 0.098), (0.000, 0.0, 0.197)),
        Solid("head", "ellipsoid", SKIN, (0.018, 0.013, 0.020), (0.112, 0.0, 0.148)),
    ]
    for side, out in (("left", 1.0), ("right", -1.0)):
        solids += [
            Solid("head", "ellipsoid", SKIN, (0.018, 0.010, 0.026), (0.010, 0.076 * out, 0.160)),
            Solid(f"{side}_upper_arm", "ellipsoid", SHIRT, (0.058, 0.056, 0.078), (0.0, -0.010 * out, -0.038)),
            _capsule(f"{side}_upper_arm", SHIRT, 0.052, (0.0, 0.0, -0.040), (0.0, 0.0, -0.125)),
            _capsule(f"{side}_upper_arm", SKIN, 0.040, (0.0, 0.0, -0.125), (0.0, 0.0, -0.272)),
            Solid(f"{side}_lower_arm", "ellipsoid", SKIN, (0.040, 0.039, 0.100), (0.0, 0.0, -0.065)),
            _capsule(f"{side}_lower_arm", SKIN, 0.030, (0.0, 0.0, -0.020), (0.0, 0.0, -0.245)),
            Solid(f"{side}_hand", "ellipsoid", SKIN, (0.036, 0.021, 0.066), (0.006, 0.0, -0.034)),
            _capsule(f"{side}_hand", SKIN, 0.012, (0.026, 0.0, 0.000), (0.044, 0.0, -0.040)),
            Solid(f"{side}_thigh", "ellipsoid", TROUSERS, (0.086, 0.084, 0.220), (0.0, 0.0, -0.110)),
            _capsule(f"{side}_thigh", TROUSERS, 0.066, (0.0, 0.0, -0.080), (0.0, 0.0, -0.415)),
            Solid(f"{side}_shin", "ellipsoid", TROUSERS, (0.063, 0.061, 0.190), (-0.008, 0.0, -0.130)),
            _capsule(f"{side}_shin", TROUSERS, 0.051, (0.0, 0.0, -0.020), (0.0, 0.0, -0.355)),
            _capsule(f"{side}_foot", SHOES, 0.037, (-0.012, 0.0, -0.006), (0.012, 0.0, -0.006)),
            Solid(f"{side}_foot", "ellipsoid", SHOES, (0.092, 0.044, 0.038), (0.045, 0.0, -0.014)),
            Solid(f"{side}_foot", "ellipsoid", SOLES, (0.094, 0.046, 0.010), (0.045, 0.0, -0.040)),
        ]
    return tuple(solids)


_DRESSED = {UNIHSI.name: (_unihsi(), UNIHSI)}
"""Solids by skeleton name, and the skeleton of body size 1 that they were fitted to."""


def solids_of(skeleton: Skeleton) -> tuple[Solid, ...]:
    """The solids of a skeleton, grown with its bones; for one that has no clothes here, a capsule along every bone."""
    for name, (solids, fitted) in _DRESSED.items():
        if skeleton.name == name and skeleton.joint_names == fitted.joint_names:
            size = float(np.linalg.norm(skeleton.offsets, axis=1).sum() / np.linalg.norm(fitted.offsets, axis=1).sum())
            return tuple(_grown(solid, size) for solid in solids)
    bones = zip(skeleton.parents, skeleton.offsets, skeleton.joint_names, strict=True)
    return tuple(_capsule(skeleton.joint_names[parent], SHIRT, 0.045, (0, 0, 0), tuple(offset)) for parent, offset, _ in bones if parent >= 0)


def _grown(solid: Solid, factor: float) -> Solid:
    size, at, to = (None if v is None else (v[0] * factor, v[1] * factor, v[2] * factor) for v in (solid.size, solid.at, solid.to))
    assert size is not None and at is not None
    return replace(solid, size=size, at=at, to=to)


@dataclass(frozen=True)
class Placed:
    """A solid in the world."""

    solid: Solid
    at_w: np.ndarray
    """(3,) center, or one end of a capsule [m]."""
    to_w: np.ndarray
    """(3,) other end of a capsule [m]; the center again for the others."""
    quat_w: np.ndarray
    """(4,) orientation."""


def place(solids: Sequence[Solid], skeleton: Skeleton, joint_pos_w: np.ndarray, joint_quat_w: np.ndarray) -> list[Placed]:
    """Where the solids are in one frame, given the joints' world positions (J, 3) and orientations (J, 4)."""
    placed = []
    for solid in solids:
        j = skeleton.index(solid.joint)
        ends = np.array([solid.at, solid.to or solid.at])
        at, to = joint_pos_w[j] + rot.rotate(joint_quat_w[j], ends)
        placed.append(Placed(solid, at, to, joint_quat_w[j]))
    return placed
