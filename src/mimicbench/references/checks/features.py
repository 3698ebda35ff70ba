"""What a window of a clip looks like in numbers: means, ranges, speeds, accelerations, contacts, symmetry."""

import numpy as np

from mimicbench.references.checks.phases import WINDOW, window_starts
from mimicbench.references.checks.signals import RATE, Signals

OFFSET = ("foot pitch", "ankle flexion", "head nod", "pelvis height")
"""Signals whose mean tells how a skeleton is drawn at rest, or how high a seat is, rather than what somebody does."""
SIDED = ("speed sideways", "turning", "trunk roll", "shoulders against hips", "head turn")
"""Signals whose sign tells left from right."""
LEAST = 1e-3
"""Pairs that move less are neither alike nor unlike."""


def window_features(signals: Signals) -> tuple[tuple[str, ...], np.ndarray]:
    """Names (F,) and values (W, F) of all windows of a clip, blind to which side is left."""
    starts = window_starts(signals)
    frames = starts[:, None] + np.arange(WINDOW)
    found: dict[str, np.ndarray] = {}
    for name, values in signals.pairs.items():
        rate, change = _derivatives(values)
        window = values[frames]
        if name not in OFFSET:
            found[f"{name}, mean"] = window.mean((1, 2))
            found[f"{name}, left against right"] = np.abs(window[..., 0] - window[..., 1]).mean(1)
        found[f"{name}, deviation"] = window.std(1).mean(-1)
        found[f"{name}, rate"] = _rms(rate[frames]).mean(-1)
        found[f"{name}, change of rate"] = _rms(change[frames]).mean(-1)
        found[f"{name}, left with right"] = _together(window)
    for name, values in signals.single.items():
        rate, change = _derivatives(values)
        window = values[frames]
        if name not in OFFSET:
            found[f"{name}, mean"] = np.abs(window.mean(1)) if name in SIDED else window.mean(1)
        found[f"{name}, deviation"] = window.std(1)
        found[f"{name}, rate"] = _rms(rate[frames])
        found[f"{name}, change of rate"] = _rms(change[frames])
    feet = signals.feet[frames]
    found["both feet bear, share"] = feet.all(-1).mean(1)
    found["no foot bears, share"] = (~feet).all(-1).mean(1)
    slides = np.where(feet, signals.pairs["ankle speed"][frames], 0.0)
    found["speed of the ankles that bear"] = slides.sum((1, 2)) / np.maximum(feet.sum((1, 2)), 1)
    found["speed of all joints, least"] = _joint_speed(signals)[frames].min(1)
    found["speed of all joints, mean"] = _joint_speed(signals)[frames].mean(1)
    return tuple(found), np.stack(list(found.values()), -1)


def _joint_speed(signals: Signals) -> np.ndarray:
    """(T,) mean over the joints, against the pelvis [m/s]."""
    return np.linalg.norm(np.gradient(signals.pose, 1 / RATE, axis=0), axis=-1).mean(-1)


def _derivatives(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    rate = np.gradient(values, 1 / RATE, axis=0)
    return rate, np.gradient(rate, 1 / RATE, axis=0)


def _rms(values: np.ndarray) -> np.ndarray:
    return np.sqrt((values**2).mean(1))


def _together(window: np.ndarray) -> np.ndarray:
    """(W,) correlation of left and right (W, N, 2); 0 where one hardly moves."""
    away = window - window.mean(1, keepdims=True)
    scale = np.sqrt((away**2).mean(1)).prod(-1)
    return np.where(scale > LEAST, (away[..., 0] * away[..., 1]).mean(1) / np.maximum(scale, LEAST), 0.0)
