"""K and P at each of the four energy limits."""

from mimicbench.evaluate.rows import ENERGY_LIMITS
from mimicbench.report.grouping import method_name, stage_name
from mimicbench.report.table import Table
from mimicbench.report.tables.spec import Episodes, TableSpec


def _make(episodes: Episodes) -> list[Table]:
    rows = [(stage_name(s.stage), method_name(s), *s.by_limit) for s in episodes.summaries]
    columns = ("Stage", "Policy", *(f"λ = {limit / 1e6:.0f}e6" for limit in ENERGY_LIMITS))
    note = "P(λ): max over frames of the sum over joints of (τ v)² < λ, in W²."
    return [Table("energy", "K and P at each limit of the energy", columns, tuple(rows), note)]


TABLE = TableSpec("energy", "K and P at each limit of the energy", _make)
