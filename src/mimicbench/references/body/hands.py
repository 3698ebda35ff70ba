"""Where hands lie: out of the own legs and trunk, and flat on what is below them."""

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.skeleton import forward_kinematics
from mimicbench.references.actions.reaching import WRIST, wrists_of
from mimicbench.references.body.body import Body
from mimicbench.references.body.posing import Arms, Legs, Trunk, pose, reach
from mimicbench.references.checks.penetration import ARM, own_gaps
from mimicbench.references.curves import smooth

OFF = ("pelvis", "trunk", "thigh", "shin")
"""What hands are pushed out of."""
MARGIN = 0.004
"""So far off the own body the hands are pushed [m]."""
HALF_WIDTH = 5
"""Frames to either side over which pushes are smoothed."""


def keep_off(body: Body, trunk: Trunk, legs: Legs, arms: Arms, share: np.ndarray | float = 1.0) -> Arms:
    """Arms whose wrists are pushed out of the own trunk and legs, by a share (T, 2), or as far as that goes smoothly.

    Elbows stay on their side.
    """
    share = np.broadcast_to(share, arms.upper.shape[:2])[..., None]
    for _ in range(3):
        pos, quat = forward_kinematics(body.skeleton, trunk.pelvis_pos_w, pose(body, trunk, legs, arms))
        deep, out = own_gaps(body, pos, quat, OFF, ARM)
        if deep.max() < 0:
            break
        frames, sides = deep.shape[:2]
        flat = deep.reshape(frames, sides, -1)
        deepest = flat.argmax(-1)[..., None]
        way = np.take_along_axis(out.reshape(frames, sides, -1, 3), deepest[..., None], 2)[:, :, 0]
        push = 1.3 * share * np.maximum(np.take_along_axis(flat, deepest, -1) + MARGIN, 0.0) * way
        axis = rot.rotate(rot.multiply(trunk.chest_quat_w[:, None], arms.upper), np.array([0.0, 1.0, 0.0]))
        arms = reach(
            body,
            trunk,
            wrists_of(body, trunk, arms) + smooth(push.reshape(frames, -1), HALF_WIDTH).reshape(push.shape),
            axis,
        )
    return arms


def lay_on_body(body: Body, trunk: Trunk, quat: np.ndarray) -> np.ndarray:
    """Local rotations (T, J, 4) with wrists that bend as far as palm and fingers would otherwise be in a thigh."""
    quat = quat.copy()
    pos, world = forward_kinematics(body.skeleton, trunk.pelvis_pos_w, quat)
    deep, out = own_gaps(body, pos, world, ("thigh",), ("fingers",))
    for side, arm in enumerate(body.arms):
        nearest = deep[:, side, :, 0].argmax(-1)
        frame = np.arange(len(nearest))
        angle = np.clip(np.maximum(deep[frame, side, nearest, 0], 0.0) / (1.4 * body.hand), 0.0, WRIST)
        normal = rot.rotate_inverse(world[:, arm.end], out[frame, side, nearest, 0])
        axis = np.cross([0.0, 0.0, -1.0], normal)
        length = np.maximum(np.linalg.norm(axis, axis=-1), 0.2)
        turn = smooth((angle / length)[:, None] * axis, HALF_WIDTH)
        quat[:, arm.end] = rot.multiply(quat[:, arm.end], rot.from_rotvec(turn))
    return quat


def point_hands(body: Body, trunk: Trunk, quat: np.ndarray, fingers_w: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Local rotations (T, J, 4) with wrists that bend with share (T, 2) until the fingers point along (T, 2, 3) or
    (2, 3), as far as wrists bend.
    """
    quat = quat.copy()
    fingers_w = np.broadcast_to(fingers_w, (len(quat), 2, 3))
    for side, arm in enumerate(body.arms):
        forearm = rot.multiply(rot.multiply(trunk.chest_quat_w, quat[:, arm.root]), quat[:, arm.middle])
        wanted = rot.rotate_inverse(forearm, fingers_w[:, side])
        axis = np.cross([0.0, 0.0, -1.0], wanted)
        sine = np.linalg.norm(axis, axis=-1)
        angle = np.minimum(np.arctan2(sine, -wanted[:, 2]), WRIST)
        quat[:, arm.end] = rot.from_rotvec((share[:, side] * angle / np.maximum(sine, 1e-6))[:, None] * axis)
    return quat
