"""All rates of all methods."""

from collections.abc import Sequence

from mimicbench.evaluate.rows import Summary
from mimicbench.report.grouping import method_name, stage_name
from mimicbench.report.table import Table
from mimicbench.report.tables.spec import Episodes, TableSpec


def results_table(found: Sequence[Summary]) -> Table:
    """A row for each method."""
    rows = [(stage_name(s.stage), method_name(s), s.kinematic, s.energy, s.stays, s.fell) for s in found]
    return Table(
        "results",
        "Results",
        ("Stage", "Policy", "K", "K and P", "Stays", "Fell"),
        tuple(rows),
        note="Rates with 95 % Wilson intervals in brackets and k/n in parentheses. K: the task's "
        "kinematic metric, fulfilled within the time limit. "
        "K and P: the energy-averaged rate, the mean over four limits of the rate of K with every e_i below the limit; "
        "its interval is Wilson's at the mean count. Stays: K's condition holds over the last 0.3 s of the time limit, "
        "or as long as K asks where that is longer, and the robot has not fallen by then. Fell: at any time up to the "
        "limit, after success, too.",
    )


def _make(episodes: Episodes) -> list[Table]:
    return [results_table(episodes.summaries)]


TABLE = TableSpec("results", "all rates of every method: K, K and P, stays, fell", _make)
