"""A named part of a goal: what kind of numbers it has, and how well it can be seen."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

Kind = Literal["place", "direction", "point", "scalar"]
SIZES: Mapping[Kind, int] = {"place": 2, "direction": 2, "point": 3, "scalar": 1}
"""Numbers of a field: x, y of a place [m]; sine and cosine of a direction; x, y and height of a point [m]; one length
[m], which no motion changes."""
FREE: Mapping[Kind, int] = {"place": 2, "direction": 1, "point": 3, "scalar": 1}
"""Numbers in which perception can err."""


@dataclass(frozen=True)
class Field:
    """One named part of a goal."""

    name: str
    kind: Kind
    noise: float
    """Deviation of perception's errors, drawn once an episode in training [m], of a direction [rad]."""
    spread: float
    """Of a network's output, so that its own numbers are near 1, and its loss weighs the fields alike."""
    middle: float = 0.0
    """Of a scalar's outputs [m]; places and points are relative to the window that the network looks at."""
