"""The trackers by name."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mimicbench.core.registry import Registry

if TYPE_CHECKING:
    from mimicbench.track.spec import TrackerSpec

TRACKERS: Registry[TrackerSpec] = Registry(
    what="tracker",
    package="mimicbench.track.trackers",
    attribute="TRACKER",
    kind="mimicbench.track.spec:TrackerSpec",
    group="mimicbench.trackers",
    first=("residual", "hst", "phc", "hst-original"),
)
