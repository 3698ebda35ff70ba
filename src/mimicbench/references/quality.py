"""The gate that every clip must pass, synthetic or imported: what can be wrong with it, measured, and how much of that is too much."""

from dataclasses import dataclass

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.motion import HumanMotion
from mimicbench.objects.shape import SceneObject
from mimicbench.references.body import Body, Part, body_of


@dataclass(frozen=True)
class Limits:
    """What a good clip keeps to."""

    skate: float = 1e-6
    """Movement of a standing ankle per frame [m]."""
    object_depth: float = 0.03
    """Deepest that a body part may be in the object [m]: flesh and cushions give."""
    floor_depth: float = 0.005
    """Deepest that a sole may be in the floor [m]."""
    joint_speed: float = 12.0
    """Fastest turn of a joint [rad/s]."""
    joint_acceleration: float = 180.0
    """[rad/s^2]"""
    root_acceleration: float = 6.0
    """[m/s^2]"""
    knee: tuple[float, float] = (0.0, 2.4)
    """Bend of the knees [rad]."""
    hip: float = 2.35
    """Turn of the hips away from standing [rad]."""
    ankle: float = 0.9
    """Turn of the ankles away from standing [rad]."""


def check_clip(motion: HumanMotion, obj: SceneObject) -> dict[str, float]:
    """What can be wrong with a clip on an object: worst values over all frames, in SI units."""
    body = body_of(motion.skeleton)
    pos, quat = motion.forward_kinematics()
    measures = {"skate": _skate(motion, body, pos), "floor_depth": _floor_depth(body, pos, quat), "object_depth": 0.0, "seat_depth": 0.0}
    for part in body.parts:
        depth = _depth(motion, obj, pos, quat, part)
        measures["object_depth"] = max(measures["object_depth"], depth)
        if part.role == "pelvis":
            measures["seat_depth"] = depth
    step = rot.to_rotvec(rot.multiply(rot.conjugate(motion.local_quat[:-1]), motion.local_quat[1:])) * motion.fps
    measures["joint_speed"] = float(np.linalg.norm(step, axis=-1).max())
    measures["joint_acceleration"] = float(np.linalg.norm(np.diff(step, axis=0), axis=-1).max() * motion.fps) if motion.frames > 2 else 0.0
    velocity = np.diff(motion.root_pos_w, axis=0) * motion.fps
    measures["root_acceleration"] = float(np.linalg.norm(np.diff(velocity, axis=0), axis=-1).max() * motion.fps) if motion.frames > 2 else 0.0
    turn = rot.to_rotvec(motion.local_quat)
    knees = turn[:, [leg.middle for leg in body.legs], 1]
    measures["knee_least"], measures["knee_most"] = float(knees.min()), float(knees.max())
    measures["hip_most"] = float(np.linalg.norm(turn[:, [leg.root for leg in body.legs]], axis=-1).max())
    measures["ankle_most"] = float(np.linalg.norm(turn[:, [leg.end for leg in body.legs]], axis=-1).max())
    return measures


def is_good(measures: dict[str, float], limits: Limits | None = None) -> bool:
    """Whether what `check_clip` measured is within the limits."""
    return not faults(measures, limits)


def faults(measures: dict[str, float], limits: Limits | None = None) -> list[str]:
    """Names of the measures that are beyond the limits."""
    limits = limits or Limits()
    most = {
        "skate": limits.skate, "object_depth": limits.object_depth, "floor_depth": limits.floor_depth, "joint_speed": limits.joint_speed,
        "joint_acceleration": limits.joint_acceleration, "root_acceleration": limits.root_acceleration, "knee_most": limits.knee[1],
        "hip_most": limits.hip, "ankle_most": limits.ankle,
    }  # fmt: skip
    found = [name for name, limit in most.items() if not measures[name] <= limit]
    return found + ([] if measures["knee_least"] >= limits.knee[0] - 1e-9 else ["knee_least"])


def _skate(motion: HumanMotion, body: Body, pos: np.ndarray) -> float:
    """Largest movement of an ankle between two frames that both label its foot as standing [m]."""
    worst = 0.0
    for foot, leg in zip(("left_foot", "right_foot"), body.legs, strict=True):
        if foot in motion.contact_names:
            stands = motion.contacts[:, motion.contact_names.index(foot)].astype(bool)
            moved = np.linalg.norm(np.diff(pos[:, leg.end], axis=0), axis=-1)
            worst = max(worst, float(moved[stands[1:] & stands[:-1]].max(initial=0.0)))
    return worst


def _floor_depth(body: Body, pos: np.ndarray, quat: np.ndarray) -> float:
    """How far a corner of a sole is below the floor [m]."""
    corners = np.array([[x, y, -body.sole] for x in (body.toe, body.heel) for y in (body.foot_half_width, -body.foot_half_width)])
    feet = [leg.end for leg in body.legs]
    height = (pos[:, feet, None] + rot.rotate(quat[:, feet, None], corners))[..., 2]
    return max(0.0, -float(height.min()))


def _depth(motion: HumanMotion, obj: SceneObject, pos: np.ndarray, quat: np.ndarray, part: Part) -> float:
    """How deep a body part is in any of the object's boxes [m], sampled along its axis."""
    samples = np.linspace(part.start, part.end, 1 if part.start == part.end else 7)
    low, high = obj.bounds()
    reach = float(np.linalg.norm(samples, axis=-1).max()) + part.radius
    near = ((pos[:, part.joint] > low - reach) & (pos[:, part.joint] < high + reach)).all(-1)
    if not near.any():
        return 0.0
    points = pos[near, part.joint, None] + rot.rotate(quat[near, part.joint, None], samples)  # (T, S, 3)
    local = np.abs(rot.rotate(rot.conjugate(obj.box_quat), points[:, :, None] - obj.box_pos)) - obj.box_half
    distance = np.linalg.norm(np.maximum(local, 0.0), axis=-1) + np.minimum(local.max(-1), 0.0)
    return max(0.0, part.radius - float(distance.min()))
