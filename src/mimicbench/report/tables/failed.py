"""The episodes that failed, one by one."""

from mimicbench.evaluate.failures import failure
from mimicbench.report.grouping import label
from mimicbench.report.table import Table
from mimicbench.report.tables.spec import Episodes, TableSpec


def _make(episodes: Episodes) -> list[Table]:
    columns = ("Policy", "Episode", "Object", "Kind", "Reference", "How", "From the object at the end [m]")
    body = [
        (
            label(row),
            row.id,
            row.object_id,
            row.object_kind,
            row.reference_id or None,
            f"{failure(row)}: {row.error}" if row.error else failure(row),
            round(row.end_distance, 2),
        )
        for row in episodes.ordered
        if failure(row)
    ]
    return [Table("failed", "The episodes that failed", columns, tuple(body))]


TABLE = TableSpec("failed", "the episodes that failed, one by one", _make)
