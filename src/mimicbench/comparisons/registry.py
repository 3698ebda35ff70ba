"""The comparisons by name."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mimicbench.core.registry import Registry

if TYPE_CHECKING:
    from mimicbench.comparisons.spec import Comparison

COMPARISONS: Registry[Comparison] = Registry(
    what="comparison",
    package="mimicbench.comparisons",
    attribute="COMPARISON",
    kind="mimicbench.comparisons.spec:Comparison",
    group="mimicbench.comparisons",
    first=("pipelines", "retargeting", "trackers", "learners", "vision", "data-scale"),
)
"""Those of the paper's tables first, in its order."""
