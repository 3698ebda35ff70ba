"""Postures on standing feet with both hands at given places: balanced, within reach, clear of an object, and as easy
as can be.

A posture is chosen among leans and squats: in each the pelvis goes back as far as the trunk and the arms go forward, so
that the center of mass stays over the feet; those that do not reach, or that are inside the object, are out, and the
one with the least effort is taken.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.skeleton import forward_kinematics
from mimicbench.objects.shape import SceneObject
from mimicbench.objects.surface import box_distance
from mimicbench.references.body.body import Body
from mimicbench.references.body.limbs import about_y
from mimicbench.references.body.mass import center_of_mass
from mimicbench.references.body.posing import Legs, Trunk, pose, reach, shoulders, thigh_orientations
from mimicbench.references.checks.penetration import OWN, own_depth
from mimicbench.references.locomotion.gait import Gait
from mimicbench.references.locomotion.walking import REACH

EYES = np.array([0.08, 0.0, 0.62])
"""Between the eyes, from the pelvis joint in the axes of the chest [m], at body size 1."""
FORWARD = 0.05
"""The center of mass is so far in front of the ankles [m], at body size 1."""
NOD = 0.35
"""[rad] that the head bends down, at most: the eyes do the rest."""
CRANE = 0.5
"""Who leans bends the neck back by this share of the chest's lean, as people do who lift or lean on tables."""
GIVE = 0.003
"""[m] that flesh gives."""
STRETCH = 0.94
"""Share of its full length to which an arm is stretched in a posture."""
MOST_FLEXION = 2.15
"""[rad] that the hips may bend."""
PITCHES = np.array([0.03, 0.15, 0.28, 0.42, 0.56, 0.70, 0.84, 0.98, 1.12])
"""[rad] leans of the pelvis to choose from."""
DROPS = np.array([0.0, 0.05, 0.11, 0.18, 0.26, 0.36])
"""How far the hips may sink [m], at body size 1."""
ELBOWS = (0.35, 0.8, 0.0, 1.2, -0.5)
"""[rad] how far the elbows may swing out from below the arms; the most natural first."""
FACE = 0.04
"""[m] that the arms keep from the head."""
OFF_LEGS = 0.015
"""[m] and from the rest of the body, for hands that are laid on something turn."""
SIGHT = 0.50
"""[m] Nearer than that to the hands nobody likes to have the face, at body size 1: people reach with 0.5 to 0.7."""
OFF_FACE = 0.30
"""[m] Nor nearer than that to the object."""
FOLDED = 0.80
"""Share of its full length below which an arm is folded more than it is comfortable."""
TRIED = 8
"""Postures within reach that are tested against the object, the easiest first."""
BUT_HANDS = ("pelvis", "trunk", "head", "upper_arm", "lower_arm", "thigh", "shin", "foot")


@dataclass(frozen=True)
class Ground:
    """What a person stands on: ankles, heading."""

    ankle_pos_w: np.ndarray
    """(2, 3) left, right [m]."""
    yaw: float
    """[rad]"""

    @staticmethod
    def at(body: Body, middle: np.ndarray, yaw: float, gait: Gait) -> "Ground":
        """Feet side by side about (2,) [m], as wide as in walking."""
        left = 0.5 * gait.width * body.size * np.array([-np.sin(yaw), np.cos(yaw)])
        return Ground(np.concatenate([np.stack([middle + left, middle - left]), np.full((2, 1), body.sole)], -1), yaw)

    @property
    def middle(self) -> np.ndarray:
        """(2,) between the ankles [m]."""
        return self.ankle_pos_w[:, :2].mean(0)

    def support(self, body: Body) -> np.ndarray:
        """(2,) where the center of mass should be, seen from above [m]."""
        return self.middle + FORWARD * body.size * np.array([np.cos(self.yaw), np.sin(self.yaw)])

    def legs(self, frames: int) -> Legs:
        """The legs that go with it."""
        quat = rot.from_yaw(np.full((frames, 2), self.yaw))
        return Legs(np.tile(self.ankle_pos_w, (frames, 1, 1)), quat, rot.rotate(quat, np.array([0.0, 1.0, 0.0])))


@dataclass(frozen=True)
class Manner:
    """How somebody likes to get down to something."""

    load: float = 0.0
    """The object's mass as a share of the body's if it is carried."""
    bend: float = 0.0
    """How far the back is rounded, beyond what goes with a lean [rad]."""
    squat: float = 0.20
    """How far the hips sink with a lean of the pelvis [m/rad], at body size 1: more in the knees, less in the back."""
    sight: float = 1.0
    """Share of SIGHT and OFF_FACE that the face keeps where that is possible; 0 for who does not mind."""


@dataclass(frozen=True)
class Posture:
    """A body on its feet with the hands at their places; (N,) of them, or a single one without that axis."""

    pelvis_pos_w: np.ndarray
    """(N, 3) [m]."""
    pitch: np.ndarray
    """(N,) how far the pelvis leans forward [rad]."""
    twist: np.ndarray
    """(N,) turn of the chest from the feet's heading, to the left [rad]."""
    elbow: np.ndarray
    """(N,) how far the elbows swing out [rad]."""
    drop: np.ndarray
    """(N,) how far the hips sink below a stand with straight legs [m]."""
    bend: np.ndarray
    """(N,) how far the back is rounded beyond what goes with the lean [rad]."""

    def __getitem__(self, index: int | np.ndarray | np.integer | None) -> "Posture":
        return Posture(*(np.asarray(value)[index] for value in vars(self).values()))

    def trunk(self, yaw: float) -> Trunk:
        """The trunk over feet of that heading [rad]; the head looks down at the hands."""
        pelvis = rot.multiply(rot.from_yaw(yaw + 0.3 * self.twist), about_y(self.pitch))
        chest = rot.multiply(pelvis, chest_turn(self.pitch, self.twist, self.bend))
        nod = NOD - CRANE * (self.pitch + spine_flexion(self.pitch, self.bend))
        return Trunk(self.pelvis_pos_w, pelvis, chest, rot.multiply(chest, about_y(nod)))


def chest_turn(pitch: np.ndarray, twist: np.ndarray, bend: np.ndarray) -> np.ndarray:
    """(..., 4) the chest relative to a pelvis that leans by `pitch` (...) [rad]: a back that is the rounder the deeper
    the lean, and most of the twist.

    People who lift or lean on tables bend the spine as far as the hips.
    """
    return rot.multiply(rot.from_yaw(0.7 * twist), about_y(spine_flexion(pitch, bend)))


def spine_flexion(pitch: np.ndarray, bend: np.ndarray) -> np.ndarray:
    """(...) how far the spine bends with a pelvis that leans by `pitch` (...) [rad]."""
    return 0.02 + 0.30 * pitch + 0.25 * pitch**2 + bend


def elbow_axes(chest_quat_w: np.ndarray, elbow: np.ndarray) -> np.ndarray:
    """(T, 2, 3) hinges of elbows that swing out by (T,) [rad] from below the arms."""
    left = np.stack([np.zeros_like(elbow), np.cos(elbow), np.sin(elbow)], -1)
    return rot.rotate(chest_quat_w[:, None], np.stack([left, left * [1, 1, -1]], 1))


def _candidates(body: Body, ground: Ground, wrists: np.ndarray, bend: float) -> Posture:
    """All leans and squats to choose from for wrists at (2, 3) [m], not yet balanced."""
    pitch, drop = (values.ravel() for values in np.meshgrid(PITCHES, DROPS * body.size, indexing="ij"))
    apart = wrists[0] - wrists[1]
    twist = np.full(len(pitch), np.clip(0.7 * rot.wrap_angle(np.arctan2(-apart[0], apart[1]) - ground.yaw), -0.5, 0.5))
    back = -0.2 * body.size * np.sin(pitch)[:, None] * np.array([np.cos(ground.yaw), np.sin(ground.yaw), 0.0])
    start = np.array([*ground.support(body), 0.0]) + back
    elbow, bends = np.full_like(pitch, ELBOWS[0]), np.full_like(pitch, bend)
    return Posture(start, pitch, twist, elbow, drop, bends)


def find_posture(
    body: Body,
    ground: Ground,
    wrists: np.ndarray,
    obj: SceneObject,
    shift: np.ndarray,
    manner: Manner,
) -> tuple[Posture, float, float]:
    """The easiest posture in which both wrists are at (2, 3) [m], how far it falls short [m]: out of reach, or inside
    the object; and what effort it is.

    Args:
        body: Whose.
        ground: What it stands on.
        wrists: (2, 3) left, right [m]; that the hands themselves are clear of the object is up to whoever chose
            these places.
        obj: What must not be in the way.
        shift: (3,) where the object's origin is [m].
        manner: How the body likes to do it.
    """
    tried = _candidates(body, ground, wrists, manner.bend)
    every = _balanced(body, ground, tried, wrists, _weight_of(obj, shift, manner.load))
    pitch, drop = tried.pitch, tried.drop
    trunk = every.trunk(ground.yaw)
    away = np.linalg.norm(wrists - shoulders(body, trunk), axis=-1)
    stretch = away.max(-1) / sum(body.length(body.arms[0]))
    flexion = rot.angle_between(
        trunk.pelvis_quat_w[:, None], thigh_orientations(body, trunk, ground.legs(len(pitch)))
    ).max(-1)
    # a lean goes with some bend of the knees
    effort = (
        pitch
        + 5.0 * np.abs(drop - manner.squat * pitch * body.size)
        + 4.0 * np.maximum(stretch - 0.9, 0.0)
        + 2.0 * np.maximum(FOLDED - away.mean(-1) / sum(body.length(body.arms[0])), 0.0)
        + 2.0 * np.maximum(flexion - 1.7, 0.0)
        + manner.sight * _too_near(body, trunk, wrists, obj, shift)
    )
    out = np.maximum(stretch - STRETCH, 0.0) * sum(body.length(body.arms[0])) + 0.2 * np.maximum(
        flexion - MOST_FLEXION, 0.0
    )
    easiest = np.tile(np.argsort(effort + 100.0 * out, kind="stable")[:TRIED], len(ELBOWS))
    ranks = np.repeat(np.arange(len(ELBOWS)), TRIED)
    some = replace(every[easiest], elbow=np.array(ELBOWS)[ranks])
    there = placed(body, ground, some, wrists)
    own = in_own_way(body, *there)
    short = (
        np.maximum(depth(body, *there, obj, shift, BUT_HANDS) - GIVE, 0.0)
        + np.maximum(own + OFF_LEGS, 0.0)
        + out[easiest]
    )
    cost = effort[easiest] + 0.15 * ranks + 15.0 * np.maximum(own + 4 * OFF_LEGS, 0.0)
    best = int(np.argmin(cost + 100.0 * short))
    return some[best], float(short[best]), float(cost[best])


def _too_near(body: Body, trunk: Trunk, wrists: np.ndarray, obj: SceneObject, shift: np.ndarray) -> np.ndarray:
    """(N,) how unpleasantly near the face is to both hands (2, 3) [m] and to the object."""
    face = trunk.pelvis_pos_w + rot.rotate(trunk.chest_quat_w, EYES * body.size)
    hands = np.linalg.norm(face - wrists.mean(0), axis=-1)
    gap = box_distance(obj, face - shift)
    return 10.0 * np.maximum(SIGHT * body.size - hands, 0.0) + 10.0 * np.maximum(OFF_FACE * body.size - gap, 0.0)


def depth(
    body: Body, pos: np.ndarray, quat: np.ndarray, obj: SceneObject, shift: np.ndarray, roles: Sequence[str] = ()
) -> np.ndarray:
    """(T,) how deep the deepest body part is in an object at `shift` (3,) or (T, 3) [m], negative if it is clear of it.

    `pos` (T, J, 3) and `quat` (T, J, 4) are the joints'; only parts of these roles are looked at, if any are given.
    """
    parts = [part for part in body.parts if not roles or part.role in roles]
    along = np.linspace(0.0, 1.0, 5)[:, None]
    joints = np.repeat([part.joint for part in parts], len(along))
    local = np.concatenate([np.array(part.start) * (1 - along) + np.array(part.end) * along for part in parts])
    radii = np.repeat([part.radius for part in parts], len(along))
    points = pos[:, joints] + rot.rotate(quat[:, joints], local) - np.reshape(shift, (-1, 1, 3))
    return (radii - box_distance(obj, points)).max(-1)


def in_own_way(body: Body, pos: np.ndarray, quat: np.ndarray) -> np.ndarray:
    """(T,) how deep the arms are in the body itself, or nearer than FACE to the head [m].

    Negative if they are clear.
    """
    return np.maximum(own_depth(body, pos, quat, OWN), own_depth(body, pos, quat, ("head",)) + FACE).max(-1)


def _weight_of(obj: SceneObject, shift: np.ndarray, load: float) -> tuple[np.ndarray, float]:
    """Center (3,) [m] and mass of what is carried, as a share of the body's."""
    return shift + np.mean(obj.bounds(), 0), load


def _balanced(
    body: Body, ground: Ground, posture: Posture, wrists: np.ndarray, weight: tuple[np.ndarray, float]
) -> Posture:
    """The same postures with the pelvis where body and weight are in balance, and as high as their drop says."""
    support, (center, load) = ground.support(body), weight
    for _ in range(2):
        posture = replace(posture, pelvis_pos_w=_lowered(body, ground, posture))
        pos, _ = placed(body, ground, posture, wrists)
        off = support - (center_of_mass(body, pos) + load * center)[:, :2] / (1.0 + load)
        moved = posture.pelvis_pos_w + np.concatenate([1.2 * off, np.zeros((len(off), 1))], -1)
        posture = replace(posture, pelvis_pos_w=moved)
    return replace(posture, pelvis_pos_w=_lowered(body, ground, posture))


def _lowered(body: Body, ground: Ground, posture: Posture) -> np.ndarray:
    """Pelvis positions (N, 3) with the heights from which the legs reach their feet, less the drop [m]."""
    quat = posture.trunk(ground.yaw).pelvis_quat_w
    height = np.full(len(quat), np.inf)
    for side, leg in enumerate(body.legs):
        offset = rot.rotate(quat, body.skeleton.offsets[leg.root])
        hip, ankle = posture.pelvis_pos_w + offset, ground.ankle_pos_w[side]
        length = REACH * sum(body.length(leg))
        away = ((hip - ankle)[:, :2] ** 2).sum(-1)
        height = np.minimum(height, ankle[2] + np.sqrt(np.maximum(length**2 - away, 0.1 * length**2)) - offset[:, 2])
    return np.concatenate([posture.pelvis_pos_w[:, :2], (height - posture.drop)[:, None]], -1)


def placed(body: Body, ground: Ground, posture: Posture, wrists: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Joints' world positions (N, J, 3) and orientations (N, J, 4)."""
    trunk, count = posture.trunk(ground.yaw), len(posture.pitch)
    arms = reach(body, trunk, np.tile(wrists, (count, 1, 1)), elbow_axes(trunk.chest_quat_w, posture.elbow))
    return forward_kinematics(body.skeleton, posture.pelvis_pos_w, pose(body, trunk, ground.legs(count), arms))
