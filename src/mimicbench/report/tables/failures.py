"""How each method fails, counted."""

from mimicbench.evaluate.failures import FAILURES
from mimicbench.report.grouping import failures, label
from mimicbench.report.table import Table
from mimicbench.report.tables.spec import Episodes, TableSpec


def _make(episodes: Episodes) -> list[Table]:
    body = tuple((label(s), *failures(rows).values()) for s, rows in episodes.methods)
    return [Table("failures", "How episodes fail", ("Policy", *FAILURES), body, note="Shares of all episodes.")]


TABLE = TableSpec("failures", "how the episodes of every method fail, counted", _make)
