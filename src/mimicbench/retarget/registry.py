"""The retargeting methods by name: the paper's three (section 4.1) and our own."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mimicbench.core.registry import Registry

if TYPE_CHECKING:
    from mimicbench.retarget.method import Method

DEFAULT_METHOD = "interaction"
"""Where nobody names another."""
METHODS: Registry[Method] = Registry(
    what="retargeting method",
    package="mimicbench.retarget.methods",
    attribute="METHOD",
    kind="mimicbench.retarget.method:Method",
    group="mimicbench.retargeting",
    first=("copy-rotation", "omnih2o", "optimization", "interaction"),
)
