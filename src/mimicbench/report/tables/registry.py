"""The tables by name."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mimicbench.core.registry import Registry

if TYPE_CHECKING:
    from mimicbench.report.tables.spec import TableSpec

TABLES: Registry[TableSpec] = Registry(
    what="table",
    package="mimicbench.report.tables",
    attribute="TABLE",
    kind="mimicbench.report.tables.spec:TableSpec",
    group="mimicbench.tables",
    first=("best", "beside-paper", "results", "energy", "failures", "failed", "breakdown", "sizes"),
)
HEADLINES = ("best", "beside-paper")
"""What is printed where nobody names others."""
