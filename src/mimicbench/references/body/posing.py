"""From what a body does to what its joints do: trunk, head, ankles and wrists in, local rotations of every joint
out, in closed form.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.references.body.body import Body
from mimicbench.references.body.limbs import about_y, two_link


@dataclass(frozen=True)
class Trunk:
    """Where the trunk is in T frames."""

    pelvis_pos_w: np.ndarray
    """(T, 3) [m]."""
    pelvis_quat_w: np.ndarray
    """(T, 4)."""
    chest_quat_w: np.ndarray
    """(T, 4); the joints of the spine share the difference to the pelvis."""
    head_quat_w: np.ndarray
    """(T, 4); the joints of the neck share the difference to the chest."""


@dataclass(frozen=True)
class Legs:
    """Where the feet are in T frames; axis 1 is left, right."""

    ankle_pos_w: np.ndarray
    """(T, 2, 3) [m]; what is out of reach is pulled to just within it."""
    foot_quat_w: np.ndarray
    """(T, 2, 4) of the foot, level on the floor at yaw 0 when it is the identity."""
    knee_axis_w: np.ndarray
    """(T, 2, 3) where the knee's y axis should point, to the body's left; only its part across the leg counts."""
    toe_bend: np.ndarray | None = None
    """(T, 2) how far the toes bend up [rad], for skeletons that have them."""


@dataclass(frozen=True)
class Arms:
    """Rotations of the arms in T frames; axis 1 is left, right. They may be blended with `rotations.slerp`."""

    upper: np.ndarray
    """(T, 2, 4) upper arm relative to the chest; the identity hangs."""
    elbow: np.ndarray
    """(T, 2, 4) forearm relative to the upper arm; negative about y bends it."""


def pose(body: Body, trunk: Trunk, legs: Legs, arms: Arms) -> np.ndarray:
    """Local rotations (T, J, 4) of all joints."""
    quat = np.tile(rot.IDENTITY, (len(trunk.pelvis_pos_w), len(body.skeleton.joint_names), 1))
    quat[:, body.pelvis] = trunk.pelvis_quat_w
    _share(quat, body.spine, rot.multiply(rot.conjugate(trunk.pelvis_quat_w), trunk.chest_quat_w))
    _share(quat, body.neck, rot.multiply(rot.conjugate(trunk.chest_quat_w), trunk.head_quat_w))
    for side, leg in enumerate(body.legs):
        hip = trunk.pelvis_pos_w + rot.rotate(trunk.pelvis_quat_w, body.skeleton.offsets[leg.root])
        thigh, shin, _ = two_link(hip, legs.ankle_pos_w[:, side], legs.knee_axis_w[:, side], *body.length(leg), True)
        quat[:, leg.root] = rot.multiply(rot.conjugate(trunk.pelvis_quat_w), thigh)
        quat[:, leg.middle] = rot.multiply(rot.conjugate(thigh), shin)
        quat[:, leg.end] = rot.multiply(rot.conjugate(shin), legs.foot_quat_w[:, side])
        if body.toes is not None and legs.toe_bend is not None:
            quat[:, body.toes[side]] = about_y(-legs.toe_bend[:, side])
    for side, arm in enumerate(body.arms):
        quat[:, arm.root], quat[:, arm.middle] = arms.upper[:, side], arms.elbow[:, side]
    return quat


def thigh_orientations(body: Body, trunk: Trunk, legs: Legs) -> np.ndarray:
    """(T, 2, 4) world orientations of both thighs."""
    thighs = []
    for side, leg in enumerate(body.legs):
        hip = trunk.pelvis_pos_w + rot.rotate(trunk.pelvis_quat_w, body.skeleton.offsets[leg.root])
        thighs.append(two_link(hip, legs.ankle_pos_w[:, side], legs.knee_axis_w[:, side], *body.length(leg), True)[0])
    return np.stack(thighs, 1)


def shoulders(body: Body, trunk: Trunk) -> np.ndarray:
    """(T, 2, 3) world positions of both shoulders [m]."""
    turn = rot.multiply(rot.conjugate(trunk.pelvis_quat_w), trunk.chest_quat_w)
    each, skeleton, places = rot.from_rotvec(rot.to_rotvec(turn) / len(body.spine)), body.skeleton, []
    for arm in body.arms:
        chain = [arm.root]
        while chain[0] != body.pelvis:
            chain.insert(0, skeleton.parents[chain[0]])
        pos, quat = trunk.pelvis_pos_w, trunk.pelvis_quat_w
        for joint in chain[1:]:
            pos = pos + rot.rotate(quat, skeleton.offsets[joint])
            quat = rot.multiply(quat, each) if joint in body.spine else quat
        places.append(pos)
    return np.stack(places, 1)


def reach(body: Body, trunk: Trunk, wrist_pos_w: np.ndarray, elbow_axis_w: np.ndarray) -> Arms:
    """Arms whose wrists are at (T, 2, 3) [m], as far as they reach.

    `elbow_axis_w` (T, 2, 3) is where each elbow's y axis should point: the body's left keeps the elbow below and behind
    a hand in front; leaning it up or down swings the elbow outward or inward.
    """
    upper, elbow = [], []
    roots = shoulders(body, trunk)
    for side, arm in enumerate(body.arms):
        over, under, _ = two_link(roots[:, side], wrist_pos_w[:, side], elbow_axis_w[:, side], *body.length(arm), False)
        upper.append(rot.multiply(rot.conjugate(trunk.chest_quat_w), over))
        elbow.append(rot.multiply(rot.conjugate(over), under))
    return Arms(np.stack(upper, 1), np.stack(elbow, 1))


def blend(first: Arms, second: Arms, share: np.ndarray) -> Arms:
    """From the first arms to the second as share (T,) or (T, 2) goes from 0 to 1."""
    share = np.broadcast_to(share[:, None] if share.ndim == 1 else share, first.upper.shape[:2])
    return Arms(rot.slerp(first.upper, second.upper, share), rot.slerp(first.elbow, second.elbow, share))


def _share(quat: np.ndarray, joints: Sequence[int], turn: np.ndarray) -> None:
    """Let some joints of (T, J, 4) make a turn (T, 4) together, each an equal part of it."""
    quat[:, list(joints)] = rot.from_rotvec(rot.to_rotvec(turn) / len(joints))[:, None]
