"""Smooth curves over time."""

import numpy as np


def minimum_jerk(u: np.ndarray) -> np.ndarray:
    """10 u^3 - 15 u^4 + 6 u^5 for u in [0, 1], constant outside: from 0 to 1 with rest at both ends."""
    u = np.clip(u, 0.0, 1.0)
    return u**3 * (10 - 15 * u + 6 * u**2)


def smooth(values: np.ndarray, half_width: int) -> np.ndarray:
    """Hann-weighted moving average over 2 half_width + 1 frames of (T, ...); the ends are held."""
    kernel = np.hanning(2 * half_width + 3)[1:-1]
    padded = np.concatenate([np.repeat(values[:1], half_width, 0), values, np.repeat(values[-1:], half_width, 0)])
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * half_width + 1, 0)
    return windows @ (kernel / kernel.sum())


def smooth_below(limit: np.ndarray, half_width: int) -> np.ndarray:
    """A smooth curve (T,) that is nowhere above `limit` (T,): the moving minimum, then the moving average of equal
    width.
    """
    padded = np.pad(limit, half_width, mode="edge")
    lowest = np.lib.stride_tricks.sliding_window_view(padded, 2 * half_width + 1).min(-1)
    return smooth(lowest, half_width)


def smooth_above(least: np.ndarray, half_width: int) -> np.ndarray:
    """A smooth curve (T,) that is nowhere below `least` (T,)."""
    return -smooth_below(-least, half_width)
