"""The paper's table of dataset statistics: how many objects and clips each task has, how large and how long."""

from dataclasses import dataclass

Spread = tuple[float, float]
"""Mean and standard deviation."""


@dataclass(frozen=True)
class PaperSet:
    """One row of the table."""

    abbreviation: str
    objects: int
    length: Spread
    """[cm], as width and height."""
    width: Spread
    height: Spread
    clips: int
    duration: Spread
    """[s]"""


PAPER_SETS: dict[str, PaperSet] = {
    "sit-chair": PaperSet("SC", 4600, (57.8, 14.9), (55.6, 15.1), (80.6, 17.6), 5000, (14.8, 0.5)),
    "sit-sofa": PaperSet("SS", 1500, (131.1, 21.1), (63.0, 21.7), (57.3, 21.8), 7600, (12.1, 0.0)),
    "lie-bed": PaperSet("LB", 350, (227.3, 42.7), (177.7, 39.4), (85.7, 27.0), 1600, (24.8, 0.7)),
    "lie-sofa": PaperSet("LS", 1800, (191.2, 28.3), (86.7, 25.2), (78.5, 25.7), 6100, (12.1, 0.0)),
    "touch-points": PaperSet("T", 2300, (59.6, 19.2), (53.2, 16.2), (56.1, 16.7), 2300, (3.3, 0.2)),
    "lift-box": PaperSet("L", 30, (67.3, 6.4), (43.4, 6.2), (88.9, 7.8), 890, (4.3, 0.2)),
}
"""Table "Statistics on human skill references", by task."""
