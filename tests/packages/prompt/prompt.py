"""A table of somebody else: how long each method takes until it succeeds. And a comparison: what it is worth to train a
tracker where it fails.
"""

import numpy as np

from mimicbench.comparisons.spec import Comparison, Variant
from mimicbench.report.grouping import label
from mimicbench.report.table import Table
from mimicbench.report.tables.spec import Episodes, TableSpec


def make(episodes: Episodes) -> list[Table]:
    """Quartiles of the times [s] at which K was first fulfilled; who never succeeds has none."""
    rows = []
    for summary, of_one in episodes.methods:
        times = [row.first_success_time for row in of_one if row.first_success_time is not None]
        quartiles = np.percentile(times, (25, 50, 75)).round(2).tolist() if times else (None, None, None)
        rows.append((label(summary), summary.kinematic, *quartiles))
    columns = ("Policy", "K", "A quarter by [s]", "half by [s]", "three quarters by [s]")
    return [Table("time-to-success", "Time to success", columns, tuple(rows), note="Of the episodes that succeed.")]


TABLE = TableSpec("time-to-success", "how long each method takes until it succeeds", make)
COMPARISON = Comparison(
    "focus",
    "a tracker that begins where it fails, always, half of the time, and never",
    "track",
    tuple(Variant(f"{share:.0%}", {"track": {"tracking": {"focus": share}}}) for share in (1.0, 0.5, 0.0)),
)
