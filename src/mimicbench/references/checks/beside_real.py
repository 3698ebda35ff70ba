"""A judge without eyes: how surely synthetic people can be told from recorded ones, phase by phase, and by what."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mimicbench.core.errors import BadFile, BadMotion
from mimicbench.core.motion import HumanMotion
from mimicbench.references.checks.boosting import area_under_curve, unseen_area
from mimicbench.references.checks.features import window_features
from mimicbench.references.checks.phases import PHASES, phases_of
from mimicbench.references.checks.signals import Signals, signals_of
from mimicbench.references.importers.recording import Recording
from mimicbench.references.importers.registry import import_recording

ENDINGS = (".npy", ".npz", ".pt", ".pth", ".bvh", ".pkl", ".txt")
"""Of files that may be recordings."""
FOLDS = 5
MOST = 1500
"""Synthetic windows of a phase that are looked at, evenly spread."""
NAMED = 8
"""Features that are named, one of each signal."""
DISCRIMINATIVE = 0.8
"""A feature is called discriminative if its own area under the curve is larger, or smaller than what is left to 1."""


@dataclass(frozen=True)
class Person:
    """A clip or recording, as the judge sees it."""

    motion: HumanMotion
    signals: Signals
    phases: tuple[str | None, ...]
    """Of its windows."""


@dataclass(frozen=True)
class Feature:
    """A feature, and how well it alone tells synthetic from real."""

    name: str
    area: float
    """Under its own curve: 1 if it is larger in every synthetic window, 0 if it is smaller."""
    real: tuple[float, float]
    """Mean and deviation over the windows."""
    synthetic: tuple[float, float]


@dataclass(frozen=True)
class Judgement:
    """One phase."""

    phase: str
    recordings: int
    real_windows: int
    clips: int
    synthetic_windows: int
    area: float
    """Under the curve, cross-validated: 0.5 where nothing can be told, 1 where everything can; NaN where a kind has
    fewer than two recordings or clips."""
    discriminative: float
    """Share of the features that are discriminative by themselves."""
    features: tuple[Feature, ...]
    """The most discriminative ones."""


def person_of(motion: HumanMotion) -> Person:
    """What the judge looks at."""
    signals = signals_of(motion)
    return Person(motion, signals, tuple(phases_of(signals)))


def read_recordings(folder: Path, say: Callable[[str], None]) -> list[HumanMotion]:
    """Every recording in a file or a folder, those of its folders too; `say` hears what could not be read. Raises
    BadFile if there is none.
    """
    files = [folder] if folder.is_file() else sorted(p for p in folder.rglob("*") if p.suffix.lower() in ENDINGS)
    found = []
    for path in files:
        try:
            found.append(whole(import_recording(path)))
        except (BadFile, BadMotion) as error:
            say(f"left out: {error}")
    if not found:
        raise BadFile(f"{folder} holds no recording of a person; give a folder with files that `import` reads")
    return found


def whole(recording: Recording) -> HumanMotion:
    """A recording as it is, beside no object but the one that it tracks."""
    motion = HumanMotion(
        recording.name, "none", recording.skeleton, recording.fps, recording.root_pos_w, recording.local_quat, "none"
    )
    track = recording.track
    return motion if track is None else replace(motion, object_pos_w=track.pos_w, object_quat_w=track.quat_w)


def judge(real: Sequence[Person], synthetic: Sequence[Person]) -> list[Judgement]:
    """Every phase that both kinds of people have."""
    ours, theirs = _by_phase(synthetic), _by_phase(real)
    return [_judged(phase, theirs[phase], ours[phase]) for phase in PHASES if phase in ours and phase in theirs]


@dataclass(frozen=True)
class _Rows:
    """Windows of one phase and kind."""

    names: tuple[str, ...]
    values: np.ndarray
    """(N, F)"""
    people: np.ndarray
    """(N,) whose they are."""


def _by_phase(people: Sequence[Person]) -> dict[str, _Rows]:
    features = [window_features(person.signals) for person in people]
    found = {}
    for phase in PHASES:
        of = [np.array([found == phase for found in person.phases], bool) for person in people]
        values = [rows[mask] for (_, rows), mask in zip(features, of, strict=True) if mask.any()]
        if values:
            names = [np.repeat(person.signals.name, mask.sum()) for person, mask in zip(people, of, strict=True)]
            found[phase] = _Rows(features[0][0], np.concatenate(values), np.concatenate(names))
    return found


def _judged(phase: str, real: _Rows, synthetic: _Rows) -> Judgement:
    count = len(synthetic.values)
    shown = np.unique(np.linspace(0, count - 1, min(MOST, count)).round().astype(int))
    rows = np.concatenate([real.values, synthetic.values[shown]])
    kind = np.repeat([0.0, 1.0], [len(real.values), len(shown)])
    group = np.concatenate([real.people, synthetic.people[shown]])
    areas = np.array([area_under_curve(column, kind) for column in rows.T])
    people = len(set(real.people)), len(set(synthetic.people))
    return Judgement(
        phase,
        people[0],
        len(real.values),
        people[1],
        count,
        unseen_area(rows, kind, group, FOLDS),
        float((np.abs(areas - 0.5) > DISCRIMINATIVE - 0.5).mean()),
        _most_discriminative(real.names, rows, kind, areas),
    )


def _most_discriminative(
    names: tuple[str, ...], rows: np.ndarray, kind: np.ndarray, areas: np.ndarray
) -> tuple[Feature, ...]:
    """The features with the most extreme areas; of those with equal ones, whose means are farthest apart."""
    real, synthetic = rows[kind == 0], rows[kind == 1]
    apart = np.abs(synthetic.mean(0) - real.mean(0)) / (real.std(0) + synthetic.std(0) + 1e-9)
    found: dict[str, Feature] = {}
    for i in np.lexsort((-apart, -np.round(np.abs(areas - 0.5), 2))):
        feature = Feature(
            names[i],
            float(areas[i]),
            (float(real[:, i].mean()), float(real[:, i].std())),
            (float(synthetic[:, i].mean()), float(synthetic[:, i].std())),
        )
        found.setdefault(names[i].split(",")[0], feature)
    return tuple(found.values())[:NAMED]
