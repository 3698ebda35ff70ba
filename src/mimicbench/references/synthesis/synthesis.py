"""What makes a task's human clips."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from mimicbench.core.motion import HumanMotion
from mimicbench.objects.shape import SceneObject
from mimicbench.references.locomotion.course import Course


@dataclass(frozen=True)
class Synthesis:
    """How people do a task, as far as it can be made."""

    name: str
    """The task's."""
    make: Callable[..., HumanMotion]
    """(clip id, object, seed) -> clip; where people can be alike, a fourth argument says whether they are to be."""
    style: type | None = None
    """Dataclass of the choices that are stored with a clip; None if nobody is to plan anew by them."""
    find: Callable[[SceneObject, Any, np.ndarray], tuple[Course, ...]] | None = None
    """(object, style, (2, 3) goals of the wrists [m] or none) -> ways to do the task, to plan it from anywhere."""
    wrist_goals: bool = False
    """Whether the ways depend on goals of the wrists."""
    alike: bool = False
    """Whether people can all do it in one style (`manner`)."""
