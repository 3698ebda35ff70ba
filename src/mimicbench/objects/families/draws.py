"""How sizes and colors of furniture are drawn."""

from dataclasses import dataclass

import numpy as np

from mimicbench.objects.families.parts import Color

Range = tuple[float, float, float, float]
"""A truncated normal distribution: mean, deviation, least, most [m]."""

WOODS: tuple[Color, ...] = (
    (0.72, 0.53, 0.33),
    (0.55, 0.35, 0.20),
    (0.36, 0.23, 0.15),
    (0.83, 0.70, 0.50),
    (0.20, 0.18, 0.17),
    (0.90, 0.88, 0.84),
)
FABRICS: tuple[Color, ...] = (
    (0.55, 0.60, 0.63),
    (0.25, 0.36, 0.45),
    (0.64, 0.34, 0.26),
    (0.44, 0.50, 0.36),
    (0.80, 0.73, 0.62),
    (0.78, 0.60, 0.28),
    (0.33, 0.31, 0.36),
)


@dataclass(frozen=True)
class SizeDistribution:
    """Where the sizes of one kind of furniture come from."""

    share: float
    """Part of the family that is of this kind."""
    length: Range
    width: Range
    height: Range
    """Of the whole; without back or headboard it is the height of the seat, and this is not used."""
    seat: Range
    """Height of the surface to sit or lie on."""


def truncated(random: np.random.Generator, distribution: Range, scale: float) -> float:
    """Draw from N(mean, deviation) within limits.

    A third of the variance is shared by all sides, which is `scale` ~ N(0, 1).
    """
    mean, deviation, least, most = distribution
    value = mean
    for _ in range(20):
        value = mean + deviation * (np.sqrt(1 / 3) * scale + np.sqrt(2 / 3) * random.standard_normal())
        if least <= value <= most:
            return float(value)
    return float(np.clip(value, least, most))


def tint(random: np.random.Generator, palette: tuple[Color, ...]) -> Color:
    """A color of the palette, a little lighter or darker."""
    r, g, b = np.clip(np.array(palette[random.integers(len(palette))]) * random.uniform(0.88, 1.1), 0, 1)
    return float(r), float(g), float(b)


def shade(color: Color, factor: float) -> Color:
    """The color, darker (factor below 1) or lighter."""
    r, g, b = (min(factor * value, 1.0) for value in color)
    return r, g, b
