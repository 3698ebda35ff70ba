"""The angles that anatomists and gait laboratories speak of, from the local rotations of a body's joints."""

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.references.body.body import Body, Limb

Range = tuple[float, float]
"""Least and most [rad]."""


def joint_angles(body: Body, local_quat: np.ndarray) -> dict[str, np.ndarray]:
    """Angles (T, 2) of the limbs, left and right, and (T,) of spine and neck, from local rotations (T, J, 4) [rad].

    All are zero in the rest pose. Flexion bends forward, of the knee backward; abduction leads away from the body,
    rotation and inversion turn towards the other side's.
    """
    angles: dict[str, np.ndarray] = {}
    sides = np.array([1.0, -1.0])
    hips = local_quat[:, [leg.root for leg in body.legs]]
    angles["hip_flexion"], angles["hip_abduction"], angles["hip_rotation"] = _ball(hips, sides)
    knees = rot.to_rotvec(local_quat[:, [leg.middle for leg in body.legs]])
    angles["knee_flexion"], angles["knee_twist"] = knees[..., 1], np.linalg.norm(knees[..., [0, 2]], axis=-1)
    ankles = rot.to_rotvec(local_quat[:, [leg.end for leg in body.legs]])
    angles["ankle_plantarflexion"], angles["ankle_inversion"], angles["ankle_rotation"] = (
        ankles[..., 1],
        ankles[..., 0] * -sides,
        ankles[..., 2] * -sides,
    )
    elbows = rot.to_rotvec(local_quat[:, [arm.middle for arm in body.arms]])
    angles["elbow_flexion"], angles["elbow_twist"] = -elbows[..., 1], np.linalg.norm(elbows[..., [0, 2]], axis=-1)
    upper = local_quat[:, [_chest_to(body, arm)[-1] for arm in body.arms]]
    angles["shoulder_extension"] = np.arcsin(np.clip(-rot.rotate(upper, np.array([0.0, 0.0, -1.0]))[..., 0], -1, 1))
    for name, joints in (("spine", body.spine), ("neck", body.neck)):
        turn = rot.to_rotvec(_chain(local_quat, joints))
        angles[f"{name}_flexion"], angles[f"{name}_bend"], angles[f"{name}_rotation"] = (
            turn[..., 1],
            turn[..., 0],
            turn[..., 2],
        )
    return angles


def _ball(quat: np.ndarray, sides: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Flexion, abduction and rotation of limbs (..., 2, 4) that hang along -z in the rest pose."""
    x, y, z = np.moveaxis(rot.rotate(quat, np.array([0.0, 0.0, -1.0])), -1, 0)
    # what is left of the turn once the limb has been swung where it points is the turn about its own axis
    twist = 2 * np.arctan2(quat[..., 3], quat[..., 0])
    return np.arctan2(x, -z), np.arcsin(np.clip(y * sides, -1, 1)), -rot.wrap_angle(twist) * sides


def _chest_to(body: Body, arm: Limb) -> tuple[int, ...]:
    """Joints from below the chest to the shoulder."""
    joints = [arm.root]
    while body.skeleton.parents[joints[0]] != body.chest and body.skeleton.parents[joints[0]] >= 0:
        joints.insert(0, body.skeleton.parents[joints[0]])
    return tuple(joints)


def _chain(local_quat: np.ndarray, joints: tuple[int, ...]) -> np.ndarray:
    """(T, 4) the rotations of some joints, one after the other."""
    turn = local_quat[:, joints[0]]
    for joint in joints[1:]:
        turn = rot.multiply(turn, local_quat[:, joint])
    return turn
