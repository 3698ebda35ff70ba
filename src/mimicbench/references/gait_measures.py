"""How people walk and sit down, in the figures of gait laboratories, measured on any clip: synthetic and real ones by the same rule.

Feet bear by `contacts.detect_feet`, from positions alone, so that labels cannot make a difference.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.motion import HumanMotion
from mimicbench.references.angles import joint_angles
from mimicbench.references.body import Body, body_of
from mimicbench.references.contacts import detect_feet
from mimicbench.references.limbs import smooth


@dataclass(frozen=True)
class GaitMeasures:
    """Means over one clip; NaN where it has none of it. Angles in degrees."""

    speed: float
    """Of the pelvis during steps of straight walking [m/s]."""
    cadence: float
    """[steps/min]"""
    step_length: float
    """From one ankle to the other at touch-down, along the way [m]."""
    step_width: float
    """And across it [m]."""
    double_support: float
    """Share of the time of walking with both feet on the floor."""
    hip_range: float
    """Flexion, most less least, while walking."""
    knee_range: float
    ankle_range: float
    pelvis_rise: float
    """The pelvis moves up and down by so much in a step [m]."""
    walking_lean: float
    """Mean forward pitch of the chest while walking."""
    sit_time: float
    """From 5 to 95 % of the pelvis's way down to a seat [s]."""
    sit_speed: float
    """Fastest that it sinks [m/s]."""
    sit_lean: float
    """Largest forward pitch of the chest on the way down."""
    sit_hip: float
    """Largest flexion of the hips on the way down."""
    seated_knee: float
    """Flexion of the knees at rest on the seat."""


STRAIGHT, FORWARD = 0.35, 0.15
"""A step is straight walking if the heading turns by less [rad], and the pelvis goes forward by more [m]."""


def measure_gait(motion: HumanMotion, heights: np.ndarray | None = None) -> GaitMeasures:
    """All figures of one clip. A sit-down is looked for unless `heights` (T,) of the pelvis is all that may be read as one."""
    body = body_of(motion.skeleton)
    pos, quat = motion.forward_kinematics()
    angles = {name: np.degrees(values) for name, values in joint_angles(body, motion.local_quat).items()}
    lean = np.degrees(np.arcsin(np.clip(_forward_lean(quat[:, body.chest], rot.yaw_of(quat[:, 0])), -1, 1)))
    found = dict.fromkeys((field.name for field in fields(GaitMeasures)), float("nan"))
    found |= _walking(motion, body, pos, quat, angles, lean)
    return GaitMeasures(**found | _sitting(motion.root_pos_w[:, 2] if heights is None else heights, motion.fps, body, angles, lean))


def summarize(measures: Iterable[GaitMeasures]) -> dict[str, tuple[float, float, int]]:
    """Per figure the mean, the deviation, and of how many clips."""
    rows = list(measures)
    summary = {}
    for name in (field.name for field in fields(GaitMeasures)):
        values = np.array([getattr(row, name) for row in rows], float)
        values = values[np.isfinite(values)]
        summary[name] = (float(values.mean()), float(values.std()), len(values)) if len(values) else (float("nan"), float("nan"), 0)
    return summary


def walking_model(speed: float, leg: float) -> Mapping[str, float]:
    """Cadence [steps/min], step length [m] and double support of people at some speed [m/s] with legs (hip to ankle) of some length [m].

    The normalized relations that Boulic, Magnenat-Thalmann and Thalmann (The Visual Computer 6, 1990) fitted to experiments.
    """
    relative = speed / leg
    cycle_length = 1.346 * np.sqrt(relative)
    cycle = cycle_length / relative
    return {"cadence": 120.0 / cycle, "step_length": 0.5 * cycle_length * leg, "double_support": 2 * (0.252 * cycle - 0.143) / cycle}


def _forward_lean(chest: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """Sine of the chest's pitch (T,) towards where the pelvis faces."""
    up = rot.rotate(chest, np.array([0.0, 0.0, 1.0]))
    return up[..., 0] * np.cos(yaw) + up[..., 1] * np.sin(yaw)


def _walking(motion: HumanMotion, body: Body, pos: np.ndarray, quat: np.ndarray, angles: dict[str, np.ndarray], lean: np.ndarray) -> dict[str, float]:
    bears, ankles, pelvis = detect_feet(motion), pos[:, [leg.end for leg in body.legs]], motion.root_pos_w
    facing = rot.yaw_of(quat[:, 0])
    strikes = sorted((int(frame) + 1, side) for side in (0, 1) for frame in np.flatnonzero(~bears[:-1, side] & bears[1:, side]))
    steps: list[dict[str, float]] = []
    walks = np.zeros(motion.frames, bool)
    for (start, first), (end, second) in zip(strikes[:-1], strikes[1:], strict=True):
        way = pelvis[end, :2] - pelvis[start, :2]
        gone = float(np.linalg.norm(way))
        straight = abs(rot.wrap_angle(facing[end] - facing[start])) < STRAIGHT
        if first == second or gone < FORWARD or not straight or not 0.2 < (end - start) / motion.fps < 1.2:
            continue
        along = way / gone
        if along @ np.array([np.cos(facing[start]), np.sin(facing[start])]) < 0.7:  # sideways, or backward
            continue
        between = ankles[end, second, :2] - ankles[end, first, :2]
        seconds = (end - start) / motion.fps
        height = pelvis[start : end + 1, 2]
        steps.append({
            "speed": gone / seconds, "cadence": 60 / seconds, "step_length": float(between @ along),
            "step_width": float(abs(between @ np.array([-along[1], along[0]]))), "double_support": float(bears[start:end].all(-1).mean()),
            "pelvis_rise": float(np.ptp(height - np.linspace(height[0], height[-1], len(height)))),
        })  # fmt: skip
        walks[start : end + 1] = True
    if len(steps) < 2:
        return {}
    found = {name: float(np.mean([step[name] for step in steps])) for name in steps[0]}
    # a mean over unequal steps is one of rates, not of times
    found["cadence"] = 60 / float(np.mean([60 / step["cadence"] for step in steps]))
    ranges = {name: float(np.ptp(angles[joint][walks], axis=0).mean()) for name, joint in _JOINTS.items()}
    return found | ranges | {"walking_lean": float(lean[walks].mean())}


_JOINTS = {"hip_range": "hip_flexion", "knee_range": "knee_flexion", "ankle_range": "ankle_plantarflexion"}


def _sitting(height: np.ndarray, fps: float, body: Body, angles: dict[str, np.ndarray], lean: np.ndarray) -> dict[str, float]:
    """The last time that the pelvis comes down to the height of a seat and stays."""
    height = smooth(height, max(1, round(0.07 * fps)))
    standing, rest = body.standing_height, float(np.median(height[-max(1, round(0.5 * fps)) :]))
    if not 0.4 * standing < rest < 0.78 * standing or height.max() < 0.9 * standing:
        return {}
    high = float(np.quantile(height[height > 0.85 * standing], 0.5))
    share = (high - height) / (high - rest)
    end = int(np.argmax(share > 0.95))
    begun = np.flatnonzero(share[: end + 1] < 0.05)
    if not len(begun):
        return {}
    start, margin = int(begun[-1]), round(0.4 * fps)
    down = slice(max(0, start - margin), min(len(height), end + margin))
    return {
        "sit_time": (end - start) / fps, "sit_speed": float(-np.gradient(height, 1 / fps)[down].min()), "sit_lean": float(lean[down].max()),
        "sit_hip": float(angles["hip_flexion"][down].mean(-1).max()), "seated_knee": float(np.median(angles["knee_flexion"][-round(0.5 * fps) :])),
    }  # fmt: skip
