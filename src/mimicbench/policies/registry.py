"""The kinds of checkpoints that can be judged, by name."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mimicbench.core.registry import Registry

if TYPE_CHECKING:
    from mimicbench.policies.loader import Loader

LOADERS: Registry[Loader] = Registry(
    what="kind of policy",
    package="mimicbench.policies",
    attribute="LOADER",
    kind="mimicbench.policies.loader:Loader",
    group="mimicbench.policies",
)
"""One module of this package each, or an entry point of somebody else's."""
