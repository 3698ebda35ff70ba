"""Legs of skeletons whose hips move against the pelvis, made to fit ours, whose hips do not.

Some BVH files have a joint between pelvis and thigh, such as LHipJoint, that turns and so moves the hip by centimeters.
Our hip stays where it is on average; the leg bends and swings so that the ankle is where it was.
"""

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.skeleton import Skeleton, forward_kinematics
from mimicbench.references.body.body import Body, Limb


def reach_ankles(
    body: Body, skeleton: Skeleton, root_w: np.ndarray, local: np.ndarray, ankles_w: np.ndarray
) -> tuple[np.ndarray, float]:
    """Local rotations (T, J, 4) with which the ankles are at `ankles_w` (T, 2, 3) [m], left and right, or as near as
    the leg is long; and how far they are from there, 99 % of the time [m].

    Feet keep their orientations in the world.
    """
    local = local.copy()
    pos, quat = forward_kinematics(skeleton, root_w, local)
    for leg, target in zip(body.legs, ankles_w.swapaxes(0, 1), strict=True):
        thigh, shin = _bent(skeleton, leg, pos, quat, target)
        above = quat[:, skeleton.parents[leg.root]]
        local[:, leg.root] = rot.multiply(rot.conjugate(above), thigh)
        local[:, leg.middle] = rot.multiply(rot.conjugate(thigh), shin)
        local[:, leg.end] = rot.multiply(rot.conjugate(shin), quat[:, leg.end])
    reached = forward_kinematics(skeleton, root_w, local)[0][:, [leg.end for leg in body.legs]]
    return local, float(np.quantile(np.linalg.norm(reached - ankles_w, axis=-1).max(-1), 0.99))


def _bent(
    skeleton: Skeleton, leg: Limb, pos: np.ndarray, quat: np.ndarray, target: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """World orientations (T, 4) of thigh and shin: the knee bends in its own plane until hip and ankle are as far
    apart as they shall be, then the leg swings the shortest way.
    """
    hip, knee, ankle = (pos[:, joint] for joint in leg)
    upper, lower = knee - hip, ankle - knee
    a, b = (float(np.linalg.norm(skeleton.offsets[joint])) for joint in leg[1:])
    # where the leg is straight, the knee's axis is the thigh's own y
    axis = np.cross(upper, lower)
    sine = np.linalg.norm(axis, axis=-1, keepdims=True)
    own = rot.rotate(quat[:, leg.root], np.array([0.0, 1.0, 0.0]))
    axis = np.where(sine > 0.02 * a * b, axis / np.maximum(sine, 1e-12), own)
    far = np.clip(np.linalg.norm(target - hip, axis=-1), abs(a - b) + 1e-6, a + b - 1e-6)
    wanted = np.arccos(np.clip((far**2 - a**2 - b**2) / (2 * a * b), -1.0, 1.0))
    now = np.arccos(np.clip((upper * lower).sum(-1) / (a * b), -1.0, 1.0))
    bend = rot.from_rotvec(axis * (wanted - now)[:, None])
    swing = _shortest(upper + rot.rotate(bend, lower), target - hip)
    return rot.multiply(swing, quat[:, leg.root]), rot.multiply(swing, rot.multiply(bend, quat[:, leg.middle]))


def _shortest(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """(T, 4) the shortest rotations that take directions (T, 3) to others."""
    start, end = (v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-9) for v in (start, end))
    axis = np.cross(start, end)
    sine = np.linalg.norm(axis, axis=-1, keepdims=True)
    angle = np.arctan2(sine, (start * end).sum(-1, keepdims=True))
    return rot.from_rotvec(axis / np.maximum(sine, 1e-12) * angle)
