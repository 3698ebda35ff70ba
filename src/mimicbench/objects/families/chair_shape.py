"""What a chair is built from."""

from dataclasses import dataclass

from mimicbench.objects.families.draws import FABRICS, WOODS
from mimicbench.objects.families.parts import Color

MIN_SEAT_DEPTH = 0.34
MIN_SEAT_WIDTH = 0.42
MIN_BETWEEN_ARMS = 0.52
"""[m]; a robot's two thighs at +-0.2 m need this."""


@dataclass(frozen=True)
class ChairShape:
    """What a chair is built from. Lengths in metres, angles in radians."""

    kind: str
    length: float
    """Front to back, over everything."""
    width: float
    height: float
    seat_height: float
    back: str = "slats"
    """`slats` (upright), `rails` (level) or `panel`; dining chairs and armchairs."""
    bars: int = 4
    """Number of slats or rails."""
    recline: float = 0.12
    """Angle of the back to the vertical, as far as the length allows it."""
    back_thickness: float = 0.03
    leg: float = 0.04
    """Thickness of the legs; of an easy chair, their height."""
    splay: float = 0.0
    """How far the feet of a stool stand inside (-) or outside (+) its seat's edge."""
    stretchers: bool = False
    cushion: float = 0.0
    """Thickness of the seat cushion, 0 for none."""
    arm_width: float = 0.0
    arm_height: float = 0.2
    """Of the armrests above the seat."""
    arm_setback: float = 0.08
    """From the front edge of the seat to the front of the armrests."""
    wood: Color = WOODS[0]
    fabric: Color = FABRICS[0]
