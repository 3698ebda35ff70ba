"""The gate that every clip must pass, synthetic or imported: what can be wrong with it, measured, and how much of
that is too much.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.motion import HumanMotion
from mimicbench.objects.shape import SceneObject
from mimicbench.references.body.angles import Range, joint_angles
from mimicbench.references.body.body import Body, body_of
from mimicbench.references.checks.penetration import OWN, Depths, depths, own_depth

Fulfils = Callable[[HumanMotion, SceneObject], bool]
"""A task's K on a whole human motion (tasks.task.Task.fulfilled_by_human)."""
METRIC = "K"
"""What `gate` calls it when the task's K does not hold."""
HOLD = 1.0
"""For how long wrists have to stay at their targets [s] (appendix D.1, T)."""


@dataclass(frozen=True)
class Limits:
    """What a good clip keeps to. A pair is the least and the most, a single number the most."""

    skate: float = 0.01
    """Way that the point on which a foot stands slides during one stance [m]."""
    float_height: float = 0.03
    """Height of a foot over floor and object while it is labeled as standing [m]."""
    floor_depth: float = 0.005
    """Deepest that a sole may be in the floor [m]."""
    object_depth: float = 0.02
    """Deepest that a body part may be in hard parts of the object [m]: flesh gives."""
    soft_depth: float = 0.04
    """Deepest that it may be in mattresses and upholstery [m]."""
    own_depth: float = 0.02
    """Deepest that forearms and palms may be in the own head, trunk and shins, and forearms in the own thighs [m]."""
    lap_depth: float = 0.05
    """Deepest that palms may be in the own thighs, on which they rest at the end of straight wrists [m]."""
    joint_speed: float = 12.0
    """Fastest turn of a joint [rad/s]."""
    joint_acceleration: float = 180.0
    """[rad/s^2]"""
    root_acceleration: float = 6.0
    """[m/s^2]"""
    root_jerk: float = 120.0
    """[m/s^3]"""
    point_speed: float = 5.0
    """Fastest that any joint moves through the world [m/s]."""
    jump: float = 1.5
    """Largest change of any joint's velocity from one frame to the next [m/s]."""
    object_jump: float = 0.6
    """Largest change of the object's velocity from one frame to the next [m/s]."""
    reach: float = 0.05
    """Distance of the wrists from their targets during their best second [m]."""
    knee_flexion: Range = (-0.02, 2.60)
    """[rad], as all that follow. Ranges of joints are those of healthy adults, a few degrees wider."""
    knee_twist: Range = (-0.60, 0.60)
    hip_flexion: Range = (-0.60, 2.30)
    hip_abduction: Range = (-0.60, 1.00)
    hip_rotation: Range = (-1.00, 1.00)
    ankle_plantarflexion: Range = (-0.75, 1.05)
    """Negative while the toes are up."""
    ankle_inversion: Range = (-0.65, 0.65)
    ankle_rotation: Range = (-0.65, 0.65)
    elbow_flexion: Range = (-0.10, 2.70)
    elbow_twist: Range = (-1.70, 1.70)
    shoulder_extension: Range = (-np.pi / 2, 1.10)
    """How far the upper arm points backward."""
    spine_flexion: Range = (-0.70, 1.50)
    spine_bend: Range = (-0.70, 0.70)
    spine_rotation: Range = (-0.90, 0.90)
    neck_flexion: Range = (-1.20, 1.05)
    neck_bend: Range = (-0.80, 0.80)
    neck_rotation: Range = (-1.40, 1.40)


WORSE, BENT = 1.25, 0.1
"""A variant of a clip that is itself beyond a limit, as recordings are, may be so many times as far, or an angle so
much farther [rad]."""


def gate(
    motion: HumanMotion,
    obj: SceneObject,
    fulfils: Fulfils | None = None,
    limits: Limits | None = None,
    original: Mapping[str, float] | None = None,
) -> list[str]:
    """Names of all that is wrong with a clip on an object; empty if it is good.

    `fulfils` is the task's K for a human body, `original` what was measured of the clip that this is a variant of.
    """
    found = faults(check_clip(motion, obj), limits, original)
    return found if fulfils is None or fulfils(motion, obj) else [*found, METRIC]


def check_clip(motion: HumanMotion, obj: SceneObject) -> dict[str, float]:
    """What can be wrong with a clip on an object: worst values over all frames, in SI units.

    Keys are the fields of Limits.

    Of a range there are two, ending in `_least` and `_most`; the worst of both sides of the body counts.
    """
    body, fps = body_of(motion.skeleton), motion.fps
    pos, quat = motion.forward_kinematics()
    deep = depths(motion, obj, body, pos, quat)
    measures = (
        {"object_depth": deep.hard, "soft_depth": deep.soft, "seat_depth": deep.seat}
        | _own(body, pos, quat)
        | _feet(motion, obj, body, pos, quat, deep)
    )
    turn = rot.to_rotvec(rot.multiply(rot.conjugate(motion.local_quat[:-1]), motion.local_quat[1:])) * fps
    velocity = np.diff(pos, axis=0) * fps
    measures |= {
        "joint_speed": _most(turn),
        "joint_acceleration": _most(np.diff(turn, axis=0)) * fps,
        "root_acceleration": _most(np.diff(velocity[:, 0], axis=0)) * fps,
        "root_jerk": _most(np.diff(velocity[:, 0], 2, axis=0)) * fps**2,
        "point_speed": _most(velocity),
        "jump": _most(np.diff(velocity, axis=0)),
        "object_jump": _most(np.diff(motion.object_pos_w, 2, axis=0)) * fps if len(motion.object_pos_w) else 0.0,
        "reach": _reach(motion, pos[:, [arm.end for arm in body.arms]]),
    }
    for name, angle in joint_angles(body, motion.local_quat).items():
        measures[f"{name}_least"], measures[f"{name}_most"] = float(angle.min()), float(angle.max())
    return measures


def told(measures: dict[str, float], names: Sequence[str], limits: Limits | None = None) -> str:
    """What is wrong, for people: such as `skate 0.25 (0.01 at most), K`."""
    limits = limits or Limits()
    words = []
    for name in names:
        field, _, end = name.rpartition("_")
        if isinstance(limit := getattr(limits, field, None), tuple):
            bound = f"{limit[0]:.3g} at least" if end == "least" else f"{limit[1]:.3g} at most"
        elif (limit := getattr(limits, name, None)) is not None:
            bound = f"{limit:.3g} at most"
        else:
            words.append(name)
            continue
        words.append(f"{name} {measures[name]:.3g} ({bound})")
    return ", ".join(words)


def faults(
    measures: Mapping[str, float], limits: Limits | None = None, original: Mapping[str, float] | None = None
) -> list[str]:
    """Names of the measures that are beyond the limits, and worse than those of the `original`, if there is one."""
    limits = limits or Limits()
    found = []
    for name in (field.name for field in fields(Limits)):
        limit = getattr(limits, name)
        if isinstance(limit, tuple):
            low, high = limit
            if original is not None:
                low, high = min(low, original[f"{name}_least"] - BENT), max(high, original[f"{name}_most"] + BENT)
            found += [f"{name}_least"] if not measures[f"{name}_least"] >= low else []
            found += [f"{name}_most"] if not measures[f"{name}_most"] <= high else []
        elif not measures[name] <= (limit if original is None else max(limit, WORSE * original[name])):
            found.append(name)
    return found


def _own(body: Body, pos: np.ndarray, quat: np.ndarray) -> dict[str, float]:
    """How deep the arms are in the body itself [m]."""
    forearms, palms, lap = (
        max(0.0, float(own_depth(body, pos, quat, others, points).max()))
        for others, points in (
            (OWN, ["forearm"]),
            ([role for role in OWN if role != "thigh"], ["palm"]),
            (["thigh"], ["palm"]),
        )
    )
    return {"own_depth": max(forearms, palms), "lap_depth": lap}


def _most(vectors: np.ndarray) -> float:
    """Length of the longest of vectors (..., 3), 0 if there are none."""
    return float(np.sqrt((vectors**2).sum(-1).max(initial=0.0)))


def _feet(
    motion: HumanMotion, obj: SceneObject, body: Body, pos: np.ndarray, quat: np.ndarray, deep: Depths
) -> dict[str, float]:
    """How far standing feet slide, how high they float, and how deep any foot is in the floor [m]."""
    skate = height = 0.0
    lowest = np.inf
    for side, foot in enumerate(("left_foot", "right_foot")):
        points = bearing_points(body, pos, quat, side)
        bottom = points[..., 2].min(-1)
        lowest = min(lowest, float(bottom.min()))
        if foot not in motion.contact_names:
            continue
        stands = motion.contacts[:, motion.contact_names.index(foot)].astype(bool)
        skate = max(skate, float(stance_slides(points, stands).max(initial=0.0)))
        # feet may as well rest on furniture
        aloft = stands & (bottom > Limits.float_height)
        if aloft.any() and not deep.moving:
            above = obj.distance(pos[aloft, body.legs[side].end]) - body.sole
            height = max(height, float(np.minimum(bottom[aloft], above).max()))
        else:
            height = max(height, float(bottom[stands].max(initial=0.0)))
    return {"skate": skate, "float_height": height, "floor_depth": max(0.0, -lowest)}


def bearing_points(body: Body, pos: np.ndarray, quat: np.ndarray, side: int) -> np.ndarray:
    """(T, P, 3) points of one foot's sole [m] from the joints' poses (T, J, 3), (T, J, 4).

    They are both corners of the heel and of the toe end; where toes bend, those of the ball, and of the toes' end in
    the toes' own frame.
    """
    ankle, wide = body.legs[side].end, (body.foot_half_width, -body.foot_half_width)
    ends = [body.heel, body.toe] if body.toes is None else [body.heel, float(body.skeleton.offsets[body.toes[side], 0])]
    foot = np.array([[x, y, -body.sole] for x in ends for y in wide])
    points = pos[:, ankle, None] + rot.rotate(quat[:, ankle, None], foot)
    if body.toes is None:
        return points
    toe = body.toes[side]
    ball_x, _, ball_z = body.skeleton.offsets[toe]
    tip = np.array([[body.toe - ball_x, y, -body.sole - ball_z] for y in wide])
    return np.concatenate([points, pos[:, toe, None] + rot.rotate(quat[:, toe, None], tip)], 1)


def stance_slides(points: np.ndarray, stands: np.ndarray) -> np.ndarray:
    """(S,) how far a foot slides in each of its stances [m], from points of its sole (T, P, 3) and whether it stands
    (T,).

    What counts from one frame to the next is the stillest of the points that bear, which are those within 1 cm of the
    lowest: a foot
    that rolls over its heel or toes, or turns on one of them, does not slide.
    """
    moved = np.linalg.norm(np.diff(points, axis=0), axis=-1)
    low = points[..., 2] < points[..., 2].min(-1, keepdims=True) + 0.01
    moved[~(low[1:] & low[:-1])] = np.inf
    slip = moved.min(-1)
    # a foot that goes from one point to another without a common one slides with both
    slip = np.where(np.isfinite(slip), slip, np.linalg.norm(np.diff(points, axis=0), axis=-1).min(-1))
    both = stands[1:] & stands[:-1]
    starts = np.flatnonzero(both & ~np.concatenate([[False], both[:-1]]))
    return np.add.reduceat(np.where(both, slip, 0.0), starts) if len(starts) else np.zeros(0)


def _reach(motion: HumanMotion, wrists: np.ndarray) -> float:
    """Largest distance of the wrists (T, 2, 3) from their targets [m] during the best second; 0 without targets."""
    if not len(motion.wrist_goal_w):
        return 0.0
    away = np.nanmax(np.linalg.norm(wrists - motion.wrist_goal_w, axis=-1), axis=-1)
    window = min(len(away), max(1, round(HOLD * motion.fps)))
    return float(np.lib.stride_tricks.sliding_window_view(away, window).max(-1).min())
