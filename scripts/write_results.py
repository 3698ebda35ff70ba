"""Writes the tables of results into README.md and docs/results.md, from the episode rows in `runs/`.

`runs/<task>` holds the best of a task, whose rows are in the README's table; other folders are of several tasks, or of
what came before. A test fails where a page says something else than the rows.
"""

from collections.abc import Sequence
from pathlib import Path

from mimicbench.evaluate.rows import EpisodeRow, read_rows
from mimicbench.report.table import to_markdown
from mimicbench.report.tables.registry import TABLES
from mimicbench.report.tables.spec import Episodes
from mimicbench.tasks.registry import TASKS

ROOT = Path(__file__).parents[1]
README, RESULTS = ROOT / "README.md", ROOT / "docs" / "results.md"


def rows_of(folder: Path) -> list[EpisodeRow]:
    """All episode rows of a run."""
    return [row for path in sorted((folder / "evaluate").glob("*.parquet")) for row in read_rows(path)]


def best() -> str:
    """The table of the best of every task: of its own run, or else of the tracker that serves all."""
    several = rows_of(ROOT / "runs" / "six-tasks")
    own = {task: rows_of(ROOT / "runs" / task) for task in TASKS}
    return table_of("best", [row for task in TASKS for row in own[task] or several if row.task == task])


def table_of(name: str, rows: Sequence[EpisodeRow]) -> str:
    """The one table of this name."""
    (table,) = TABLES.get(name).of(Episodes(tuple(rows)))
    return to_markdown(table)


def of_run(folder: Path) -> str:
    """The table of one run: of its task, or of the best of several."""
    rows = rows_of(folder)
    return table_of("best" if len({row.task for row in rows}) > 1 else "beside-paper", rows)


def with_table(page: str, name: str, table: str) -> str:
    """A page with the table between the marks of that name; the page as it is without such marks."""
    begin, end = f"<!-- {name} -->\n", f"<!-- /{name} -->"
    before, found, rest = page.partition(begin)
    return page if not found else before + begin + table + end + rest.partition(end)[2]


def pages() -> dict[Path, str]:
    """Both pages as they ought to be."""
    results = RESULTS.read_text()
    for folder in sorted(path.parent for path in (ROOT / "runs").glob("*/evaluate")):
        results = with_table(results, f"runs/{folder.name}", of_run(folder))
    return {README: with_table(README.read_text(), "results", best()), RESULTS: results}


def main() -> None:
    """Write both."""
    for path, text in pages().items():
        path.write_text(text)


if __name__ == "__main__":
    main()
