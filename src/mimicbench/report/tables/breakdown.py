"""K of each method by kind of object, height of the seat and distance of the start."""

from mimicbench.report.grouping import breakdowns, label
from mimicbench.report.table import Table
from mimicbench.report.tables.spec import Episodes, TableSpec


def _make(episodes: Episodes) -> list[Table]:
    body = [
        (label(s), one.title, part, rate)
        for s, rows in episodes.methods
        for one in breakdowns(rows, episodes.rows)
        for part, rate in one.parts.items()
    ]
    return [Table("breakdown", "K over parts of the episodes", ("Policy", "By", "Part", "K"), tuple(body))]


TABLE = TableSpec("breakdown", "K by kind of object, height to sit or lie on, distance of the start", _make)
