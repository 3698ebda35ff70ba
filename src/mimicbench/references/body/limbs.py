"""Closed-form inverse kinematics of arms and legs: a ball joint, a hinge about y, and a ball joint."""

import numpy as np

from mimicbench.core import rotations as rot


def glide(u: np.ndarray, start: float, end: float) -> np.ndarray:
    """From 0 to 1 for u in [0, 1], constant outside: speed grows over a share `start` of the time, stays, and is
    lost over a share `end`.
    """
    u = np.clip(u, 0.0, 1.0)
    first, last = np.minimum(u / start, 1.0), np.minimum((1.0 - u) / end, 1.0)
    gathered = start * (first**3 - first**4 / 2) + np.maximum(u - start, 0.0)  # both ramps of speed are 3 x^2 - 2 x^3
    lost = np.maximum(u - 1.0 + end, 0.0) - end * (0.5 - last**3 + last**4 / 2)
    return (gathered - lost) / (1.0 - 0.5 * (start + end))


def about_x(angle: np.ndarray) -> np.ndarray:
    """Quaternions (..., 4) that turn about x by angle (...) [rad]."""
    zero = np.zeros_like(angle)
    return np.stack([np.cos(0.5 * angle), np.sin(0.5 * angle), zero, zero], -1)


def about_y(angle: np.ndarray) -> np.ndarray:
    """Quaternions (..., 4) that turn about y by angle (...) [rad].

    Positive bends forward, or a hanging limb backward.
    """
    zero = np.zeros_like(angle)
    return np.stack([np.cos(0.5 * angle), zero, np.sin(0.5 * angle), zero], -1)


def two_link(
    root_w: np.ndarray, end_w: np.ndarray, side_w: np.ndarray, upper: float, lower: float, backward: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Orientations of the two links of a limb that hangs along -z in its rest pose, so that its end is at `end_w`.

    Args:
        root_w: (T, 3) hip or shoulder [m].
        end_w: (T, 3) ankle or wrist [m]. What is out of reach is pulled to just within it.
        side_w: (T, 3) where the hinge's y axis should point; it is made perpendicular to the limb.
        upper: Length of the upper link [m].
        lower: Length of the lower link [m].
        backward: Whether the lower link bends backward (knee) or forward (elbow).

    Returns:
        World orientations (T, 4) of the upper and of the lower link, and the hinge's angle (T,) about y [rad].
    """
    delta = end_w - root_w
    length = np.linalg.norm(delta, axis=-1)
    down = delta / length[..., None]
    length = np.clip(length, abs(upper - lower) + 1e-6, (upper + lower) * (1 - 1e-9))
    y = side_w - (side_w * down).sum(-1, keepdims=True) * down
    y = y / np.linalg.norm(y, axis=-1, keepdims=True)
    plane = rot.from_matrix(np.stack([np.cross(y, -down), y, -down], -1))
    # the law of cosines gives the angle at the root and the hinge's own
    at_root = np.arccos(np.clip((upper**2 + length**2 - lower**2) / (2 * upper * length), -1, 1))
    hinge = np.pi - np.arccos(np.clip((upper**2 + lower**2 - length**2) / (2 * upper * lower), -1, 1))
    sign = 1.0 if backward else -1.0
    upper_quat = rot.multiply(plane, about_y(-sign * at_root))
    return upper_quat, rot.multiply(upper_quat, about_y(sign * hinge)), sign * hinge


def ease(
    values: np.ndarray,
    first: np.ndarray | float,
    rate: np.ndarray | float,
    fps: float,
    lasts: float,
    forward: bool = False,
) -> np.ndarray:
    """(T, ...) values that begin at `first` and change by `rate` per second there, and join the given ones after
    `lasts` seconds.

    What is between them fades with a quintic that ends without speed and acceleration. `forward` says that `rate` is
    the difference to the next frame; otherwise it is the derivative at the first one.
    """
    if len(values) < 3:
        return values
    u = np.clip(np.arange(len(values)) / (fps * lasts), 0.0, 1.0).reshape(-1, *[1] * (values.ndim - 1))
    own = values[1] - values[0] if forward else 2 * values[1] - 1.5 * values[0] - 0.5 * values[2]
    return values + (1 - u) ** 3 * (
        (1 + 3 * u + 6 * u**2) * (first - values[0]) + u * (1 + 3 * u) * lasts * (rate - own * fps)
    )
