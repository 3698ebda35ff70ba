"""Contact labels from positions alone: a foot bears while its sole is low and still, other parts while they rest on
the object.
"""

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.motion import HumanMotion
from mimicbench.objects.shape import SceneObject
from mimicbench.references.body.body import Body, body_of

BEARING_NAMES = ("left_foot", "right_foot", "pelvis", "back", "left_hand", "right_hand")
LOW, STILL = 0.03, 0.25
"""A sole bears when its heel or toe is lower than LOW [m] and slower than STILL [m/s]."""
NEAR = 0.03
"""Skin nearer to the object than this [m], and moving with it, bears."""
RECLINED = 55.0
"""A trunk that leans farther than this [degrees] does not lean back against something, it lies down on it."""
SHORTEST = 0.1
"""[s]; shorter contacts and shorter gaps between contacts are noise."""


def detect_feet(motion: HumanMotion) -> np.ndarray:
    """(T, 2) whether the left and the right foot bear on the floor."""
    body = body_of(motion.skeleton)
    pos, quat = motion.forward_kinematics()
    return np.stack(
        [
            drop_short(_foot(motion, body, pos[:, leg.end], quat[:, leg.end]), _shortest(motion.fps))
            for leg in body.legs
        ],
        -1,
    )


def _shortest(fps: float) -> int:
    return max(1, round(SHORTEST * fps))


def sole_points(body: Body, pos: np.ndarray, quat: np.ndarray) -> np.ndarray:
    """(T, 2, 3) middle of the heel and of the toe, on the sole [m], from the ankle's pose (T, 3), (T, 4)."""
    ends = np.array([[body.heel, 0.0, -body.sole], [body.toe, 0.0, -body.sole]])
    return pos[:, None] + rot.rotate(quat[:, None], ends)


def drop_short(label: np.ndarray, shortest: int) -> np.ndarray:
    """(T,) the label with gaps, then runs, of less than `shortest` frames removed, except those at the ends."""
    label = label.copy()
    for value in (False, True):
        edges = np.flatnonzero(np.diff(label)) + 1
        for start, end in zip(edges[:-1], edges[1:], strict=True):
            if label[start] == value and end - start < shortest:
                label[start:end] = not value
    return label


def _foot(motion: HumanMotion, body: Body, pos: np.ndarray, quat: np.ndarray) -> np.ndarray:
    """(T,) whether a foot bears on the floor, from its ankle's pose."""
    ends = sole_points(body, pos, quat)
    speed = np.linalg.norm(np.gradient(ends, 1 / motion.fps, axis=0), axis=-1)
    return ((ends[..., 2] < LOW) & (speed < STILL)).any(-1)


def detect_bearing(motion: HumanMotion, obj: SceneObject) -> np.ndarray:
    """(T, 6) which of BEARING_NAMES bears on the floor or on the object, which is at the origin or where the clip
    says.
    """
    body = body_of(motion.skeleton)
    pos, quat = motion.forward_kinematics()
    feet = detect_feet(motion)
    for side, leg in enumerate(body.legs):
        feet[:, side] |= _rests(motion, obj, sole_points(body, pos[:, leg.end], quat[:, leg.end]), np.zeros(2))
    labels = [
        feet[:, 0],
        feet[:, 1],
        _part_rests(motion, obj, body, pos, quat, "pelvis"),
        _back_rests(motion, obj, body, pos, quat),
    ]
    for arm in body.arms:
        palm = pos[:, arm.end] + rot.rotate(quat[:, arm.end], np.array([0.0, 0.0, -body.hand]))
        labels.append(_rests(motion, obj, np.stack([pos[:, arm.end], palm], 1), np.full(2, 0.04)))
    return np.stack([drop_short(label, _shortest(motion.fps)) for label in labels], -1)


def _part_rests(
    motion: HumanMotion,
    obj: SceneObject,
    body: Body,
    pos: np.ndarray,
    quat: np.ndarray,
    role: str,
    along: tuple[float, ...] = (0.0, 0.5, 1.0),
) -> np.ndarray:
    """(T,) whether the body part of a role rests on the object, at any of the shares `along` its axis."""
    part = next(part for part in body.parts if part.role == role)
    samples = np.array(part.start) + np.outer(along, np.subtract(part.end, part.start))
    points = pos[:, part.joint, None] + rot.rotate(quat[:, part.joint, None], samples)
    return _rests(motion, obj, points, np.full(len(along), part.radius))


def _back_rests(motion: HumanMotion, obj: SceneObject, body: Body, pos: np.ndarray, quat: np.ndarray) -> np.ndarray:
    """(T,) whether the back rests on the object: of who sits any part of it, of who lies down its upper end.

    Who is propped up on the elbows touches a bed with the loins only, and lies on pelvis and arms.
    """
    trunk = pos[:, [arm.root for arm in body.arms]].mean(1) - pos[:, [leg.root for leg in body.legs]].mean(1)
    reclined = trunk[:, 2] < np.cos(np.radians(RECLINED)) * np.linalg.norm(trunk, axis=-1)
    shoulders = _part_rests(motion, obj, body, pos, quat, "trunk", (1.0,))
    return np.where(reclined, shoulders, _part_rests(motion, obj, body, pos, quat, "trunk"))


def _rests(motion: HumanMotion, obj: SceneObject, points: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """(T,) whether any of the spheres around points (T, P, 3) touches the object and hardly moves against it."""
    if len(motion.object_pos_w):
        points = rot.rotate_inverse(motion.object_quat_w[:, None], points - motion.object_pos_w[:, None])
    slow = np.linalg.norm(np.gradient(points, 1 / motion.fps, axis=0), axis=-1) < STILL
    return np.asarray((slow & (obj.distance(points) - radii < NEAR)).any(-1))
