"""How people walk and sit down, in the figures of gait laboratories, measured on any clip: synthetic and real ones
by the same rule.

Events of the gait come from positions alone, so that labels cannot make a difference: a heel strikes where it is
farthest in front of the pelvis, and toes leave the floor where they are farthest behind it (Zeni, Richards and
Higginson, Gait & Posture 27, 2008).
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields

import numpy as np
from scipy.signal import find_peaks

from mimicbench.core import rotations as rot
from mimicbench.core.motion import HumanMotion
from mimicbench.core.skeleton import forward_kinematics
from mimicbench.references.body.angles import joint_angles
from mimicbench.references.body.body import Body, body_of
from mimicbench.references.checks.contacts import sole_points
from mimicbench.references.curves import smooth


@dataclass(frozen=True)
class GaitMeasures:
    """Means over one clip; NaN where it has none of it. Angles in degrees."""

    speed: float
    """Of the pelvis during steps of straight walking [m/s]."""
    cadence: float
    """[steps/min]"""
    step_length: float
    """From where one ankle stands to where the other does, along the way [m]."""
    step_width: float
    """And across it [m]."""
    double_support: float
    """Share of the time of walking with both feet on the floor."""
    hip_range: float
    """Flexion, most less least, while walking."""
    knee_range: float
    ankle_range: float
    straighter_knee: float
    """Flexion of the knee that is bent less, of the two: its median while walking."""
    pelvis_rise: float
    """The pelvis moves up and down by so much in a step [m]."""
    walking_lean: float
    """Mean forward pitch of the line from pelvis to shoulders while walking."""
    sit_time: float
    """From 5 to 95 % of the pelvis's way down to a seat [s]."""
    sit_speed: float
    """Fastest that it sinks [m/s]."""
    sit_lean: float
    """Largest forward pitch of that line on the way down."""
    sit_hip: float
    """Largest flexion of the hips on the way down."""
    seated_knee: float
    """Flexion of the knees at rest on the seat."""


STRAIGHT, FORWARD = 0.35, 0.15
"""A step is straight walking if the heading turns by less [rad], and the pelvis goes forward by more [m]."""
LYING = 45.0
"""Whose trunk leans more at the end [degrees] lies rather than sits."""
STEADY = 0.75
"""And steady walking if it is faster than this share of the clip's fastest step."""


def measure_gait(motion: HumanMotion) -> GaitMeasures:
    """All figures of one clip."""
    body = body_of(motion.skeleton)
    pos, quat = motion.forward_kinematics()
    angles = {name: np.degrees(values) for name, values in joint_angles(body, motion.local_quat).items()}
    lean = np.degrees(_trunk_lean(body, pos, rot.yaw_of(quat[:, 0])))
    found = dict.fromkeys((field.name for field in fields(GaitMeasures)), float("nan"))
    found |= _walking(motion, body, pos, quat, angles, lean)
    if not motion.contact_names or "pelvis" in motion.contact_names:  # who squats to reach something does not sit
        found |= _sitting(motion.root_pos_w[:, 2], motion.fps, body, angles, lean)
    return GaitMeasures(**found)


def summarize(measures: Iterable[GaitMeasures]) -> dict[str, tuple[float, float, int]]:
    """Per figure the mean, the deviation, and of how many clips."""
    rows = list(measures)
    summary = {}
    for name in (field.name for field in fields(GaitMeasures)):
        values = np.array([getattr(row, name) for row in rows], float)
        values = values[np.isfinite(values)]
        summary[name] = (
            (float(values.mean()), float(values.std()), len(values)) if len(values) else (float("nan"), float("nan"), 0)
        )
    return summary


def walking_model(speed: float, leg: float) -> Mapping[str, float]:
    """Cadence [steps/min], step length [m] and double support of people at some speed [m/s] with legs (hip to ankle)
    of some length [m].

    The normalized relations that Boulic, Magnenat-Thalmann and Thalmann (The Visual Computer 6, 1990) fitted to
    experiments.
    """
    relative = speed / leg
    cycle_length = 1.346 * np.sqrt(relative)
    cycle = cycle_length / relative
    return {
        "cadence": 120.0 / cycle,
        "step_length": 0.5 * cycle_length * leg,
        "double_support": 2 * (0.252 * cycle - 0.143) / cycle,
    }


def _trunk_lean(body: Body, pos: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """Pitch (T,) of the line from pelvis to the middle of the shoulders towards where the pelvis faces [rad].

    0 in the rest pose.
    """
    shoulders = [arm.root for arm in body.arms]
    rest, _ = forward_kinematics(
        body.skeleton, np.zeros((1, 3)), np.tile(rot.IDENTITY, (1, len(body.skeleton.joint_names), 1))
    )
    upright = rest[0, shoulders].mean(0)
    trunk = pos[:, shoulders].mean(1) - pos[:, body.pelvis]
    forward = trunk[:, 0] * np.cos(yaw) + trunk[:, 1] * np.sin(yaw)
    return np.arctan2(forward, trunk[:, 2]) - np.arctan2(upright[0], upright[2])


@dataclass(frozen=True)
class _Event:
    frame: int
    side: int


def _events(motion: HumanMotion, body: Body, pos: np.ndarray, quat: np.ndarray) -> tuple[list[_Event], list[_Event]]:
    """Heel strikes and toe-offs, in order."""
    yaw = rot.yaw_of(quat[:, 0])
    facing = np.stack([np.cos(yaw), np.sin(yaw)], -1)
    apart = max(1, round(0.5 * motion.fps))
    strikes, lifts = [], []
    for side, leg in enumerate(body.legs):
        away = sole_points(body, pos[:, leg.end], quat[:, leg.end]) - motion.root_pos_w[:, None]
        heel, toe = smooth((away[..., :2] * facing[:, None]).sum(-1), max(1, round(0.05 * motion.fps))).T
        strikes += [_Event(int(frame), side) for frame in find_peaks(heel, prominence=0.08, distance=apart)[0]]
        lifts += [_Event(int(frame), side) for frame in find_peaks(-toe, prominence=0.08, distance=apart)[0]]
    return sorted(strikes, key=lambda event: event.frame), sorted(lifts, key=lambda event: event.frame)


@dataclass(frozen=True)
class Step:
    """One step of straight walking, from a heel strike to the other foot's."""

    start: int
    """Frame at which the first heel strikes."""
    end: int
    """Frame at which the other one does."""
    side: int
    """Which foot strikes first: 0 is left, 1 is right."""
    measures: dict[str, float]
    """The figures of GaitMeasures that a single step has."""


def straight_steps(motion: HumanMotion, body: Body, pos: np.ndarray, quat: np.ndarray) -> list[Step]:
    """Steps of steady straight walking, of a clip with joints at (T, J, 3) [m], (T, J, 4)."""
    ankles, pelvis = pos[:, [leg.end for leg in body.legs]], motion.root_pos_w
    facing = rot.yaw_of(quat[:, 0])
    strikes, lifts = _events(motion, body, pos, quat)
    steps: list[Step] = []
    for first, second in zip(strikes[:-1], strikes[1:], strict=True):
        start, end = first.frame, second.frame
        if end == start:
            continue
        # the way is that of a whole stride around the step, over which the sway from side to side cancels
        before, after = max(0, start - (end - start) // 2), min(motion.frames - 1, end + (end - start) // 2)
        way = (pelvis[after, :2] - pelvis[before, :2]) * (end - start) / (after - before)
        gone, seconds = float(np.linalg.norm(way)), (end - start) / motion.fps
        straight = abs(rot.wrap_angle(facing[end] - facing[start])) < STRAIGHT
        # toes of the hind foot leave the floor after the fore foot's heel has struck
        lifted = [event.frame for event in lifts if start <= event.frame < end and event.side == second.side]
        if first.side == second.side or gone < FORWARD or not straight or not 0.2 < seconds < 1.2 or not lifted:
            continue
        along = way / gone
        if along @ np.array([np.cos(facing[start]), np.sin(facing[start])]) < 0.7:  # sideways, or backward
            continue
        between = _place(ankles, second, motion.fps) - _place(ankles, first, motion.fps)
        height = pelvis[start : end + 1, 2]
        measures = {
            "speed": gone / seconds,
            "cadence": 60 / seconds,
            "step_length": float(between @ along),
            "step_width": float(abs(between @ np.array([-along[1], along[0]]))),
            "double_support": (lifted[0] - start) / (end - start),
            "pelvis_rise": float(np.ptp(height - np.linspace(height[0], height[-1], len(height)))),
        }
        steps.append(Step(start, end, first.side, measures))
    # starting and stopping are not walking
    fastest = max((step.measures["speed"] for step in steps), default=0.0)
    return [step for step in steps if step.measures["speed"] > STEADY * fastest]


def _walking(
    motion: HumanMotion, body: Body, pos: np.ndarray, quat: np.ndarray, angles: dict[str, np.ndarray], lean: np.ndarray
) -> dict[str, float]:
    steps = straight_steps(motion, body, pos, quat)
    if len(steps) < 2:
        return {}
    found = {name: float(np.mean([step.measures[name] for step in steps])) for name in steps[0].measures}
    # a mean over unequal steps is one of times, not of rates
    found["cadence"] = 60 / float(np.mean([60 / step.measures["cadence"] for step in steps]))
    walks = np.zeros(motion.frames, bool)
    for step in steps:
        walks[step.start : step.end + 1] = True
    ranges = {name: float(np.ptp(angles[joint][walks], axis=0).mean()) for name, joint in _JOINTS.items()}
    straighter = float(np.median(angles["knee_flexion"][walks].min(-1)))
    return found | ranges | {"straighter_knee": straighter, "walking_lean": float(lean[walks].mean())}


def _place(ankles: np.ndarray, strike: _Event, fps: float) -> np.ndarray:
    """(2,) where a foot stands after it has struck and come to rest [m], from both ankles (T, 2, 3)."""
    rests = slice(strike.frame + round(0.12 * fps), strike.frame + round(0.28 * fps) + 1)
    return np.median(
        ankles[rests, strike.side, :2] if rests.start < len(ankles) else ankles[-1:, strike.side, :2], axis=0
    )


_JOINTS = {"hip_range": "hip_flexion", "knee_range": "knee_flexion", "ankle_range": "ankle_plantarflexion"}


def _sitting(
    height: np.ndarray, fps: float, body: Body, angles: dict[str, np.ndarray], lean: np.ndarray
) -> dict[str, float]:
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
    last = slice(-max(1, round(0.5 * fps)), None)
    sits = abs(float(np.median(lean[last]))) < LYING
    return {
        "sit_time": (end - start) / fps,
        "sit_speed": float(-np.gradient(height, 1 / fps)[down].min()),
        "sit_lean": float(lean[down].max()),
        "sit_hip": float(angles["hip_flexion"][down].mean(-1).max()),
        "seated_knee": float(np.median(angles["knee_flexion"][last])) if sits else float("nan"),
    }
