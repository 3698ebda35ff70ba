"""Which way a person's trunk leans, and which way a robot's: what a seated or lying clip must keep."""

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.motion import HumanMotion
from mimicbench.core.skeleton import forward_kinematics
from mimicbench.objects.shape import SceneObject
from mimicbench.references.body.body import body_of
from mimicbench.retarget.samples import Scene

NEAR = 0.03
"""[m] A head nearer to the object than this rests on it."""


TRUNK = ("pelvis", "back")
"""Contacts of who sits or lies."""

LEVEL = 1.0
"""[rad] Who rests with the trunk tilted by more lies; of 96 who sit down nobody is tilted by more than 0.85."""

ON_SIDE = 0.6
"""Sine of the angle from which on a line through the shoulders is that of who lies on the side."""


def bears(motion: HumanMotion, name: str) -> np.ndarray:
    """(T,) a contact label, false where the clip has none."""
    if name not in motion.contact_names:
        return np.zeros(motion.frames, bool)
    return motion.contacts[:, motion.contact_names.index(name)].astype(bool)


def trunk_rests(motion: HumanMotion) -> np.ndarray:
    """(T,) whether somebody sits or lies."""
    return np.any([bears(motion, name) for name in TRUNK], 0)


def trunk_up(motion: HumanMotion) -> np.ndarray:
    """(T, 3) unit vectors along a person's trunk, from hips to shoulders: straight up in the rest pose."""
    body = body_of(motion.skeleton)
    hips, shoulders = [leg.root for leg in body.legs], [arm.root for arm in body.arms]
    pos, _ = motion.forward_kinematics()
    upright, _ = forward_kinematics(
        body.skeleton, np.zeros((1, 3)), np.tile(rot.IDENTITY, (1, len(body.skeleton.joint_names), 1))
    )
    offset = upright[0, shoulders].mean(0) - upright[0, hips].mean(0)
    tilt = float(np.arctan2(offset[0], offset[2]))
    up = pos[:, shoulders].mean(1) - pos[:, hips].mean(1)
    up /= np.linalg.norm(up, axis=-1, keepdims=True)
    left = pos[:, shoulders[0]] - pos[:, shoulders[1]]
    forward = np.cross(left, up)
    forward /= np.maximum(np.linalg.norm(forward, axis=-1, keepdims=True), 1e-6)
    # how a skeleton's shoulders stand in front of or behind its hips is no lean
    return np.cos(tilt) * up - np.sin(tilt) * forward


def ends_lying(motion: HumanMotion) -> bool:
    """Whether somebody lies in the end."""
    return bool(trunk_rests(motion)[-1] and trunk_up(motion)[-1, 2] < np.cos(LEVEL))


def swung(quat: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Orientations (T, 4) turned by the least angle that brings their z axes to directions (T, 3)."""
    now = rot.rotate(quat, np.array([0.0, 0.0, 1.0]))
    turn = np.concatenate([1.0 + (now * up).sum(-1, keepdims=True), np.cross(now, up)], -1)
    return rot.multiply(rot.normalize(turn), quat)


def head_rests(motion: HumanMotion, obj: SceneObject) -> np.ndarray:
    """(T,) whether a person's head rests on the object, but for who lies on the side: a robot's shoulders are too wide
    for a head without a neck to get down beside them.
    """
    body = body_of(motion.skeleton)
    pos, quat = motion.forward_kinematics()
    across = pos[:, body.arms[0].root] - pos[:, body.arms[1].root]
    on_side = np.abs(across[:, 2]) > ON_SIDE * np.linalg.norm(across, axis=-1)
    head = next(part for part in body.parts if part.role == "head")
    middle = pos[:, head.joint] + rot.rotate(quat[:, head.joint], 0.5 * (np.array(head.start) + np.array(head.end)))
    distance, _ = Scene.of(motion, obj).object_distance(np.arange(motion.frames), middle)
    return (distance - head.radius < NEAR) & ~on_side
