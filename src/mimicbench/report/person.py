"""How a person looks in pictures: rounded solids in clothes, on the joints of a human skeleton.

People of all skeletons and sizes are dressed alike, by what their joints are to the body (`references/body/body.py`).
Widths and depths are those of a person UNIT tall, in units of that height; lengths along limbs and trunk are shares of
the bones.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.motion import Skeleton, forward_kinematics
from mimicbench.references.body.body import Body, Limb, body_of
from mimicbench.references.body.skeletons import SKELETONS

Vector = tuple[float, float, float]

SKIN: Vector = (0.86, 0.66, 0.54)
HAIR: Vector = (0.24, 0.17, 0.13)
EYES: Vector = (0.16, 0.13, 0.12)
SHIRT: Vector = (0.16, 0.45, 0.58)
TROUSERS: Vector = (0.25, 0.27, 0.34)
SHOES: Vector = (0.93, 0.92, 0.90)
SOLES: Vector = (0.55, 0.42, 0.32)

UNIT = 1.61
"""Stature of the person whom the widths below fit [m]."""
_HEAD_TOP = 0.095
"""From the middle of the skull to the top of the hair, of that person [m]."""


@dataclass(frozen=True)
class Solid:
    """A capsule or ellipsoid in the frame of a joint."""

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
    yaw: float = 0.0
    """How an ellipsoid is turned about the joint's z [rad]."""


@dataclass(frozen=True)
class _Wardrobe:
    """A body in its rest pose, to be dressed."""

    body: Body
    rest: np.ndarray
    """(J, 3) where its joints are; all frames are parallel to the world's [m]."""
    unit: float
    """Its stature over UNIT."""

    def name(self, joint: int) -> str:
        return self.body.skeleton.joint_names[joint]

    def ellipsoid(self, joint: int, rgb: Vector, size: Vector, at: Vector, yaw: float = 0.0) -> Solid:
        """Of half sizes in units, and with its center in the joint's frame [m]."""
        return Solid(
            self.name(joint),
            "ellipsoid",
            rgb,
            (size[0] * self.unit, size[1] * self.unit, size[2] * self.unit),
            at,
            None,
            yaw,
        )

    def capsule(self, joint: int, rgb: Vector, radius: float, at: Vector, to: Vector) -> Solid:
        """Of a radius in units, and with its ends in the joint's frame [m]."""
        return Solid(self.name(joint), "capsule", rgb, (radius * self.unit, 0.0, 0.0), at, to)


def solids_of(skeleton: Skeleton) -> tuple[Solid, ...]:
    """The solids of a skeleton, grown with its bones.

    For one whose joints nobody has named a role, a capsule along every bone.
    """
    standard = SKELETONS.get(skeleton.name)
    if standard is not None and standard.joint_names == skeleton.joint_names:
        return dress(body_of(skeleton))
    bones = zip(skeleton.parents, skeleton.offsets, strict=True)
    return tuple(
        Solid(skeleton.joint_names[parent], "capsule", SHIRT, (0.045, 0, 0), (0, 0, 0), tuple(offset))
        for parent, offset in bones
        if parent >= 0
    )


def dress(body: Body) -> tuple[Solid, ...]:
    """The solids of a body: trunk, head, and on both sides arm, leg and foot."""
    joints = len(body.skeleton.joint_names)
    rest, _ = forward_kinematics(body.skeleton, np.zeros(3), np.tile(rot.IDENTITY, (joints, 1)))
    top = float(rest[body.head, 2] + _skull(body)[2]) + body.standing_height
    wardrobe = _Wardrobe(body, rest, top / (UNIT - _HEAD_TOP))
    solids = [*_trunk(wardrobe), *_head(wardrobe)]
    for side, out in enumerate((1.0, -1.0)):
        toes = None if body.toes is None else body.toes[side]
        solids += [
            *_arm(wardrobe, body.arms[side], out),
            *_leg(wardrobe, body.legs[side], out),
            *_foot(wardrobe, body.legs[side].end, toes),
        ]
    return tuple(solids)


def _skull(body: Body) -> Vector:
    """The middle of the skull in the head's frame [m]."""
    return next(part.start for part in body.parts if part.role == "head")


def _trunk(w: _Wardrobe) -> list[Solid]:
    body, rest, unit = w.body, w.rest, w.unit
    hips, shoulders = (rest[[limb.root for limb in limbs]].mean(0) for limbs in (body.legs, body.arms))
    broad = max(float(rest[body.arms[0].root, 1]) / unit, 0.150)
    seat, length = -body.buttock, float(shoulders[2] - hips[2])
    column = (body.pelvis, *body.spine)
    middle = float(rest[body.chest, 0]) - body.back + 0.110 * unit  # the back's surface is where the body lies on it

    def at(share: float, ahead: float, joint: int) -> Vector:
        """The place so far up from hips to shoulders, in the frame of a joint."""
        x = np.interp(share, [0.0, 0.5], [0.5 * hips[0], middle]) + ahead * unit
        return float(x - rest[joint, 0]), 0.0, float(hips[2] + share * length - rest[joint, 2])

    def below(share: float) -> int:
        """The last joint of the column that is not above that place."""
        return [joint for joint in column if rest[joint, 2] <= hips[2] + share * length + 1e-6 or joint == body.pelvis][
            -1
        ]

    x = at(0.0, 0.0, body.pelvis)[0]
    low = seat + 0.086 * unit
    chest = body.chest
    line = at(0.95, 0.0, chest)
    line = (0.5 * (line[0] - 0.012 * unit + float(shoulders[0] - rest[chest, 0])), 0.0, line[2])
    # necks that are long from shoulders to skull are shoulders that slope
    rise = max(0.0, float(rest[body.head, 2] + _skull(body)[2] - shoulders[2]) - 0.155 * unit)
    collar = line[2] + 0.012 * unit + 0.75 * rise
    nape = (
        float(np.interp(collar + rest[chest, 2], rest[list(body.neck), 2], rest[list(body.neck), 0]) - rest[chest, 0])
        - 0.008 * unit
    )
    slopes = [
        w.capsule(
            chest,
            SHIRT,
            0.046,
            (line[0], 0.80 * broad * unit * out, line[2] + 0.008 * unit),
            (nape, 0.024 * unit * out, collar),
        )
        for out in (1.0, -1.0)
    ]
    return [
        *slopes,
        w.ellipsoid(
            chest, SHIRT, (0.046, 0.075, 0.090), (0.5 * (nape + line[0]) - 0.020 * unit, 0.0, collar - 0.062 * unit)
        ),
        w.ellipsoid(body.pelvis, TROUSERS, (0.104, 0.150, 0.095), (x, 0.0, seat + 0.100 * unit)),
        w.capsule(body.pelvis, TROUSERS, 0.084, (x, -0.062 * unit, low), (x, 0.062 * unit, low)),
        w.ellipsoid(below(0.20), SHIRT, (0.106, 0.147, 0.110), at(0.20, 0.0, below(0.20))),
        w.ellipsoid(below(0.34), SHIRT, (0.105, 0.143, 0.150), at(0.34, 0.0, below(0.34))),
        w.ellipsoid(below(0.50), SHIRT, (0.106, 0.148, 0.150), at(0.50, 0.0, below(0.50))),
        w.ellipsoid(chest, SHIRT, (0.110, 0.90 * broad, 0.195), at(0.63, 0.0, chest)),
        w.ellipsoid(chest, SHIRT, (0.090, broad + 0.003, 0.088), at(0.86, -0.012, chest)),
        w.capsule(
            chest, SHIRT, 0.054, (line[0], -0.74 * broad * unit, line[2]), (line[0], 0.74 * broad * unit, line[2])
        ),
    ]


def _head(w: _Wardrobe) -> list[Solid]:
    body, unit = w.body, w.unit
    # over the shoulders, as far as the neck's bones let it
    x = float(
        np.clip(w.rest[[arm.root for arm in body.arms], 0].mean() + 0.046 * unit - w.rest[body.head, 0], -0.01, 0.03)
    )
    middle = np.array([x, 0.0, _skull(body)[2] - 0.008 * unit])

    def at(ahead: float, left: float, up: float) -> Vector:
        """A place beside the middle of the skull."""
        place = middle + unit * np.array([ahead, left, up])
        return float(place[0]), float(place[1]), float(place[2])

    neck = [
        w.capsule(joint, SKIN, 0.047, (0, 0, 0), tuple(body.skeleton.offsets[following]))
        for joint, following in zip(body.neck, body.neck[1:], strict=False)
    ]
    head = body.head
    return [
        *neck,
        w.capsule(head, SKIN, 0.047, (-0.005 * unit, 0, 0), at(-0.020, 0.0, -0.045)),
        w.ellipsoid(head, SKIN, (0.088, 0.073, 0.092), at(0.0, 0.0, 0.012)),
        w.ellipsoid(head, SKIN, (0.066, 0.056, 0.070), at(0.020, 0.0, -0.046)),
        w.ellipsoid(head, HAIR, (0.098, 0.082, 0.090), at(-0.020, 0.0, 0.036)),
        w.ellipsoid(head, HAIR, (0.060, 0.072, 0.075), at(-0.052, 0.0, -0.008)),
        w.ellipsoid(head, SKIN, (0.018, 0.012, 0.020), at(0.090, 0.0, -0.014)),
        *(w.ellipsoid(head, EYES, (0.007, 0.011, 0.008), at(0.076, 0.031 * out, 0.010)) for out in (1.0, -1.0)),
        *(w.ellipsoid(head, SKIN, (0.018, 0.010, 0.026), at(-0.008, 0.075 * out, -0.006)) for out in (1.0, -1.0)),
    ]


def _arm(w: _Wardrobe, arm: Limb, out: float) -> list[Solid]:
    unit = w.unit
    upper, lower = w.body.length(arm)
    # sleeves are short; the palm faces inwards, its thumb ahead
    palm = 0.060 * unit
    return [
        w.ellipsoid(arm.root, SHIRT, (0.055, 0.052, 0.078), (0.0, -0.010 * out * unit, -0.14 * upper)),
        w.capsule(arm.root, SHIRT, 0.051, (0.0, 0.0, -0.15 * upper), (0.0, 0.0, -0.46 * upper)),
        w.capsule(arm.root, SKIN, 0.040, (0.0, 0.0, -0.46 * upper), (0.0, 0.0, -0.99 * upper)),
        w.ellipsoid(arm.middle, SKIN, (0.040, 0.039, 0.095), (0.0, 0.0, -0.25 * lower)),
        w.capsule(arm.middle, SKIN, 0.029, (0.0, 0.0, -0.08 * lower), (0.0, 0.0, -0.96 * lower)),
        w.ellipsoid(arm.end, SKIN, (0.038, 0.019, 0.052), (0.004 * unit, 0.0, -0.72 * palm)),
        w.ellipsoid(arm.end, SKIN, (0.031, 0.014, 0.050), (0.002 * unit, 0.0, -1.45 * palm)),
        w.capsule(arm.end, SKIN, 0.011, (0.024 * unit, 0.0, -0.25 * palm), (0.044 * unit, 0.0, -0.95 * palm)),
    ]


def _leg(w: _Wardrobe, leg: Limb, out: float) -> list[Solid]:
    unit = w.unit
    thigh, shin = w.body.length(leg)
    # flesh is as far apart as other people's where the joints are close together
    aside = max(0.0, 0.080 * unit - w.body.hip_half_width) * out
    # and no thicker below than the hips are above a seat
    ahead = max(0.0, 0.085 * unit - (w.body.buttock - w.body.hip_drop))
    return [
        w.ellipsoid(leg.root, TROUSERS, (0.085, 0.082, 0.215), (ahead, 0.8 * aside, -0.26 * thigh)),
        w.capsule(leg.root, TROUSERS, 0.066, (0.0, 0.7 * aside, -0.19 * thigh), (0.0, 0.1 * aside, -0.985 * thigh)),
        w.ellipsoid(leg.middle, TROUSERS, (0.063, 0.061, 0.185), (-0.008 * unit, 0.0, -0.32 * shin)),
        w.capsule(leg.middle, TROUSERS, 0.051, (0.0, 0.0, -0.05 * shin), (0.0, 0.0, -0.87 * shin)),
    ]


def _foot(w: _Wardrobe, ankle: int, toes: int | None) -> list[Solid]:
    """A shoe that points to where the toes are, and bends in them if the skeleton does."""
    body, unit = w.body, w.unit
    heel, tip, floor = body.heel, max(body.toe, 0.150 * unit), -body.sole
    ahead = np.array([1.0, 0.0, 0.0]) if toes is None else body.skeleton.offsets[toes] * (1, 1, 0)
    ball = 0.62 * tip if toes is None else float(np.linalg.norm(ahead))
    yaw = 0.5 * float(np.arctan2(ahead[1], ahead[0]))  # the joint is not in the middle of the ball
    ahead = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    bend = ankle if toes is None else toes
    origin = np.zeros(3) if toes is None else body.skeleton.offsets[toes]

    def at(along: float, up: float, front: bool = False) -> Vector:
        """A place so far ahead of the ankle and above the floor, in the frame of ankle or toes."""
        place = along * ahead + (0, 0, floor + up) - (origin if front else np.zeros(3))
        return float(place[0]), float(place[1]), float(place[2])

    def part(joint: int, rgb: Vector, half: float, wide: float, high: float, place: Vector) -> Solid:
        return Solid(w.name(joint), "ellipsoid", rgb, (half, wide * unit, high), place, None, yaw)

    back, front = 0.5 * (ball + 0.03 * unit - heel), 0.5 * (tip - ball + 0.07 * unit)
    rear, fore = heel + back, tip - front
    thick = 0.010 * unit
    instep = 0.5 * ball + 0.004 * unit
    return [
        w.capsule(
            ankle, SHOES, 0.039, at(-0.008 * unit, 0.045 * unit), at(-0.002 * unit, max(0.045 * unit, body.sole))
        ),
        part(ankle, SHOES, back, 0.043, 0.038 * unit, at(rear, 0.039 * unit)),
        w.capsule(ankle, SHOES, 0.034, at(0.010 * unit, 0.052 * unit), at(instep + 0.02 * unit, 0.038 * unit)),
        part(ankle, SOLES, back, 0.046, thick, at(rear, thick)),
        part(bend, SHOES, front, 0.046, 0.031 * unit, at(fore, 0.031 * unit, True)),
        part(bend, SOLES, front + 0.002 * unit, 0.048, thick, at(fore, thick, True)),
    ]


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


def place(
    solids: Sequence[Solid], skeleton: Skeleton, joint_pos_w: np.ndarray, joint_quat_w: np.ndarray
) -> list[Placed]:
    """Where the solids are in one frame, given the joints' world positions (J, 3) and orientations (J, 4)."""
    placed = []
    for solid in solids:
        j = skeleton.index(solid.joint)
        ends = np.array([solid.at, solid.to or solid.at])
        at, to = joint_pos_w[j] + rot.rotate(joint_quat_w[j], ends)
        placed.append(Placed(solid, at, to, rot.multiply(joint_quat_w[j], rot.from_yaw(np.array(solid.yaw)))))
    return placed
