"""How people walk, sit down and rest, in one number each: the same rule for synthetic people and recorded ones."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import find_peaks

from mimicbench.references.checks.beside_real import Person
from mimicbench.references.checks.gait_measures import measure_gait
from mimicbench.references.checks.phases import STRIDE, WINDOW
from mimicbench.references.checks.signals import RATE, WRISTS
from mimicbench.references.checks.stats import pairwise, spread
from mimicbench.references.paper import Spread

FROZEN = 0.005
"""Joints that are all in all slower than this [m/s] do not move."""
CURVE = 50
"""Places of a stride at which it is compared."""
STRIDES = (0.7, 2.0)
"""Shortest and longest stride [s]."""
JOINTS = ("hip flexion", "knee flexion", "ankle flexion")


@dataclass(frozen=True)
class Strides:
    """Angles over the stride, from a heel's strike to its next."""

    curves: np.ndarray
    """(S, 3, CURVE) of JOINTS [degrees]."""


def strides_of(people: Sequence[Person]) -> Strides:
    """All strides of straight walking, of both legs."""
    found = [curve for person in people for curve in _strides(person)]
    return Strides(np.array(found).reshape(-1, len(JOINTS), CURVE))


def share_within(strides: Strides, real: Strides) -> dict[str, float]:
    """Share of the stride over which the mean angle lies within a standard deviation of the real ones', by joint."""
    if not len(strides.curves) or not len(real.curves):
        return dict.fromkeys(JOINTS, float("nan"))
    away = np.abs(strides.curves.mean(0) - real.curves.mean(0)) <= real.curves.std(0)
    return dict(zip(JOINTS, away.mean(-1).tolist(), strict=True))


def measure_people(people: Sequence[Person]) -> dict[str, Spread]:
    """Mean and deviation over the people of every measure that they have; speeds in cm/s, lengths in cm."""
    rows = [dict(_measures(person)) for person in people]
    names = list(dict.fromkeys(name for row in rows for name in row))
    found = {name: spread(np.array([row[name] for row in rows if name in row])) for name in names}
    for phase, words in (("rest seated", "seated poses apart [cm]"), ("rest lying", "lying poses apart [cm]")):
        poses = [pose for person in people if (pose := _rest_pose(person, phase)) is not None]
        if len(poses) > 1:
            found[words] = (100 * pairwise(np.array(poses)), 0.0)
    return found


def _measures(person: Person) -> Iterator[tuple[str, float]]:
    signals, gait = person.signals, measure_gait(person.motion)
    walks = _frames(person, "walk")
    if walks.any():
        yield "walking, straighter knee, median [deg]", float(np.median(signals.pairs["knee flexion"][walks].min(-1)))
    for name, (words, factor) in GAIT.items():
        if np.isfinite(value := getattr(gait, name)):
            yield words, factor * value
    yield from _sitting_down(person)
    for phase in ("rest seated", "rest lying"):
        rests = _frames(person, phase)
        if rests.any():
            yield from ((f"{phase}, {words}", value) for words, value in _resting(person, rests))


GAIT = {
    "speed": ("walking, speed [m/s]", 1.0),
    "cadence": ("walking, cadence [steps/min]", 1.0),
    "step_length": ("walking, step length [cm]", 100.0),
    "step_width": ("walking, step width [cm]", 100.0),
    "double_support": ("walking, both feet bear [% of the time]", 100.0),
    "hip_range": ("walking, range of the hip [deg]", 1.0),
    "knee_range": ("walking, range of the knee [deg]", 1.0),
    "ankle_range": ("walking, range of the ankle [deg]", 1.0),
    "pelvis_rise": ("walking, rise of the pelvis [cm]", 100.0),
    "walking_lean": ("walking, lean of the trunk [deg]", 1.0),
}
"""Measure of the gait -> its words and factor."""


def _frames(person: Person, phase: str) -> np.ndarray:
    """(T,) the frames of all windows of a phase."""
    found = np.zeros(person.signals.frames, bool)
    for window, name in enumerate(person.phases):
        if name == phase:
            found[window * STRIDE : window * STRIDE + WINDOW] = True
    return found


def _sitting_down(person: Person) -> Iterator[tuple[str, float]]:
    """Of the first time."""
    windows = [i for i, name in enumerate(person.phases) if name == "sit down"]
    if not windows:
        return
    last = next((i for i, j in zip(windows, windows[1:], strict=False) if j > i + 2), windows[-1])
    signals = person.signals
    span = slice(max(0, windows[0] * STRIDE - round(0.5 * RATE)), last * STRIDE + WINDOW + round(0.5 * RATE))
    height = signals.single["pelvis height"][span]
    share = (height[:15].max() - height) / max(float(height[:15].max() - height[-8:].min()), 1e-6)
    end = int(np.argmax(share > 0.95))
    begun = np.flatnonzero(share[: end + 1] < 0.05)
    if not len(begun):
        return
    down = slice(span.start + int(begun[-1]), span.start + end + 1)
    hands = 100 * signals.pose[down][:, WRISTS, 0]
    yield "sitting down, time [s]", (down.stop - 1 - down.start) / RATE
    yield "sitting down, largest lean [deg]", float(signals.single["trunk pitch"][span].max())
    yield "sitting down, hands before the hips, farthest [cm]", float(hands.max(0).mean())
    yield "sitting down, hands before the hips, left against right [cm]", float(np.abs(hands @ [1, -1]).mean())
    if min(hands.std(0)) > 0.1:
        yield "sitting down, left hand with right [correlation]", float(np.corrcoef(hands.T)[0, 1])
    head = signals.single["head turn"][max(0, down.start - round(1.5 * RATE)) : down.stop]
    yield "sitting down, farthest look to a side [deg]", float(np.abs(head).max())


def _resting(person: Person, rests: np.ndarray) -> Iterator[tuple[str, float]]:
    speed = 100 * np.linalg.norm(np.gradient(person.signals.pose, 1 / RATE, axis=0), axis=-1)[rests]
    yield "hands [cm/s]", float(speed[:, WRISTS].mean())
    yield "head [cm/s]", float(speed[:, -1].mean())
    yield "all joints [cm/s]", float(speed.mean())
    yield "frozen [% of the time]", 100 * float((speed.mean(-1) < 100 * FROZEN).mean())


def _rest_pose(person: Person, phase: str) -> np.ndarray | None:
    """(J, 3) median over the last second at rest [m]."""
    rests = np.flatnonzero(_frames(person, phase))
    return np.median(person.signals.pose[rests[-WINDOW:]], axis=0) if len(rests) else None


def _strides(person: Person) -> Iterator[np.ndarray]:
    walks = _frames(person, "walk")
    for side in (0, 1):
        ahead = person.signals.pairs["ankle forward"][:, side]
        strikes = find_peaks(ahead, prominence=0.1, distance=round(0.5 * RATE))[0]
        angles = np.stack([person.signals.pairs[name][:, side] for name in JOINTS])
        for start, end in zip(strikes[:-1], strikes[1:], strict=True):
            if walks[start : end + 1].all() and STRIDES[0] <= (end - start) / RATE <= STRIDES[1]:
                places = np.linspace(start, end, CURVE)
                yield np.stack([np.interp(places, np.arange(len(row)), row) for row in angles])
