"""The paper's own tables, without ours."""

from mimicbench.report.paper_tables import CITATION, TASKS, PaperTable
from mimicbench.report.paper_tables import TABLES as PAPER_TABLES
from mimicbench.report.table import Reported, Table
from mimicbench.report.tables.spec import Episodes, TableSpec


def paper_table(table: PaperTable) -> Table:
    """One of them, for our writers."""
    tasks = [task for task in TASKS if any(task in rates for rates in table.rates.values())]
    columns = ["Method", *(f"{TASKS[task]} {rate}" for task in tasks for rate in ("K", "K and P"))]
    rows = []
    for method, rates in table.rates.items():
        pairs = [rates[task] for task in tasks]
        if table.mean:
            pairs.append(table.mean[method])
        rows.append((method, *(Reported(value) for pair in pairs for value in (pair.kinematic, pair.energy))))
    if table.mean:
        columns += ["Mean K", "Mean K and P"]
    return Table(
        "-".join(("paper", table.label.removeprefix("tab:").replace("_", "-"), table.measures)),
        table.caption,
        tuple(columns),
        tuple(rows),
        source=CITATION + f", {table.label}",
    )


def _make(episodes: Episodes) -> list[Table]:
    """They are the same whatever the episodes."""
    return [paper_table(table) for table in PAPER_TABLES]


TABLE = TableSpec("paper", "the paper's own tables; they need no episodes", _make, per_task=False)
