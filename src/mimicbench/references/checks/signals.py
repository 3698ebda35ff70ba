"""What a person does over time in numbers that do not tell whose skeleton it is: joint angles from positions, lengths
in legs and arms, one frame rate, one low pass.
"""

from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, sosfiltfilt

from mimicbench.core import rotations as rot
from mimicbench.core.motion import HumanMotion
from mimicbench.core.skeleton import forward_kinematics
from mimicbench.references.body.body import Body, body_of
from mimicbench.references.checks.contacts import sole_points

RATE = 30.0
"""Frames per second of all signals."""
CUTOFF = 6.0
"""[Hz] What is faster is noise of the recording, or of the filter that took it away."""
LEG, ARM = 0.83, 0.53
"""Lengths [m] of hip to ankle and shoulder to wrist that speeds and places are scaled to; so high are the hips of who
stands over the ankles."""
LOW, STILL = 0.08, 0.3
"""A foot bears while its heel or toes are lower than LOW [m], as high as a recording's floor may be off, and slower
than STILL [m/s]."""
WRISTS = (8, 11)
"""Of Signals.pose."""
FORWARD, _, UP = np.eye(3)


@dataclass(frozen=True)
class Signals:
    """One clip or recording at RATE. Angles in degrees, lengths in meters of a body of standard size."""

    name: str
    pairs: dict[str, np.ndarray]
    """(T, 2) of left and right limbs. Flexion bends forward, of the knee backward; out leads away from the body."""
    single: dict[str, np.ndarray]
    """(T,) of trunk and pelvis."""
    feet: np.ndarray
    """(T, 2) whether they bear."""
    pose: np.ndarray
    """(T, 13, 3) left leg, right leg, left arm, right arm, each outward, and head, seen from where the pelvis is
    and faces [m]."""
    carried: np.ndarray
    """(T,) how much higher an object is than at first [m]; 0 without one."""

    @property
    def frames(self) -> int:
        """T."""
        return len(self.feet)


def signals_of(motion: HumanMotion) -> Signals:
    """The signals of a motion on any skeleton."""
    body = body_of(motion.skeleton)
    pos, quat = (_filtered(motion, values) for values in motion.forward_kinematics())
    quat = rot.normalize(quat)
    legs, arms = np.array(body.legs), np.array(body.arms)
    leg = LEG / sum(body.length(body.legs[0]))
    arm = ARM / sum(body.length(body.arms[0]))
    hips, shoulders = pos[:, legs[:, 0]], pos[:, arms[:, 0]]
    trunk = _trunk_frame(body, hips, shoulders)
    middle, chest = hips.mean(1), shoulders.mean(1)
    heading = _heading(trunk, hips)
    thigh, shin = _inside(trunk, pos[:, legs[:, 1]] - hips), _inside(trunk, pos[:, legs[:, 2]] - pos[:, legs[:, 1]])
    upper = _inside(trunk, pos[:, arms[:, 1]] - shoulders)
    lower = _inside(trunk, pos[:, arms[:, 2]] - pos[:, arms[:, 1]])
    wrist = _inside(trunk, pos[:, arms[:, 2]] - chest[:, None]) * arm
    sides = np.array([1.0, -1.0])
    along = _from_yaw(heading, pos[:, legs[:, 2]] - middle[:, None]) * leg
    toes = rot.rotate(quat[:, legs[:, 2]], FORWARD)
    pairs = {
        "hip flexion": np.degrees(np.arctan2(thigh[..., 0], -thigh[..., 2])),
        "hip out": np.degrees(np.arcsin(np.clip(_unit(thigh)[..., 1] * sides, -1, 1))),
        "knee flexion": _between(thigh, shin),
        "foot pitch": np.degrees(np.arcsin(np.clip(toes[..., 2], -1, 1))),
        "ankle flexion": _between(shin, _inside(trunk, toes)) - 90,
        "ankle forward": along[..., 0],
        "ankle out": along[..., 1] * sides,
        "ankle speed": np.linalg.norm(_rate(pos[:, legs[:, 2]]), axis=-1) * leg,
        "upper arm flexion": np.degrees(np.arctan2(upper[..., 0], -upper[..., 2])),
        "upper arm out": np.degrees(np.arcsin(np.clip(_unit(upper)[..., 1] * sides, -1, 1))),
        "elbow flexion": _between(upper, lower),
        "hand forward": wrist[..., 0],
        "hand out": wrist[..., 1] * sides,
        "hand up": wrist[..., 2],
    }
    speed = _from_yaw(heading, _rate(middle)) * leg
    head = _inside(trunk, rot.rotate(quat[:, body.head], FORWARD))
    single = {
        "pelvis height": (middle[:, 2] - body.sole) * leg,
        "speed forward": speed[:, 0],
        "speed sideways": speed[:, 1],
        "speed up": speed[:, 2],
        "turning": np.degrees(_rate(np.unwrap(heading))),
        "trunk pitch": np.degrees(np.arcsin(np.clip(-trunk[:, 0, 2], -1, 1))),
        "trunk roll": np.degrees(np.arcsin(np.clip(trunk[:, 1, 2], -1, 1))),
        "trunk tilt": np.degrees(np.arccos(np.clip(trunk[:, 2, 2], -1, 1))),
        "shoulders against hips": np.degrees(_twist(trunk, hips)),
        "head turn": np.degrees(np.arctan2(head[:, 1], head[:, 0])),
        "head nod": np.degrees(np.arcsin(np.clip(-head[:, 2], -1, 1))),
    }
    joints = np.concatenate([pos[:, legs.ravel()], pos[:, arms.ravel()], pos[:, [body.head]]], 1)
    feet = np.stack([_bears(sole_points(body, pos[:, end], quat[:, end])) for end in legs[:, 2]], -1)
    return Signals(
        motion.id, pairs, single, feet, _from_yaw(heading, joints - middle[:, None]) * leg, _carried(motion, len(pos))
    )


def _filtered(motion: HumanMotion, values: np.ndarray) -> np.ndarray:
    """Values (T, ...) below CUTOFF, at RATE; quaternions must not change sign from frame to frame."""
    if values.shape[-1] == 4:
        flips = np.where((values[1:] * values[:-1]).sum(-1) < 0, -1.0, 1.0)
        values = values * np.concatenate([np.ones_like(flips[:1]), np.cumprod(flips, 0)])[..., None]
    if motion.fps > 2 * CUTOFF:
        sos = butter(2, CUTOFF, fs=motion.fps, output="sos")
        values = sosfiltfilt(sos, values, axis=0, padlen=min(len(values) - 1, round(0.5 * motion.fps)))
    return rot.resample(values, motion.fps, RATE)


def _nearest(motion: HumanMotion, frames: int) -> np.ndarray:
    """(frames,) the frame of the motion that is nearest to each frame at RATE."""
    return np.minimum(np.round(np.arange(frames) * motion.fps / RATE).astype(int), motion.frames - 1)


def _bears(ends: np.ndarray) -> np.ndarray:
    """(T,) whether a foot bears, from its heel and toes (T, 2, 3)."""
    return ((ends[..., 2] < LOW) & (np.linalg.norm(_rate(ends), axis=-1) < STILL)).any(-1)


def _carried(motion: HumanMotion, frames: int) -> np.ndarray:
    if not len(motion.object_pos_w):
        return np.zeros(frames)
    height = motion.object_pos_w[_nearest(motion, frames), 2]
    return height - height[0]


def _trunk_frame(body: Body, hips: np.ndarray, shoulders: np.ndarray) -> np.ndarray:
    """(T, 3, 3) the trunk's directions forward, left and up in the world: the world's own in the rest pose.

    From the middles of hips and shoulders and the line from shoulder to shoulder; how a skeleton's shoulders stand over
    its hips at rest is taken out.
    """
    rest, _ = forward_kinematics(
        body.skeleton, np.zeros((1, 3)), np.tile(rot.IDENTITY, (1, len(body.skeleton.joint_names), 1))
    )
    upright = rest[0, [limb.root for limb in body.arms]].mean(0) - rest[0, [limb.root for limb in body.legs]].mean(0)
    tilt = float(np.arctan2(upright[0], upright[2]))
    up = _unit(shoulders.mean(1) - hips.mean(1))
    left = shoulders[:, 0] - shoulders[:, 1]
    left = _unit(left - (left * up).sum(-1, keepdims=True) * up)
    forward = np.cross(left, up)
    return np.stack([np.cos(tilt) * forward + np.sin(tilt) * up, left, np.cos(tilt) * up - np.sin(tilt) * forward], 1)


def _heading(trunk: np.ndarray, hips: np.ndarray) -> np.ndarray:
    """(T,) where the pelvis faces [rad]; of who lies, where the feet are.

    The line from hip to hip tells it, unless somebody lies on the side.
    """
    left = _unit(hips[:, 0] - hips[:, 1])
    facing = np.cross(left, UP) - left[:, 2:] ** 2 * trunk[:, 2]
    return np.arctan2(facing[:, 1], facing[:, 0])


def _twist(trunk: np.ndarray, hips: np.ndarray) -> np.ndarray:
    """(T,) how far the shoulders are turned against the hips about the trunk [rad]."""
    line = _inside(trunk, hips[:, 0] - hips[:, 1])
    return np.arctan2(line[:, 0], line[:, 1])


def _inside(frame: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Vectors (T, ..., 3) in frames (T, 3, 3) whose rows are the axes."""
    return np.einsum("tij,t...j->t...i", frame, vectors)


def _from_yaw(yaw: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Vectors (T, ..., 3) seen by who faces yaw (T,)."""
    turn = rot.from_yaw(-yaw)
    return rot.rotate(turn.reshape(len(yaw), *[1] * (vectors.ndim - 2), 4), vectors)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9)


def _between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angles (...) between vectors (..., 3) [degrees]."""
    return np.degrees(np.arccos(np.clip((_unit(a) * _unit(b)).sum(-1), -1, 1)))


def _rate(values: np.ndarray) -> np.ndarray:
    return np.gradient(values, 1 / RATE, axis=0)
