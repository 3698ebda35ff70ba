"""Of every task the best policy and the best tracker, each beside the best that the paper has in any of its tables."""

from collections.abc import Sequence

from mimicbench.evaluate.rows import Summary
from mimicbench.report.paper_tables import CITATION, TASKS, best_of_paper
from mimicbench.report.table import Cell, Reported, Table
from mimicbench.report.tables.spec import Episodes, TableSpec


def best_table(found: Sequence[Summary]) -> Table:
    """A row for each task: those of the paper in its order, then others."""
    tasks = dict.fromkeys(s.task for s in found)
    ordered = [*(task for task in TASKS if task in tasks), *(task for task in tasks if task not in TASKS)]
    return Table(
        "best",
        "The best of ours beside the best of the paper",
        (
            *("Task", "Policy", "K", "K, paper", "K and P", "K and P, paper", "Stays"),
            *("Tracker: K", "K, paper's", "Tracker: stays"),
        ),
        tuple(_row(task, [s for s in found if s.task == task]) for task in ordered),
        note="The best is who stays most often. On objects and starts that nothing was trained on, with 95 % Wilson "
        "intervals and k/n. Simulator, objects, clips and starts differ from the paper's, which gives no counts and "
        "does not look past the moment of success.",
        source=CITATION,
    )


def best_policy(found: Sequence[Summary], stage: str = "imitate") -> Summary | None:
    """The first of a stage, of summaries in the order of Episodes: that which stays most often."""
    return next((s for s in found if s.stage == stage), None)


def _row(task: str, found: Sequence[Summary]) -> tuple[Cell, ...]:
    cells: list[Cell] = [TASKS.get(task, task)]
    for stage, measures in (("imitate", "imitation"), ("track", "tracking")):
        ours = best_policy(found, stage)
        theirs = best_of_paper(task, measures)
        if stage == "imitate":
            cells.append(ours.policy if ours else None)
        cells += [ours.kinematic if ours else None, Reported(theirs.kinematic) if theirs else None]
        if stage == "imitate":
            cells += [ours.energy if ours else None, Reported(theirs.energy) if theirs else None]
        cells.append(ours.stays if ours else None)
    return tuple(cells)


def _make(episodes: Episodes) -> list[Table]:
    return [best_table(episodes.summaries)] if episodes.rows else []


TABLE = TableSpec(
    "best", "the best policy and tracker of every task beside the best of the paper", _make, per_task=False
)
