"""The robots by name."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mimicbench.core.registry import Registry

if TYPE_CHECKING:
    from mimicbench.robots.description import Robot

DEFAULT_ROBOT = "h1"
"""Where nobody names another."""
ROBOTS: Registry[Robot] = Registry(
    what="robot",
    package="mimicbench.robots",
    attribute="ROBOT",
    kind="mimicbench.robots.description:Robot",
    group="mimicbench.robots",
)
