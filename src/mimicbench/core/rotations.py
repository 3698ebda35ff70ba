"""Rotations of NumPy arrays and torch tensors alike; quaternions are (..., 4), wxyz, unit.

A quaternion q_wb turns body coordinates into world coordinates: p_w = rotate(q_wb, p_b).
Every function broadcasts over leading dimensions and returns the type and precision it was given.
"""

import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

Array = Any  # np.ndarray or torch.Tensor, the same kind throughout a call

IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


def _xp(x: Array) -> Any:
    """The namespace that x belongs to. torch is looked up, never imported, so that NumPy users do not pay for it."""
    return sys.modules["torch"] if type(x).__module__.startswith("torch") else np


def cross(a: Array, b: Array) -> Array:
    """Cross product over the last axis; faster than the libraries' own on small batches."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return _xp(a).stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], -1)


def stack(arrays: Sequence[Array], axis: int = 0) -> Array:
    """Arrays of one kind stacked along a new axis."""
    return _xp(arrays[0]).stack(arrays, axis)


def multiply(a: Array, b: Array) -> Array:
    """Hamilton product a b: first b, then a."""
    aw, ax, ay, az = a[..., 0], a[..., 1], a[..., 2], a[..., 3]
    bw, bx, by, bz = b[..., 0], b[..., 1], b[..., 2], b[..., 3]
    return _xp(a).stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        -1,
    )


def conjugate(q: Array) -> Array:
    """The inverse rotation."""
    return _xp(q).concatenate([q[..., :1], -q[..., 1:]], -1)


def normalize(q: Array) -> Array:
    """The same rotation as a quaternion of unit length."""
    return q / ((q * q).sum(-1)[..., None]) ** 0.5


def rotate(q: Array, v: Array) -> Array:
    """Turn vectors v (..., 3) by q (..., 4)."""
    w, u = q[..., :1], q[..., 1:]
    t = 2.0 * cross(u, v)
    return v + w * t + cross(u, t)


def rotate_inverse(q: Array, v: Array) -> Array:
    """Turn vectors v (..., 3) by the inverse of q (..., 4)."""
    w, u = q[..., :1], q[..., 1:]
    t = 2.0 * cross(u, v)
    return v - w * t + cross(u, t)


def from_rotvec(r: Array) -> Array:
    """Exponential map of rotation vectors (..., 3) [rad]."""
    xp = _xp(r)
    half = 0.5 * ((r * r).sum(-1)[..., None]) ** 0.5
    # sin(h)/h by its series near zero, where the quotient loses its digits
    safe = xp.where(half < 1e-4, xp.ones_like(half), half)
    scale = xp.where(half < 1e-4, 0.5 - half * half / 12.0, 0.5 * xp.sin(safe) / safe)
    return xp.concatenate([xp.cos(half), scale * r], -1)


def to_rotvec(q: Array) -> Array:
    """Rotation vector (..., 3) [rad] of the shorter way, at most pi long."""
    xp = _xp(q)
    q = xp.where(q[..., :1] < 0, -q, q)
    sine = ((q[..., 1:] ** 2).sum(-1)[..., None]) ** 0.5
    angle = 2.0 * xp.arctan2(sine, q[..., :1])
    safe = xp.where(sine < 1e-7, xp.ones_like(sine), sine)
    scale = xp.where(sine < 1e-7, 2.0 * xp.ones_like(sine), angle / safe)
    return scale * q[..., 1:]


def angle_between(a: Array, b: Array) -> Array:
    """Geodesic distance (...) [rad] between two rotations, in [0, pi]."""
    return angle_of(multiply(conjugate(a), b))


def angle_of(q: Array) -> Array:
    """How far (...) [rad] a rotation turns, in [0, pi]."""
    return 2.0 * _xp(q).arctan2(((q[..., 1:] ** 2).sum(-1)) ** 0.5, abs(q[..., 0]))


def to_matrix(q: Array) -> Array:
    """Rotation matrices (..., 3, 3)."""
    w, x, y, z = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    rows = [
        1 - 2 * (y * y + z * z),
        2 * (x * y - w * z),
        2 * (x * z + w * y),
        2 * (x * y + w * z),
        1 - 2 * (x * x + z * z),
        2 * (y * z - w * x),
        2 * (x * z - w * y),
        2 * (y * z + w * x),
        1 - 2 * (x * x + y * y),
    ]
    return _xp(q).stack(rows, -1).reshape((*q.shape[:-1], 3, 3))


def from_matrix(m: Array) -> Array:
    """Quaternions of rotation matrices (..., 3, 3), with w >= 0; in double precision of NumPy arrays."""
    xp = _xp(m)
    m = np.asarray(m, dtype=float) if xp is np else m
    # The column of K with the largest eigenvalue bound is used, so no branch divides by a small number.
    xx, yy, zz = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    candidates = xp.stack(
        [
            xp.stack(
                [
                    1 + xx + yy + zz,
                    m[..., 2, 1] - m[..., 1, 2],
                    m[..., 0, 2] - m[..., 2, 0],
                    m[..., 1, 0] - m[..., 0, 1],
                ],
                -1,
            ),
            xp.stack(
                [
                    m[..., 2, 1] - m[..., 1, 2],
                    1 + xx - yy - zz,
                    m[..., 1, 0] + m[..., 0, 1],
                    m[..., 0, 2] + m[..., 2, 0],
                ],
                -1,
            ),
            xp.stack(
                [
                    m[..., 0, 2] - m[..., 2, 0],
                    m[..., 1, 0] + m[..., 0, 1],
                    1 - xx + yy - zz,
                    m[..., 2, 1] + m[..., 1, 2],
                ],
                -1,
            ),
            xp.stack(
                [
                    m[..., 1, 0] - m[..., 0, 1],
                    m[..., 0, 2] + m[..., 2, 0],
                    m[..., 2, 1] + m[..., 1, 2],
                    1 - xx - yy + zz,
                ],
                -1,
            ),
        ],
        -2,
    )
    best = xp.stack([candidates[..., i, i] for i in range(4)], -1).argmax(-1)[..., None, None]
    take = np.take_along_axis if xp is np else xp.take_along_dim
    q = normalize(take(candidates, best, -2)[..., 0, :])
    return xp.where(q[..., :1] < 0, -q, q)


def to_6d(q: Array) -> Array:
    """First two columns of the rotation matrix, (..., 6): continuous, for networks (Zhou et al. 2019)."""
    w, x, y, z = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    return _xp(q).stack(
        [
            1 - 2 * (y * y + z * z),
            2 * (x * y + w * z),
            2 * (x * z - w * y),
            2 * (x * y - w * z),
            1 - 2 * (x * x + z * z),
            2 * (y * z + w * x),
        ],
        -1,
    )


def from_6d(columns: Array) -> Array:
    """Quaternions, with w >= 0, of two columns (..., 6) that need not be quite orthonormal: the inverse of `to_6d`."""
    a = normalize(columns[..., :3])
    b = normalize(columns[..., 3:] - (a * columns[..., 3:]).sum(-1)[..., None] * a)
    return from_matrix(_xp(columns).stack([a, b, cross(a, b)], -1))


def from_yaw(yaw: Array) -> Array:
    """Turn about the vertical by yaw (...) [rad]."""
    xp = _xp(yaw)
    zero = xp.zeros_like(yaw)
    return xp.stack([xp.cos(0.5 * yaw), zero, zero, xp.sin(0.5 * yaw)], -1)


def yaw_of(q: Array) -> Array:
    """Heading (...) [rad]: the direction of the body's x axis seen from above."""
    w, x, y, z = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    return _xp(q).arctan2(2 * (x * y + w * z), 1 - 2 * (y * y + z * z))


def slerp(a: Array, b: Array, t: Array) -> Array:
    """Shortest-way interpolation from a (t=0) to b (t=1); t broadcasts over (...)."""
    return multiply(a, from_rotvec(to_rotvec(multiply(conjugate(a), b)) * t[..., None]))


def wrap_angle(angle: Array) -> Array:
    """The same angle in [-pi, pi)."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def angular_velocity(quat: np.ndarray, fps: float) -> np.ndarray:
    """World angular velocity (T, ..., 3) [rad/s] of quaternions (T, ..., 4) by central differences."""
    velocity = np.zeros((*quat.shape[:-1], 3))
    if len(quat) > 1:
        step = to_rotvec(multiply(quat[1:], conjugate(quat[:-1]))) * fps
        velocity[:-1] += step
        velocity[1:] += step
        velocity[1:-1] *= 0.5
    return velocity


def resample(values: np.ndarray, source_fps: float, target_fps: float) -> np.ndarray:
    """Linear resampling of (T, ...) over time; the first frame stays, the duration is kept to one frame."""
    times = resample_times(len(values), source_fps, target_fps)
    low = np.minimum(times.astype(int), len(values) - 1)
    high = np.minimum(low + 1, len(values) - 1)
    weight = (times - low).reshape(-1, *[1] * (values.ndim - 1))
    return values[low] * (1 - weight) + values[high] * weight


def resample_quat(quat: np.ndarray, source_fps: float, target_fps: float) -> np.ndarray:
    """As resample, for quaternions (T, ..., 4), along the shortest way."""
    times = resample_times(len(quat), source_fps, target_fps)
    low = np.minimum(times.astype(int), len(quat) - 1)
    high = np.minimum(low + 1, len(quat) - 1)
    weight = np.broadcast_to((times - low).reshape(-1, *[1] * (quat.ndim - 2)), (len(times), *quat.shape[1:-1]))
    return slerp(quat[low], quat[high], weight)


def resample_times(frames: int, source_fps: float, target_fps: float) -> np.ndarray:
    """Times, in source frames, of the frames of the resampled sequence."""
    count = max(1, round((frames - 1) * target_fps / source_fps) + 1)
    return np.minimum(np.arange(count) * (source_fps / target_fps), frames - 1)
