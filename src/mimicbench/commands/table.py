"""`mimicbench table`, `table list`: what files of episode rows say."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from mimicbench.commands.options import Form
from mimicbench.core.errors import MimicbenchError
from mimicbench.core.run import to_stderr
from mimicbench.report.tables.registry import HEADLINES, TABLES

if TYPE_CHECKING:
    from mimicbench.evaluate.rows import EpisodeRow


def table(
    files: tyro.conf.Positional[tuple[Path, ...]],
    show: Annotated[tuple[str, ...], tyro.conf.arg(help=f"which tables, of: {', '.join(TABLES)}")] = (),
    form: Form = "terminal",
) -> None:
    """Print tables of the episodes in files of rows (`<workdir>/<task>/evaluate/*.parquet`).

    By default ours beside the paper's, one table per task, and of several tasks the best of each.
    `mimicbench table list` says what each table shows.
    """
    chosen = [TABLES.get(name) for name in show or HEADLINES]
    from mimicbench.evaluate.rows import read_rows
    from mimicbench.report.table import WRITERS
    from mimicbench.report.tables.spec import Episodes

    once = {path.resolve(): path for path in files}.values()
    rows = [(path, row) for path in once for row in read_rows(path)]
    _told_apart(rows)
    episodes = Episodes(tuple(row for _, row in rows))
    several = len(episodes.by_task) > 1
    tables = {spec.name: spec.of(episodes) for spec in chosen if show or several or spec.per_task}
    made = [one for some in tables.values() for one in some]
    if not made:
        raise MimicbenchError(
            f"of these episodes there is nothing to show in: {', '.join(show)}"
            if files and show
            else "give at least one file of episode rows: mimicbench table work/*/evaluate/*.parquet"
        )
    for one in made:
        print(WRITERS[form](one))
    if empty := [name for name, some in tables.items() if show and not any(one.rows for one in some)]:
        to_stderr(f"of these episodes there is nothing to show in: {', '.join(empty)}")


def _told_apart(rows: Sequence[tuple[Path, EpisodeRow]]) -> None:
    """Raise MimicbenchError if an episode of one policy is told of twice: these are two networks of one name."""
    told: dict[tuple[str, ...], Path] = {}
    for path, row in rows:
        other = told.setdefault((row.stage, row.policy, row.preset, row.robot, row.id), path)
        if other is not path:
            raise MimicbenchError(
                f"{other} and {path} both tell of episode {row.id} of {row.policy!r}{_of_what(other, path)}: these are "
                "two runs; give one of them at a time"
            )


def _of_what(one: Path, other: Path) -> str:
    """In what two files differ, as far as they say."""
    from mimicbench.evaluate.rows import rows_made_from

    made = [rows_made_from(path) for path in (one, other)]
    names = sorted({*made[0], *made[1]} - {"episodes"})
    differ = [name for name in names if made[0].get(name) != made[1].get(name)]
    return f", of other {' and '.join(differ)}" if differ else ""


def list_(form: Form = "terminal") -> None:
    """Print which tables there are, ours and those of installed packages, and what each shows."""
    from mimicbench.report.table import WRITERS, Table

    rows = tuple((spec.name, spec.what) for spec in TABLES.all())
    print(WRITERS[form](Table("tables", "Tables: mimicbench table FILES --show NAME", ("Name", "What it shows"), rows)))
