"""What a bed is built from."""

from dataclasses import dataclass

from mimicbench.objects.families.draws import WOODS
from mimicbench.objects.families.parts import Color

MIN_MATTRESS = (1.70, 0.78)
"""Length and width [m]."""
BEDDING: tuple[Color, ...] = (
    (0.55, 0.63, 0.72),
    (0.80, 0.76, 0.68),
    (0.62, 0.68, 0.58),
    (0.78, 0.62, 0.56),
    (0.38, 0.44, 0.55),
    (0.86, 0.84, 0.80),
    (0.58, 0.52, 0.60),
)


@dataclass(frozen=True)
class BedShape:
    """What a bed is built from. Lengths in metres."""

    kind: str
    length: float
    """Head to foot, over everything (x)."""
    width: float
    height: float
    """Over everything but pillows."""
    seat_height: float
    """Of the plane to lie on."""
    mattress: float = 0.22
    """Its thickness."""
    margin: float = 0.04
    """From the edge of the bed to the mattress, at the sides."""
    headboard: float = 0.05
    """Its thickness."""
    foot_height: float = 0.15
    """Of the footboard, above the plane to lie on."""
    bench: float = 0.0
    """Depth of the bench at the foot."""
    table: float = 0.0
    """Width of a table at each side of the head."""
    canopy: bool = False
    pillow: float = 0.04
    """How high the pillows rise above the plane, 0 for none."""
    side: int = 1
    """In a bed for two, who lies on it does so at the left (+1) or the right (-1)."""
    wood: Color = WOODS[0]
    fabric: Color = BEDDING[0]
