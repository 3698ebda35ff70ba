"""Ours beside the paper's: one row per method, policies and trackers, of one task."""

from collections.abc import Sequence

from mimicbench.evaluate.rows import Summary
from mimicbench.report.grouping import method_name, stage_name
from mimicbench.report.paper_tables import CITATION, COUNTERPARTS, TASKS, PaperRate, methods
from mimicbench.report.table import Cell, Reported, Table
from mimicbench.report.tables.spec import Episodes, TableSpec


def beside_paper_table(task: str, found: Sequence[Summary]) -> Table:
    """The methods of ours, each beside the paper's that it is; then those of the paper that nobody of ours is."""
    rows: list[tuple[Cell, ...]] = []
    for stage, measures in (("imitate", "imitation"), ("track", "tracking")):
        published = methods(task, measures)
        shown: set[str] = set()
        for s in (s for s in found if s.stage == stage and s.task == task):
            method = counterpart(stage, s.policy)
            theirs = published.get(method) if method else None
            name = method_name(s) + (f", as {method}" if theirs and method else "")
            kinematic, energy = _reported(theirs)
            rows.append((stage_name(stage), name, s.kinematic, kinematic, s.energy, energy, s.stays))
            shown |= {method} if theirs and method else set()
        for method, theirs in published.items():
            if method not in shown:
                kinematic, energy = _reported(theirs)
                rows.append((stage_name(stage), method, None, kinematic, None, energy, None))
    return Table(
        "beside-paper",
        f"Ours beside the paper's ({TASKS.get(task, task)})",
        ("Stage", "Method", "K, ours", "K, paper", "K and P, ours", "K and P, paper", "Stays, ours"),
        tuple(rows),
        note="Ours with 95 % Wilson intervals and k/n. Simulator, objects, clips and starts differ "
        "from the paper's, which gives no counts and does not look past the moment of success.",
        source=CITATION,
    )


def counterpart(stage: str, policy: str) -> str | None:
    """The paper's method that a policy of ours is, by its name or by the first word of its name (`act-clock` is an
    ACT).
    """
    return COUNTERPARTS.get((stage, policy)) or COUNTERPARTS.get((stage, policy.replace("+", "-").split("-")[0]))


def _reported(rate: PaperRate | None) -> tuple[Cell, Cell]:
    return (Reported(rate.kinematic), Reported(rate.energy)) if rate else (None, None)


def _make(episodes: Episodes) -> list[Table]:
    return [beside_paper_table(episodes.rows[0].task, episodes.summaries)]


TABLE = TableSpec("beside-paper", "every method of ours, and every method of the paper", _make)
