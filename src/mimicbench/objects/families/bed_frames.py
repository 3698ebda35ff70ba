"""What a bed is built from, and all of it but mattress and bedding, for each kind."""

from dataclasses import dataclass

import numpy as np

from mimicbench.objects.families.draws import WOODS, shade
from mimicbench.objects.families.joinery import feet, lean, roll
from mimicbench.objects.families.parts import Color, Parts

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


def build_frame(parts: Parts, shape: BedShape, half_width: float) -> tuple[float, float]:
    """Everything but mattress and bedding. Returns the x of the mattress's head and foot."""
    builders = {"platform": _platform, "storage": _storage, "sleigh": _sleigh, "poster": _posts, "panel": _posts}
    return builders.get(shape.kind, _headboard)(parts, shape, half_width)


def _rails(parts: Parts, shape: BedShape, x: tuple[float, float], half_width: float, low: float) -> None:
    """The frame that the mattress lies in."""
    parts.box(x, (-half_width, half_width), (low, shape.seat_height - 0.75 * shape.mattress), shape.wood)


def _platform(parts: Parts, shape: BedShape, half_width: float) -> tuple[float, float]:
    """A low slab, wider than the mattress, over a base that is set back."""
    half_length, board = shape.length / 2, shape.seat_height - shape.mattress
    parts.box((-half_length, half_length), (-half_width, half_width), (board - 0.06, board + 0.02), shape.wood)
    inset = 0.12
    parts.box(
        (-half_length + inset, half_length - inset),
        (-half_width + inset, half_width - inset),
        (0.0, board - 0.05),
        shade(shape.wood, 0.7),
    )
    margin = min(shape.margin, (shape.length - MIN_MATTRESS[0]) / 2, 0.15)
    return -half_length + margin, half_length - margin


def _storage(parts: Parts, shape: BedShape, half_width: float) -> tuple[float, float]:
    """A box with drawers and a padded headboard."""
    half_length = shape.length / 2
    head, foot = -half_length + shape.headboard + 0.02, half_length - 0.01
    board = shape.seat_height - 0.75 * shape.mattress
    parts.box((head - 0.03, foot + 0.01), (-half_width + 0.012, half_width - 0.012), (0.0, board), shape.wood)
    middle = (head + foot) / 2
    for x in ((head + 0.05, middle - 0.01), (middle + 0.01, foot - 0.03)):
        for side in (-1, 1):
            y = (min(side * half_width, side * (half_width - 0.03)), max(side * half_width, side * (half_width - 0.03)))
            parts.box(x, y, (0.05, board - 0.03), shade(shape.wood, 1.12))
    _padded(parts, shape, half_width)
    return head, foot


def _padded(parts: Parts, shape: BedShape, half_width: float) -> None:
    """A headboard of two or four cushions."""
    rear, top = -shape.length / 2, shape.height
    panels = 4 if half_width > 0.65 else 2
    parts.box(
        (rear, rear + 0.6 * shape.headboard), (-half_width, half_width), (0.0, top - 0.012), shade(shape.fabric, 0.7)
    )
    edges = np.linspace(-half_width, half_width, panels + 1)
    for a, b in zip(edges[:-1], edges[1:], strict=True):
        parts.box(
            (rear + 0.01, rear + shape.headboard + 0.02),
            (a + 0.004, b - 0.004),
            (shape.seat_height - 0.25, top),
            shade(shape.fabric, 0.8),
        )


def _headboard(parts: Parts, shape: BedShape, half_width: float) -> tuple[float, float]:
    """A frame on feet below a headboard; perhaps a bench at the foot, or tables beside the head."""
    half_length, height = shape.length / 2, shape.seat_height
    # the mattress begins where the lid of the headboard ends
    head, foot = -half_length + shape.headboard + 0.012, half_length - shape.bench - 0.015
    low = 0.13
    _rails(parts, shape, (head - 0.03, foot + 0.015), half_width, low)
    feet(parts, (head + 0.05, foot - 0.02), (-half_width + 0.02, half_width - 0.02), low + 0.01, 0.07, shape.wood)
    outer = shape.width / 2
    if shape.headboard > 0.2:  # a bookcase: a body, and a lid that sticks out a little
        parts.box(
            (-half_length + 0.01, head - 0.012), (-outer + 0.01, outer - 0.01), (0.0, shape.height - 0.03), shape.wood
        )
        parts.box((-half_length, head), (-outer, outer), (shape.height - 0.035, shape.height), shade(shape.wood, 1.12))
    else:
        parts.box(
            (-half_length, head - 0.012),
            (-outer, outer),
            (0.0 if shape.table else 0.10, shape.height - 0.03),
            shape.wood,
        )
        parts.box((-half_length, head), (-outer, outer), (shape.height - 0.06, shape.height), shade(shape.wood, 1.12))
    if shape.bench:
        y, top = 0.42 * shape.width, min(0.9 * height, 0.46)
        parts.box((foot + 0.005, half_length), (-y, y), (top - 0.10, top), shade(shape.fabric, 0.75))
        for side in (-1, 1):
            legs = (min(side * (y - 0.02), side * (y - 0.08)), max(side * (y - 0.02), side * (y - 0.08)))
            parts.box((foot + 0.006, half_length - 0.03), legs, (0.0, top - 0.09), shape.wood)
    if shape.table:
        depth, top = min(0.42, 0.9 * shape.table), min(height + 0.03, 0.6)
        for side in (-1, 1):
            y = (min(side * (half_width + 0.03), side * outer), max(side * (half_width + 0.03), side * outer))
            parts.box((head - 0.02, head + depth), y, (0.06, top), shape.wood)
            parts.box(
                (head, head + depth + 0.015),
                (y[0] + 0.02, y[1] - 0.02),
                (0.5 * top, top - 0.04),
                shade(shape.wood, 1.12),
            )
    return head, foot


def _posts(parts: Parts, shape: BedShape, half_width: float) -> tuple[float, float]:
    """Head and foot between posts; tall ones carry a canopy."""
    half_length, height = shape.length / 2, shape.seat_height
    post = 0.07
    head, foot = -half_length + post, half_length - post
    low = 0.16
    _rails(parts, shape, (head - 0.02, foot + 0.02), half_width - 0.01, low)
    tall = shape.kind == "poster"
    board = min(shape.height - 0.04, height + 0.55) if tall else shape.height - 0.04
    foot_top = height + shape.foot_height
    for end, top, panel in ((-1, shape.height, board), (1, shape.height if tall else foot_top, foot_top - 0.03)):
        x = (-half_length, head) if end < 0 else (foot, half_length)
        for side in (-1, 1):
            y = (min(side * half_width, side * (half_width - post)), max(side * half_width, side * (half_width - post)))
            parts.box(x, y, (0.0, top), shape.wood)
        parts.box(
            (x[0] + 0.015, x[1] - 0.015), (-half_width + 0.02, half_width - 0.02), (low, panel), shade(shape.wood, 1.08)
        )
    if shape.canopy:
        z = (shape.height - 0.055, shape.height - 0.005)
        for end in (-1, 1):
            x = (-half_length + 0.01, head - 0.01) if end < 0 else (foot + 0.01, half_length - 0.01)
            parts.box(x, (-half_width + 0.02, half_width - 0.02), z, shape.wood)
            y = (
                min(end * (half_width - 0.01), end * (half_width - 0.06)),
                max(end * (half_width - 0.01), end * (half_width - 0.06)),
            )
            parts.box((head - 0.03, foot + 0.03), y, z, shape.wood)
    return head, foot


def _sleigh(parts: Parts, shape: BedShape, half_width: float) -> tuple[float, float]:
    """Head and foot lean outwards and end in a roll."""
    half_length, height = shape.length / 2, shape.seat_height
    thick, radius, low = 0.05, 0.06, 0.10
    free = shape.length - MIN_MATTRESS[0] - 2 * (radius + thick) - 0.02
    ends = []
    rises = shape.height - height, max(0.55 * (shape.height - height), 0.16)
    angle = float(min(0.30, np.arctan2(max(free, 0.0), sum(rises))))
    for end, rise in zip((-1, 1), rises, strict=True):
        up = (rise - radius + thick / 2 * np.sin(angle)) / np.cos(angle)
        x = half_length - radius - thick / 2 * np.cos(angle) - up * np.sin(angle)
        base = np.array([end * x, 0.0, height])
        facing = 0.0 if end < 0 else np.pi
        lean(parts, base, facing, angle, (-thick, 0.0), (-half_width, half_width), (-0.03, up), shape.wood)
        below = (min(end * x, end * (x + thick)), max(end * x, end * (x + thick)))
        parts.box(below, (-half_width + 0.003, half_width - 0.003), (0.0, height - 0.004), shape.wood)
        quarter = np.array([end * (half_length - radius), 0.0, height + rise - radius])
        roll(parts, quarter, 1, radius, half_width + 0.01, shade(shape.wood, 1.05))
        ends.append(end * min(x, half_length - 2 * radius))  # the roll may overhang the foot of its board
    _rails(parts, shape, (ends[0] - 0.045, ends[1] + 0.045), half_width - 0.012, low)
    return ends[0], ends[1]
