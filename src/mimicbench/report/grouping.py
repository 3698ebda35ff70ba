"""What tables, plots and pages share: how methods are called, and groupings of episodes."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mimicbench.evaluate.failures import FAILURES, failure
from mimicbench.evaluate.intervals import Rate
from mimicbench.evaluate.rows import EpisodeRow, Summary
from mimicbench.robots.registry import DEFAULT_ROBOT


def label(of: Summary | EpisodeRow, policy: str = "") -> str:
    """How a policy is called in tables: by its own name or another, its gains, and its robot if that is not the usual
    one.
    """
    robot = "" if of.robot == DEFAULT_ROBOT else f", {of.robot}"
    return f"{policy or of.policy} ({of.preset}{robot})"


def method_name(summary: Summary) -> str:
    """How a method is called beside the word `tracker` or `policy`, which it need not repeat."""
    return label(summary, "ours" if summary.policy == "tracker" else summary.policy)


def stage_name(stage: str) -> str:
    """What tables call those of a stage."""
    return "tracker" if stage == "track" else "policy"


@dataclass(frozen=True)
class Breakdown:
    """The rate of K over parts of the episodes."""

    title: str
    parts: Mapping[str, Rate]


def failures(rows: Sequence[EpisodeRow]) -> dict[str, Rate]:
    """How many of all episodes failed in each way."""
    return {kind: Rate(sum(failure(row) == kind for row in rows), len(rows)) for kind in FAILURES}


def breakdowns(rows: Sequence[EpisodeRow], among: Sequence[EpisodeRow] | None = None) -> list[Breakdown]:
    """The rate of K by kind of object, height of the seat and distance of the start; what does not differ is left out.

    Heights and distances fall into thirds of the episodes `among`, of `rows` if None: give it the rows of all policies
    that shall be compared.
    """
    among = among or rows
    found = [
        _by("Kind of object", rows, lambda row: row.object_kind),
        _by("Height of the seat", rows, _thirds(among, lambda row: row.seat_height)),
        _by("Distance at the start", rows, _thirds(among, lambda row: row.start_distance)),
    ]
    return [breakdown for breakdown in found if len(breakdown.parts) > 1]


def _by(title: str, rows: Sequence[EpisodeRow], key: Callable[[EpisodeRow], str | None]) -> Breakdown:
    parts: dict[str, list[bool]] = {}
    for row in rows:
        if (name := key(row)) is not None:
            parts.setdefault(name, []).append(row.success)
    return Breakdown(title, {name: Rate(sum(parts[name]), len(parts[name])) for name in sorted(parts)})


def _thirds(
    rows: Sequence[EpisodeRow], value: Callable[[EpisodeRow], float | None]
) -> Callable[[EpisodeRow], str | None]:
    """Names three parts of about as many episodes, between round numbers [m].

    None where there is no value or no variety.
    """
    values = [v for row in rows if (v := value(row)) is not None]
    if len(set(values)) < 3:
        return lambda row: None
    low, high = (round(float(edge), 2) for edge in np.quantile(values, (1 / 3, 2 / 3)))

    def name(row: EpisodeRow) -> str | None:
        v = value(row)
        if v is None:
            return None
        return f"{low:.2f} m or less" if v <= low else f"to {high:.2f} m" if v <= high else f"up to {max(values):.2f} m"

    return name
