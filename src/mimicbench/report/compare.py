"""Tables and groupings that follow from episode rows: our results, ours beside the paper's, and where failures
happen.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mimicbench.evaluate.failures import FAILURES, failure
from mimicbench.evaluate.intervals import Rate
from mimicbench.evaluate.rows import ENERGY_LIMITS, EpisodeRow, Summary, group, summarize
from mimicbench.report.paper_tables import CITATION, COUNTERPARTS, TASKS, PaperRate, methods
from mimicbench.report.table import Cell, Reported, Table

MAX_FAILURES = 60
"""Failed episodes that a page lists; the file of episodes has all."""


def label(policy: str, preset: str) -> str:
    """How a policy is called in tables."""
    return f"{policy} ({preset})"


def summaries(rows: Sequence[EpisodeRow]) -> list[Summary]:
    """One summary per (task, stage, policy, preset): policies first, the best first within a stage."""
    found = [summarize(of_one) for of_one in group(rows).values()]
    return sorted(found, key=lambda s: (s.stage != "imitate", -s.kinematic.rate, -s.energy.rate, s.policy, s.preset))


def results_table(found: Sequence[Summary]) -> Table:
    """All rates of all policies."""
    rows = [(_stage(s), method_name(s), s.kinematic, s.energy, s.stays, s.fell) for s in found]
    return Table(
        "results",
        "Results",
        ("Stage", "Policy", "K", "K and P", "Stays", "Fell"),
        tuple(rows),
        note="Rates with 95 % Wilson intervals in brackets and k/n in parentheses. K: the task's "
        "kinematic metric, fulfilled within the time limit. "
        "K and P: the energy-averaged rate, the mean over four limits of the rate of K with every e_i below the limit; "
        "its interval is Wilson's at the mean count. Stays: K's condition holds over the last 0.3 s of the time limit, "
        "and the robot has not fallen by then. Fell: at any time up to the limit, after success, too.",
    )


def energy_table(found: Sequence[Summary]) -> Table:
    """K and P at each of the four energy limits."""
    rows = [(_stage(s), method_name(s), *s.by_limit) for s in found]
    columns = ("Stage", "Policy", *(f"λ = {limit / 1e6:.0f}e6" for limit in ENERGY_LIMITS))
    return Table(
        "energy",
        "K and P at each limit of the energy",
        columns,
        tuple(rows),
        note="P(λ): max over frames of the sum over joints of (τ v)² < λ, in W².",
    )


def beside_paper_table(task: str, found: Sequence[Summary]) -> Table:
    """Ours beside the paper's: one row per method, trackers and policies, of one task."""
    rows: list[tuple[Cell, ...]] = []
    for stage, measures in (("imitate", "imitation"), ("track", "tracking")):
        published = methods(task, measures)
        shown: set[str] = set()
        for s in (s for s in found if s.stage == stage and s.task == task):
            method = counterpart(stage, s.policy)
            theirs = published.get(method) if method else None
            name = method_name(s) + (f", as {method}" if theirs and method else "")
            kinematic, energy = _reported(theirs)
            rows.append((_stage(s), name, s.kinematic, kinematic, s.energy, energy, s.stays))
            shown |= {method} if theirs and method else set()
        for method, theirs in published.items():
            if method not in shown:
                rows.append(
                    (
                        "tracker" if stage == "track" else "policy",
                        method,
                        None,
                        _reported(theirs)[0],
                        None,
                        _reported(theirs)[1],
                        None,
                    )
                )
    return Table(
        "beside_paper",
        f"Ours beside the paper's ({TASKS.get(task, task)})",
        ("Stage", "Method", "K, ours", "K, paper", "K and P, ours", "K and P, paper", "Stays, ours"),
        tuple(rows),
        note="Ours with 95 % Wilson intervals and k/n. Simulator, objects, clips and starts differ "
        "from the paper's, which gives no counts and does not look past the moment of success.",
        source=CITATION,
    )


def best_table(found: Sequence[Summary]) -> Table:
    """Of every task the best policy and the best tracker, each beside the best of the paper, whichever method it is."""
    rows: list[tuple[Cell, ...]] = []
    for task, abbreviation in TASKS.items():
        of_task = [s for s in found if s.task == task]
        cells: list[Cell] = []
        for stage, measures in (("imitate", "imitation"), ("track", "tracking")):
            ours = max((s for s in of_task if s.stage == stage), key=lambda s: s.kinematic.rate, default=None)
            theirs = _reported(next(iter(methods(task, measures).values()), None))
            if stage == "imitate":
                cells.append(ours.policy if ours else None)
            cells += [ours.kinematic if ours else None, theirs[0], ours.stays if ours else None]
        if of_task:
            rows.append((abbreviation, *cells))
    return Table(
        "best",
        "The best of ours beside the best of the paper",
        ("Task", "Policy", "K", "K, paper", "Stays", "Tracker: K", "K, paper's", "Tracker: stays"),
        tuple(rows),
        note="On objects and starts that nothing was trained on, with 95 % Wilson intervals and k/n. Simulator, "
        "objects, clips and starts differ from the paper's, which gives no counts and does not look past the moment of "
        "success.",
        source=CITATION,
    )


def counterpart(stage: str, policy: str) -> str | None:
    """The paper's method that a policy of ours is, by its name or by the first word of its name (`act-clock` is an
    ACT).
    """
    return COUNTERPARTS.get((stage, policy)) or COUNTERPARTS.get((stage, policy.replace("+", "-").split("-")[0]))


def _reported(rate: PaperRate | None) -> tuple[Cell, Cell]:
    return (Reported(rate.kinematic), Reported(rate.energy)) if rate else (None, None)


def method_name(summary: Summary) -> str:
    """How a method is called beside the word `tracker` or `policy`, which it need not repeat."""
    return label("ours" if summary.policy == _stage(summary) else summary.policy, summary.preset)


def _stage(summary: Summary) -> str:
    return "tracker" if summary.stage == "track" else "policy"


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


def failures_table(rows: Sequence[EpisodeRow]) -> Table:
    """How each policy fails."""
    parts = [(label(policy, preset), of_one) for (_, _, policy, preset), of_one in group(rows).items()]
    body = [(name, *failures(of_one).values()) for name, of_one in parts]
    return Table("failures", "How episodes fail", ("Policy", *FAILURES), tuple(body), note="Shares of all episodes.")


def failed_table(failed: Sequence[EpisodeRow]) -> Table:
    """Episodes that failed, one by one, as many as a page bears."""
    columns = ("Policy", "Episode", "Object", "Kind", "Reference", "How", "From the object at the end [m]")
    body = [
        (
            label(row.policy, row.preset),
            row.id,
            row.object_id,
            row.object_kind,
            row.reference_id or None,
            failure(row),
            round(row.end_distance, 2),
        )
        for row in failed[:MAX_FAILURES]
    ]
    first = f"The first {MAX_FAILURES} of {len(failed)}; episodes.parquet has all."
    return Table("failed", "", columns, tuple(body), note=first if len(failed) > MAX_FAILURES else "")


def breakdown_table(rows: Sequence[EpisodeRow]) -> Table:
    """K of each policy by kind of object, height of the seat and distance of the start."""
    body = [
        (label(policy, preset), breakdown.title, part, rate)
        for (_, _, policy, preset), of_one in group(rows).items()
        for breakdown in breakdowns(of_one, rows)
        for part, rate in breakdown.parts.items()
    ]
    return Table("breakdown", "K over parts of the episodes", ("Policy", "By", "Part", "K"), tuple(body))
