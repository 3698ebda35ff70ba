"""What a family of objects is: a name, and how each of its objects is made from a number."""

from collections.abc import Callable
from dataclasses import dataclass

from mimicbench.objects.shape import SceneObject


@dataclass(frozen=True)
class Family:
    """Objects of one kind, made by the thousand."""

    name: str
    """The ids of its objects are `<name>-<seed>-<index>`."""
    make: Callable[[int, int], SceneObject]
    """(index, seed) -> object; the same numbers, the same object."""
