"""Synthetic human clips: one function per task, and the gate that every clip must pass."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import UnknownName
from mimicbench.core.motion import HumanMotion
from mimicbench.objects.shape import SceneObject
from mimicbench.references import skeletons as human
from mimicbench.references.sit_chair import synthesize_sit_chair

TASKS: dict[str, Callable[[str, SceneObject, int], HumanMotion]] = {"sit-chair": synthesize_sit_chair}
"""What makes a clip of each task: (clip id, object, seed) -> clip."""


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


def synthesize(task: str, index: int, obj: SceneObject, seed: int) -> HumanMotion:
    """Clip number `index` of a task on an object; depends on these and the seed alone. Raises UnknownName or BadObject."""
    if task not in TASKS:
        raise UnknownName("task", task, list(TASKS))
    return TASKS[task](clip_id(task, index, seed), obj, seed)


def clip_id(task: str, index: int, seed: int) -> str:
    """Name of a synthetic clip, such as sit-chair-0-00042 with seed 0."""
    return f"{task}-{seed}-{index:05d}"


def check_clip(motion: HumanMotion, obj: SceneObject) -> dict[str, float]:
    """What can be wrong with a clip of the UniHSI skeleton on an object: worst values over all frames, in SI units."""
    pos, quat = motion.forward_kinematics()
    shin = motion.skeleton.index("left_shin")
    scale = float(motion.skeleton.offsets[shin, 2] / human.UNIHSI.offsets[human.UNIHSI.index("left_shin"), 2])
    measures = {
        "skate": _skate(motion, pos), "floor_depth": _floor_depth(motion, pos, quat, scale),
        "object_depth": 0.0, "seat_depth": 0.0,
    }  # fmt: skip
    for part in human.UNIHSI_PARTS:
        depth = _depth(motion, obj, pos, quat, part, scale)
        measures["object_depth"] = max(measures["object_depth"], depth)
        if part.joint == "pelvis":
            measures["seat_depth"] = depth
    step = rot.to_rotvec(rot.multiply(rot.conjugate(motion.local_quat[:-1]), motion.local_quat[1:])) * motion.fps
    measures["joint_speed"] = float(np.linalg.norm(step, axis=-1).max())
    measures["joint_acceleration"] = float(np.linalg.norm(np.diff(step, axis=0), axis=-1).max() * motion.fps) if motion.frames > 2 else 0.0
    velocity = np.diff(motion.root_pos_w, axis=0) * motion.fps
    measures["root_acceleration"] = float(np.linalg.norm(np.diff(velocity, axis=0), axis=-1).max() * motion.fps) if motion.frames > 2 else 0.0
    turn = rot.to_rotvec(motion.local_quat)
    index = motion.skeleton.index
    knees = turn[:, [index("left_shin"), index("right_shin")], 1]
    measures["knee_least"], measures["knee_most"] = float(knees.min()), float(knees.max())
    for name, joint in (("hip_most", "thigh"), ("ankle_most", "foot")):
        measures[name] = float(np.linalg.norm(turn[:, [index(f"left_{joint}"), index(f"right_{joint}")]], axis=-1).max())
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


def _skate(motion: HumanMotion, pos: np.ndarray) -> float:
    """Largest movement of an ankle between two frames that both label its foot as standing [m]."""
    worst = 0.0
    for foot in ("left_foot", "right_foot"):
        if foot in motion.contact_names:
            stands = motion.contacts[:, motion.contact_names.index(foot)].astype(bool)
            moved = np.linalg.norm(np.diff(pos[:, motion.skeleton.index(foot)], axis=0), axis=-1)
            worst = max(worst, float(moved[stands[1:] & stands[:-1]].max(initial=0.0)))
    return worst


def _floor_depth(motion: HumanMotion, pos: np.ndarray, quat: np.ndarray, scale: float) -> float:
    """How far a corner of a sole is below the floor [m]."""
    corners = np.array([[x, y, -human.SOLE] for x in (human.TOE, human.HEEL) for y in (human.FOOT_HALF_WIDTH, -human.FOOT_HALF_WIDTH)]) * scale
    feet = [motion.skeleton.index("left_foot"), motion.skeleton.index("right_foot")]
    height = (pos[:, feet, None] + rot.rotate(quat[:, feet, None], corners))[..., 2]
    return max(0.0, -float(height.min()))


def _depth(motion: HumanMotion, obj: SceneObject, pos: np.ndarray, quat: np.ndarray, part: human.Part, scale: float) -> float:
    """How deep a body part is in any of the object's boxes [m], sampled along its axis."""
    joint = motion.skeleton.index(part.joint)
    samples = np.linspace(part.start, part.end, 1 if part.start == part.end else 7) * scale
    low, high = obj.bounds()
    reach = float(np.linalg.norm(samples, axis=-1).max()) + part.radius * scale
    near = ((pos[:, joint] > low - reach) & (pos[:, joint] < high + reach)).all(-1)
    if not near.any():
        return 0.0
    points = pos[near, joint, None] + rot.rotate(quat[near, joint, None], samples)  # (T, S, 3)
    local = np.abs(rot.rotate(rot.conjugate(obj.box_quat), points[:, :, None] - obj.box_pos)) - obj.box_half
    distance = np.linalg.norm(np.maximum(local, 0.0), axis=-1) + np.minimum(local.max(-1), 0.0)
    return max(0.0, part.radius * scale - float(distance.min()))
