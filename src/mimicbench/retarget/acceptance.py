"""Whether a clip was solved, by what it measured of itself, and what a set of clips measured."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np

MEASURES = (
    "position_error",
    "wrist_error",
    "pelvis_error",
    "ankle_error",
    "orientation_error",
    "limit_violation",
    "velocity_ratio",
    "acceleration",
    "skate",
    "step_skate",
    "sole_height",
    "sole_depth",
    "sole_tilt",
    "penetration",
    "depth",
    "goal_error",
    "contact_kept",
    "balance",
    "self_collision",
    "support_lost",
    "lean_error",
)
"""What the summary of a set tells, of what `measures.py` explains."""
BEST_IS_MOST = frozenset({"contact_kept"})
"""Of these the least is the worst."""


@dataclass(frozen=True)
class Limits:
    """What a solved clip may measure at most. Wide: who is beyond one is broken, not merely bad."""

    limit_violation: float = 0.0
    """[rad] of any joint."""
    velocity_ratio: float = 1.0
    """Joint velocity as a part of the robot's limit."""
    position_error: float = 0.25
    """[m] in the mean over frames and pairs: the body is somewhere else, or cannot reach."""
    goal_error: float = 0.1
    """[m] of a wrist that has a goal: it is out of reach."""
    depth: float = math.inf
    """[m] in floor or object."""
    step_skate: float = math.inf
    """[m] that a standing sole moves, in the mean over steps: the body is wedged in somewhere."""
    support_lost: float = math.inf
    """Share of the time that the person's pelvis, back or head rests on the object and the robot's does not: it
    hovers."""
    lean_error: float = math.inf
    """[rad] between the trunk of who sits or lies and the person's."""


PROMISED = Limits(depth=0.04, step_skate=0.04, support_lost=0.1, lean_error=math.radians(8.0))
"""Of methods that promise to stay out of things, to keep feet still, and to rest on what the person rests on."""


def unsolved(measures: Mapping[str, float], limits: Limits) -> list[str]:
    """What speaks against a clip, by name: `not_finite`, or the measures beyond their limits. Empty if it is solved."""
    if not all(math.isfinite(value) for value in measures.values()):
        return ["not_finite"]
    return [name for name, most in asdict(limits).items() if measures.get(name, 0.0) > most]


@dataclass(frozen=True)
class Outcome:
    """What became of one clip."""

    fulfilled: bool
    """Whether K holds."""
    wrong: tuple[str, ...]
    """Why it is kept out, `K` or names of `unsolved`; empty if it is passed on."""
    measures: np.ndarray
    """(M,) single precision, in the order of MEASURES; NaN for what the robot motion does not tell."""
    frames: int


def outcome(measures: Mapping[str, float], fulfilled: bool, frames: int, limits: Limits) -> Outcome:
    """The outcome of a clip that was retargeted and judged."""
    wrong = (*([] if fulfilled else ["K"]), *unsolved(measures, limits))
    return Outcome(fulfilled, wrong, np.array([measures.get(name, math.nan) for name in MEASURES], np.float32), frames)


@dataclass(frozen=True)
class Summary:
    """A set of clips."""

    clips: int
    frames: int
    fulfilled: int
    """Clips for which K holds."""
    kept: int
    """Clips that are passed on: solved, and K holds."""
    k_rate: float
    """Share of all clips for which K holds: the paper's filter."""
    rate: float
    """Share of all clips that are passed on."""
    rejected_for: dict[str, int]
    """Name -> clips that it speaks against, the most frequent first."""
    measures: dict[str, dict[str, float]]
    """Name -> `mean` and `worst` over all clips, kept or not."""


def summary(outcomes: Sequence[Outcome]) -> Summary:
    """Counts, rates, reasons, and mean and worst of every measure."""
    values = np.array([found.measures for found in outcomes], float).reshape(len(outcomes), len(MEASURES))
    wrong = Counter(name for found in outcomes for name in found.wrong)
    clips = len(outcomes)
    fulfilled, kept = sum(found.fulfilled for found in outcomes), sum(not found.wrong for found in outcomes)
    told = {}
    for column, name in enumerate(MEASURES):
        known = values[np.isfinite(values[:, column]), column]
        if len(known):
            told[name] = {
                "mean": float(known.mean()),
                "worst": float(known.min() if name in BEST_IS_MOST else known.max()),
            }
    frames, reasons = (
        sum(found.frames for found in outcomes),
        dict(sorted(wrong.items(), key=lambda item: (-item[1], item[0]))),
    )
    return Summary(clips, frames, fulfilled, kept, fulfilled / max(1, clips), kept / max(1, clips), reasons, told)
