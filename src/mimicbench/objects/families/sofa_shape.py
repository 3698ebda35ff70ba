"""What a sofa is built from, and what all kinds of sofas share: their support, and the angle of their back."""

from dataclasses import dataclass

import numpy as np

from mimicbench.objects.families.draws import FABRICS, WOODS, shade
from mimicbench.objects.families.joinery import feet
from mimicbench.objects.families.parts import Color, Parts

MIN_SEAT_DEPTH = 0.38
"""[m]"""
MIN_LYING_DEPTH = 0.48
"""Of the seat of a couch [m]."""
MIN_BETWEEN_ARMS = 0.56
"""[m]"""
HEAD_ROOM = 0.16
"""From the end of the couch's free length to the middle of the head [m]."""
Area = tuple[float, float, float, float]
"""A rectangle seen from above: x from, x to, y from, y to [m]."""


@dataclass(frozen=True)
class SofaShape:
    """What a sofa is built from. Lengths in metres, angles in radians."""

    kind: str
    length: float
    """Its long side, over everything (y)."""
    width: float
    """Front to back, over everything (x)."""
    height: float
    seat_height: float
    seats: int = 2
    """Number of seat cushions."""
    back: str = "cushions"
    """`none`, `cushions`, `panel` or `rails`."""
    back_thickness: float = 0.12
    back_cushion: float = 0.14
    recline: float = 0.12
    """Angle of the back to the vertical, as far as the width allows it."""
    arms: tuple[bool, bool] = (True, True)
    """Whether there is an arm at the right (-y) and at the left (+y)."""
    arm_width: float = 0.14
    arm_height: float = 0.18
    """Above the seat."""
    cushion: float = 0.13
    """Thickness of the seat cushions."""
    feet: float = 0.08
    """Their height."""
    plinth: bool = False
    """One set-back base in place of feet."""
    chaise: float = 0.0
    """Width (y) of the part of a sectional that reaches to the front; the rest is `run` deep."""
    run: float = 0.0
    """Front to back of the part of a sectional that is not the chaise."""
    head: int = 0
    """Who lies has the head at the left (+1) or right (-1) end; 0 for sofas to sit on."""
    pillow: float = 0.0
    """Thickness of the pillow at that end, 0 for none."""
    wood: Color = WOODS[0]
    fabric: Color = FABRICS[0]
    accent: Color = FABRICS[1]
    """Of the pillow."""


def support(parts: Parts, shape: SofaShape, x: tuple[float, float], y: tuple[float, float]) -> None:
    """Feet or a plinth below a body that fills this rectangle."""
    if shape.plinth:
        parts.box(
            (x[0] + 0.04, x[1] - 0.04), (y[0] + 0.04, y[1] - 0.04), (0.0, shape.feet + 0.01), shade(shape.wood, 0.6)
        )
    else:
        feet(parts, (x[0] + 0.03, x[1] - 0.03), (y[0] + 0.03, y[1] - 0.03), shape.feet + 0.01, 0.05, shape.wood)


def fit_back(shape: SofaShape, depth: float, lower: float) -> tuple[float, float]:
    """Angle of the back, and x where its front meets the seat, such that a back whose frame ends `lower` below its
    cushions fills the width.
    """
    rise = shape.height - shape.seat_height
    thick = shape.back_cushion + shape.back_thickness
    needed = MIN_LYING_DEPTH if shape.head else MIN_SEAT_DEPTH
    angle = float(min(shape.recline, np.arctan2(max(depth - thick - needed - 0.02, 0.0), rise)))
    top = rise / np.cos(angle)
    behind = max(
        (top - lower) * np.sin(angle) + thick * np.cos(angle), top * np.sin(angle) + shape.back_cushion * np.cos(angle)
    )
    return angle, -shape.width / 2 + behind
