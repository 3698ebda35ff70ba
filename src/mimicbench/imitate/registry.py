"""The learners by name."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mimicbench.core.registry import Registry

if TYPE_CHECKING:
    from mimicbench.imitate.spec import LearnerSpec

LEARNERS: Registry[LearnerSpec] = Registry(
    what="learner",
    package="mimicbench.imitate.learners",
    attribute="LEARNER",
    kind="mimicbench.imitate.spec:LearnerSpec",
    group="mimicbench.learners",
    first=("online", "planner", "act", "bc"),
)
