"""Success of the policies by the size of objects."""

from mimicbench.report.sizes import of_policies
from mimicbench.report.table import Table
from mimicbench.report.tables.spec import Episodes, TableSpec


def _make(episodes: Episodes) -> list[Table]:
    rows = [
        (policy, f"{size}, {part.low:.2f} to {part.high:.2f} m", part.kinematic, part.stays)
        for policy, found in of_policies(episodes).items()
        for size, parts in found.items()
        for part in parts
    ]
    columns = ("Policy", "Objects of", "K", "Stays")
    return [Table("sizes", "Success by the size of objects", columns, tuple(rows))] if rows else []


TABLE = TableSpec("sizes", "success by length, width and height of objects, policy by policy", _make)
