"""What somebody is doing, told from the motion alone, by the same rule for synthetic people and recorded ones."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mimicbench.references.checks.signals import LEG, RATE, WRISTS, Signals

WINDOW, STRIDE = round(1.0 * RATE), round(0.25 * RATE)
"""Windows have so many frames, and begin so many after each other."""
PHASES = ("walk", "turn", "sit down", "rest seated", "lie down", "rest lying", "reach", "lift")


@dataclass(frozen=True)
class PhaseRules:
    """What counts as what, in a window. Heights are of the hips over those of who stands on straight legs."""

    upright: float = 0.92
    """Who is higher stands or walks."""
    low: float = 0.82
    """Who is lower sits, lies, squats, or is on the way."""
    walking: float = 0.35
    """Least speed [m/s] of who walks."""
    standing: float = 0.25
    """Most speed [m/s] of who reaches."""
    turning: float = 30.0
    """Heading [degrees] that changes while somebody turns."""
    sinking: float = 0.10
    """Way down [m] of who sits down."""
    reclining: float = 12.0
    """Tilt [degrees] that a trunk gains while somebody lies down."""
    lying: float = 50.0
    """Least tilt [degrees] of who lies."""
    resting: float = 0.15
    """Most speed of the pelvis [m/s] of who rests."""
    feet: float = 0.18
    """The feet of who sits rather than squats are so far in front of the hips [m]."""
    ahead: float = 1.5
    """So soon after [s] who sits or lies down rests, and twice so long before and after nobody does who reaches."""
    bent: float = 35.0
    """Who leans farther forward [degrees] bends rather than lies."""
    reach: float = 0.40
    """Distance [m] from the pelvis, seen from above, of a hand held out; what it is above the chest counts, too."""
    chest: float = 0.2
    """Above the hips [m]."""
    reaching: float = 0.06
    """Way out [m] that it gains."""
    lifting: float = 0.05
    """Way up [m] of the object that is lifted."""


def window_starts(signals: Signals) -> np.ndarray:
    """(W,) the first frames of all windows of a clip."""
    return np.arange(0, signals.frames - WINDOW + 1, STRIDE)


def phases_of(signals: Signals, rules: PhaseRules | None = None) -> list[str | None]:
    """For each window one of PHASES, or None of what is none of them, such as getting up."""
    rules = rules or PhaseRules()
    lies = _lies(signals, rules)
    states = _States(lies, _rests(signals, lies, rules), _out(signals, rules))
    return [_phase(signals, int(start), states, rules) for start in window_starts(signals)]


class _States(NamedTuple):
    """Over all frames of a clip."""

    lies: np.ndarray
    """(T,)"""
    rests: np.ndarray
    """(T,)"""
    out: np.ndarray
    """(T, 2)"""


def _lies(signals: Signals, rules: PhaseRules) -> np.ndarray:
    """(T,) whether the trunk is laid down, on the back or on a side."""
    return (signals.single["trunk tilt"] > rules.lying) & (signals.single["trunk pitch"] < rules.bent)


def _rests(signals: Signals, lies: np.ndarray, rules: PhaseRules) -> np.ndarray:
    """(T,) whether somebody sits or lies, as good as still."""
    single = signals.single
    speed = np.sqrt(sum(single[f"speed {way}"] ** 2 for way in ("forward", "sideways", "up")))
    low = single["pelvis height"] < rules.low * LEG
    sits = (signals.pairs["ankle forward"].max(-1) > rules.feet) & (single["trunk pitch"] < rules.bent)
    return low & (speed < rules.resting) & (sits | lies)


def _out(signals: Signals, rules: PhaseRules) -> np.ndarray:
    """(T, 2) how far hands are held out [m]."""
    wrists = signals.pose[:, WRISTS]
    above = np.maximum(wrists[..., 2] - rules.chest, 0.0)
    return np.hypot(np.linalg.norm(wrists[..., :2], axis=-1), above)


def _phase(signals: Signals, start: int, states: _States, rules: PhaseRules) -> str | None:
    part = slice(start, start + WINDOW)
    soon = slice(start + WINDOW - 1, start + WINDOW + round(rules.ahead * RATE))
    margin = round(2 * rules.ahead * RATE)
    around = slice(max(0, start - margin), start + WINDOW + margin)
    single = {name: values[part] for name, values in signals.single.items()}
    height, tilt = single["pelvis height"], single["trunk tilt"]
    if signals.carried[part][-1] - signals.carried[part][0] > rules.lifting:
        return "lift"
    if height[-1] < rules.low * LEG and states.rests[soon].any():
        if height[0] < rules.low * LEG and tilt[-1] - tilt[0] > rules.reclining and states.lies[soon].any():
            return "lie down"
        if height[0] - height[-1] > rules.sinking:
            return "sit down"
        return _rest(states, part, around)
    upright = height.min() > rules.upright * LEG
    if upright and abs(float(single["turning"].mean())) * WINDOW / RATE > rules.turning:
        return "turn"
    speed = float(np.hypot(single["speed forward"], single["speed sideways"]).mean())
    if speed > rules.standing:
        return "walk" if upright and speed > rules.walking else None
    out = states.out[part]
    reaches = (out[-1] > rules.reach) & (out[-1] - out[0] > rules.reaching)
    free = not states.rests[around].any() and abs(signals.carried[part]).max() < rules.lifting
    return "reach" if reaches.any() and free else None


def _rest(states: _States, part: slice, around: slice) -> str | None:
    """Who sits on the edge before or after lying does not rest."""
    if states.rests[part].mean() < 0.8:
        return None
    if states.lies[part].all():
        return "rest lying"
    return None if states.lies[around].any() else "rest seated"
