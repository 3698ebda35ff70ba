"""The angles of hips, knees and ankles over the stride, as gait laboratories draw them, from any clip."""

from dataclasses import dataclass

import numpy as np

from mimicbench.core.motion import HumanMotion
from mimicbench.references.body.angles import joint_angles
from mimicbench.references.body.body import body_of
from mimicbench.references.checks.gait_measures import straight_steps

ANGLES = ("hip_flexion", "knee_flexion", "ankle_plantarflexion")
SHARES = np.linspace(0.0, 1.0, 51)
"""Of the stride, from a heel strike to the next one of the same foot."""


@dataclass(frozen=True)
class Stride:
    """One stride of steady straight walking."""

    speed: float
    """[m/s]"""
    seconds: float
    """How long it takes."""
    curves: np.ndarray
    """(3, 51) ANGLES of the leg that begins it, at SHARES of the stride [rad]."""
    straighter: np.ndarray
    """(51,) flexion of the knee that is bent less, of the two [rad]."""


def strides(motion: HumanMotion) -> list[Stride]:
    """All strides of which both steps are steady and straight."""
    body = body_of(motion.skeleton)
    pos, quat = motion.forward_kinematics()
    angles = joint_angles(body, motion.local_quat)
    tracks = np.stack([angles[name] for name in ANGLES], 1)  # (T, 3, 2)
    steps = straight_steps(motion, body, pos, quat)
    found = []
    for first, second in zip(steps[:-1], steps[1:], strict=True):
        if first.end != second.start:
            continue
        frames = first.start + SHARES * (second.end - first.start)
        every = np.arange(motion.frames)
        leg = tracks[..., first.side]
        seconds = (second.end - first.start) / motion.fps
        gone = float(np.linalg.norm(motion.root_pos_w[second.end, :2] - motion.root_pos_w[first.start, :2]))
        curves = np.stack([np.interp(frames, every, leg[:, i]) for i in range(len(ANGLES))])
        straighter = np.interp(frames, every, tracks[:, 1].min(-1))
        found.append(Stride(gone / seconds, seconds, curves, straighter))
    return found
