"""What a skeleton's joints are to a body: trunk, limbs, soles, and the shapes that touch floor and furniture.

Synthesis, contact detection, the quality gate and the drawings know bodies by these roles, never by a skeleton's joint
names. Left is side 0 with sign +1, right is side 1 with sign -1. Lengths are for the skeleton as it is in `SKELETONS`
(body size 1).
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from mimicbench.core.skeleton import Skeleton
from mimicbench.references.body.skeletons import CORE4D, ROAM, UNIHSI, get_skeleton

Vector = tuple[float, float, float]


class Limb(NamedTuple):
    """Joints of an arm (shoulder, elbow, wrist) or a leg (hip, knee, ankle)."""

    root: int
    middle: int
    end: int


@dataclass(frozen=True)
class Part:
    """A capsule that stands for a body part; a sphere where both ends agree."""

    joint: int
    start: Vector
    """One end of its axis in the joint's frame [m]."""
    end: Vector
    radius: float
    """[m]"""
    role: str
    """`pelvis`, `trunk`, `head`, `upper_arm`, `lower_arm`, `hand`, `thigh`, `shin` or `foot`."""


@dataclass(frozen=True)
class Body:
    """A person of some size on some skeleton. All joints are indices."""

    skeleton: Skeleton
    size: float
    """How many times as long as in `SKELETONS` every bone is."""
    spine: tuple[int, ...]
    """Joints above the pelvis that bend the trunk, the lowest first; the last one is the chest, which carries the
    arms."""
    neck: tuple[int, ...]
    """Joints that turn the head, the lowest first; the last one is the head."""
    arms: tuple[Limb, Limb]
    legs: tuple[Limb, Limb]
    toes: tuple[int, int] | None
    """Joints in which the feet bend, if there are any."""
    sole: float
    """Height of the ankle above the sole [m]."""
    toe: float
    """The sole reaches so far in front of the ankle [m]."""
    heel: float
    """And so far behind it [m]; negative."""
    foot_half_width: float
    """[m]"""
    buttock: float
    """Height of the pelvis joint over what it sits on [m]."""
    back: float
    """From the chest's joint to the surface of the back [m]; the height of both spine and pelvis over what the body
    lies on."""
    hand: float
    """From the wrist to the palm's middle, along the forearm [m]."""
    parts: tuple[Part, ...]

    @property
    def pelvis(self) -> int:
        """The root joint."""
        return 0

    @property
    def chest(self) -> int:
        """The joint that carries the arms."""
        return self.spine[-1]

    @property
    def head(self) -> int:
        """The joint that carries the head."""
        return self.neck[-1]

    def length(self, limb: Limb) -> tuple[float, float]:
        """Upper and lower link [m]."""
        offsets = self.skeleton.offsets
        return float(np.linalg.norm(offsets[limb.middle])), float(np.linalg.norm(offsets[limb.end]))

    @property
    def hip_drop(self) -> float:
        """How far the hips are below the pelvis joint [m]."""
        return -float(self.skeleton.offsets[self.legs[0].root, 2])

    @property
    def leg_length(self) -> float:
        """From hip to ankle of a straight leg [m]."""
        return sum(self.length(self.legs[0]))

    @property
    def hip_half_width(self) -> float:
        """From the middle of the body to a hip [m]."""
        return float(self.skeleton.offsets[self.legs[0].root, 1])

    @property
    def standing_height(self) -> float:
        """Of the pelvis joint above the floor with straight legs [m]."""
        return self.hip_drop + sum(self.length(self.legs[0])) + self.sole

    def scaled(self, factor: float) -> "Body":
        """The same body `factor` times as large."""

        def grow(vector: Vector) -> Vector:
            return vector[0] * factor, vector[1] * factor, vector[2] * factor

        lengths = ("size", "sole", "toe", "heel", "foot_half_width", "buttock", "back", "hand")
        return replace(
            self,
            skeleton=self.skeleton.scaled(factor),
            **{name: getattr(self, name) * factor for name in lengths},
            parts=tuple(
                replace(part, start=grow(part.start), end=grow(part.end), radius=part.radius * factor)
                for part in self.parts
            ),
        )


def body_of(skeleton: Skeleton) -> Body:
    """The body of a skeleton in a clip: one of `SKELETONS` by name and joints, of the size that its legs tell.

    Raises UnknownName.
    """
    standard = _standard(get_skeleton(skeleton.name).name)
    leg = standard.legs[0]
    size = np.linalg.norm(skeleton.offsets[[leg.middle, leg.end]], axis=-1).sum() / sum(standard.length(leg))
    return replace(standard.scaled(float(size)), skeleton=skeleton)


def unihsi_body(size: float = 1.0) -> Body:
    """The body of tasks sit-chair and lie-bed."""
    return _standard("unihsi").scaled(size)


def roam_body(size: float = 1.0) -> Body:
    """The body of tasks sit-sofa and lie-sofa."""
    return _standard("roam").scaled(size)


def core4d_body(size: float = 1.0) -> Body:
    """The body of tasks touch-points and lift-box."""
    return _standard("core4d").scaled(size)


@lru_cache
def _standard(name: str) -> Body:
    return {"unihsi": _unihsi, "roam": _roam, "core4d": _core4d}[name]()


def _limb(skeleton: Skeleton, joints: tuple[str, str, str]) -> Limb:
    return Limb(*(skeleton.index(joint) for joint in joints))


def _sides(skeleton: Skeleton, joints: tuple[str, str, str], left: str, right: str) -> tuple[Limb, Limb]:
    """Both limbs, given names in which `{}` stands for the side."""
    return tuple(_limb(skeleton, tuple(joint.format(side) for joint in joints)) for side in (left, right))  # type: ignore[return-value]


def _limb_parts(
    skeleton: Skeleton, arms: tuple[Limb, Limb], legs: tuple[Limb, Limb], sole: float, toe: float, heel: float
) -> list[Part]:
    """Capsules in arms, legs and feet, thinner than the flesh: what they touch gives."""
    parts = []
    for limb, names, radii in (
        (arms, ("upper_arm", "lower_arm"), (0.045, 0.04)),
        (legs, ("thigh", "shin"), (0.055, 0.05)),
    ):
        for side in limb:
            for joint, child, role, radius in zip(side[:2], side[1:], names, radii, strict=True):
                length = float(np.linalg.norm(skeleton.offsets[child]))
                parts.append(Part(joint, (0, 0, -0.15 * length), (0, 0, -0.85 * length), radius, role))
    parts += [Part(arm.end, (0, 0, 0), (0, 0, 0), 0.04, "hand") for arm in arms]
    radius = 0.6 * sole
    return parts + [
        Part(leg.end, (heel + radius, 0, radius - sole), (toe - radius, 0, radius - sole), radius, "foot")
        for leg in legs
    ]


def _unihsi() -> Body:
    skeleton, index = UNIHSI, UNIHSI.index
    arms = _sides(skeleton, ("{}_upper_arm", "{}_lower_arm", "{}_hand"), "left", "right")
    legs = _sides(skeleton, ("{}_thigh", "{}_shin", "{}_foot"), "left", "right")
    sole, toe, heel, buttock = 0.05, 0.1335, -0.0435, 0.09
    trunk = [
        Part(0, (0, 0, 0), (0, 0, 0), buttock, "pelvis"),
        Part(index("torso"), (0, 0, 0), (0, 0, 0.12), 0.10, "trunk"),
        Part(index("head"), (0, 0, 0.175), (0, 0, 0.175), 0.095, "head"),
    ]
    return Body(
        skeleton,
        1.0,
        (index("torso"),),
        (index("head"),),
        arms,
        legs,
        None,
        sole,
        toe,
        heel,
        foot_half_width=0.045,
        buttock=buttock,
        back=0.10,
        hand=0.06,
        parts=(*trunk, *_limb_parts(skeleton, arms, legs, sole, toe, heel)),
    )


def _roam() -> Body:
    skeleton, index = ROAM, ROAM.index
    arms = _sides(skeleton, ("{}Arm", "{}ForeArm", "{}Hand"), "Left", "Right")
    legs = _sides(skeleton, ("{}UpLeg", "{}Leg", "{}Foot"), "Left", "Right")
    sole, toe, heel, buttock = 0.0690, 0.2104, -0.05, 0.10
    trunk = [
        Part(0, (0, 0, 0.01), (0, 0, 0.01), 0.105, "pelvis"),
        Part(index("Spine2"), (0, 0, 0), (0.02, 0, 0.20), 0.095, "trunk"),
        Part(index("Head"), (0.02, 0, 0.085), (0.02, 0, 0.085), 0.095, "head"),
    ]
    return Body(
        skeleton,
        1.0,
        tuple(index(name) for name in ("Spine", "Spine1", "Spine2", "Spine3")),
        tuple(index(name) for name in ("Spine4", "Neck", "Head")),
        arms,
        legs,
        (index("LeftToeBase"), index("RightToeBase")),
        sole,
        toe,
        heel,
        foot_half_width=0.045,
        buttock=buttock,
        back=0.09,
        hand=0.07,
        parts=(*trunk, *_limb_parts(skeleton, arms, legs, sole, toe, heel)),
    )


def _core4d() -> Body:
    skeleton, index = CORE4D, CORE4D.index
    arms = _sides(skeleton, ("{}_shoulder", "{}_elbow", "{}_wrist"), "left", "right")
    legs = _sides(skeleton, ("{}_hip", "{}_knee", "{}_ankle"), "left", "right")
    sole, toe, heel, buttock = 0.0863, 0.20, -0.06, 0.16
    trunk = [
        Part(0, (0, 0, -0.045), (0, 0, -0.045), 0.11, "pelvis"),
        Part(index("spine2"), (0, 0, 0), (0, 0, 0.16), 0.105, "trunk"),
        Part(index("head"), (0.02, 0, 0.075), (0.02, 0, 0.075), 0.10, "head"),
    ]
    return Body(
        skeleton,
        1.0,
        tuple(index(name) for name in ("spine1", "spine2", "spine3")),
        tuple(index(name) for name in ("neck", "head")),
        arms,
        legs,
        (index("left_foot"), index("right_foot")),
        sole,
        toe,
        heel,
        foot_half_width=0.05,
        buttock=buttock,
        back=0.105,
        hand=0.08,
        parts=(*trunk, *_limb_parts(skeleton, arms, legs, sole, toe, heel)),
    )
