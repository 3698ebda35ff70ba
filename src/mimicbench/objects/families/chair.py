"""Chairs of four kinds, made of at most SLOTS boxes; every chair follows from a seed and an index.

The sizes are drawn so that a large family has the statistics of the paper's table of objects for sitting on a chair:
length 57.8 +- 14.9 cm, width 55.6 +- 15.1 cm, height 80.6 +- 17.6 cm. Every chair can be sat on: the seat is at least
0.34 m deep and 0.42 m wide, 0.52 m between armrests.
"""

from dataclasses import dataclass

import numpy as np

from mimicbench.core.errors import BadObject
from mimicbench.core.seeds import rng
from mimicbench.objects.families.draws import FABRICS, WOODS, SizeDistribution, tint, truncated
from mimicbench.objects.families.parts import Color, Parts
from mimicbench.objects.family import Family
from mimicbench.objects.shape import SceneObject

KINDS = ("dining", "stool", "armchair", "easy")
MIN_SEAT_DEPTH = 0.34
MIN_SEAT_WIDTH = 0.42
MAX_SEAT_DEPTH = 0.56
"""[m]; of a longer chair, the back leans more or is thicker."""
MIN_BETWEEN_ARMS = 0.52
"""[m]; a robot's two thighs at +-0.2 m need this."""

SIZES = {
    "dining": SizeDistribution(
        0.46,
        (0.505, 0.100, 0.41, 0.72),
        (0.420, 0.045, 0.42, 0.58),
        (0.875, 0.130, 0.66, 1.24),
        (0.450, 0.030, 0.38, 0.54),
    ),
    "stool": SizeDistribution(
        0.13,
        (0.410, 0.060, 0.35, 0.56),
        (0.430, 0.060, 0.42, 0.62),
        (0.455, 0.035, 0.38, 0.54),
        (0.455, 0.035, 0.38, 0.54),
    ),
    "armchair": SizeDistribution(
        0.24,
        (0.570, 0.085, 0.46, 0.80),
        (0.620, 0.050, 0.60, 0.78),
        (0.855, 0.115, 0.70, 1.20),
        (0.440, 0.030, 0.38, 0.52),
    ),
    "easy": SizeDistribution(
        0.17,
        (0.825, 0.115, 0.62, 1.10),
        (0.815, 0.110, 0.70, 1.10),
        (0.800, 0.120, 0.62, 1.10),
        (0.410, 0.025, 0.36, 0.46),
    ),
}


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


def make_chair(index: int, seed: int = 0) -> SceneObject:
    """Chair number `index` of the family that `seed` names."""
    return build_chair(f"chair-{seed}-{index:05d}", draw_shape(rng(seed, "chair", index)))


def draw_shape(random: np.random.Generator, kind: str | None = None) -> ChairShape:
    """Draw one chair of the given kind, or of any."""
    drawn = str(random.choice(KINDS, p=[SIZES[name].share for name in KINDS]))
    kind = kind or drawn
    sizes = SIZES[kind]
    # one scale for the whole chair, and a stretch of each side by itself
    scale = random.standard_normal()
    length, width, height = (truncated(random, side, scale) for side in (sizes.length, sizes.width, sizes.height))
    seat = truncated(random, sizes.seat, 0.0)
    wood = tint(random, WOODS)
    fabric = tint(random, FABRICS)
    upholstered = random.uniform() < 0.4
    back = str(random.choice(["slats", "rails", "panel"], p=[0.4, 0.35, 0.25]))
    most = 3 if kind == "armchair" else 5  # armrests and slats share the box budget
    bars = int(random.integers(3, most + 1) if back == "slats" else random.integers(2, min(most, 4) + 1))
    recline = random.uniform(0.08, 0.26)
    stretchers = bool(random.uniform() < 0.4)
    leg = random.uniform(0.032, 0.05)
    arm_height = random.uniform(0.17, 0.25)
    setback = random.uniform(0.03, 0.12)
    if kind == "stool":
        return ChairShape(
            kind,
            length,
            width,
            seat,
            seat,
            back="none" if random.uniform() < 0.7 else "block",
            leg=leg,
            splay=random.uniform(-0.03, 0.0),
            stretchers=stretchers,
            cushion=0.045 if upholstered else 0.0,
            wood=wood,
            fabric=fabric,
        )
    if kind == "easy":
        rise = max(height - seat, 0.3)
        spare = length - MAX_SEAT_DEPTH - rise * np.tan(recline)
        thickness = max(random.uniform(0.13, 0.18), min(spare, 0.38))
        arm = min(random.uniform(0.09, 0.16), (width - MIN_BETWEEN_ARMS) / 2)
        return ChairShape(
            kind,
            length,
            width,
            max(height, seat + 0.3),
            seat,
            back="panel",
            recline=recline,
            back_thickness=thickness,
            leg=random.uniform(0.04, 0.10),
            cushion=random.uniform(0.10, 0.15),
            arm_width=arm,
            arm_height=random.uniform(0.12, 0.20),
            arm_setback=random.uniform(0.0, 0.05),
            wood=wood,
            fabric=fabric,
        )
    spare = length - MAX_SEAT_DEPTH
    recline = max(recline, min(0.38, np.arctan2(spare, max(height - seat, 0.3))))
    thickness = random.uniform(0.022, 0.035) if back != "panel" else random.uniform(0.025, 0.05)
    arm = min(random.uniform(0.04, 0.06), (width - MIN_BETWEEN_ARMS) / 2) if kind == "armchair" else 0.0
    return ChairShape(
        kind,
        length,
        width,
        max(height, seat + 0.3),
        seat,
        back,
        bars,
        recline,
        thickness,
        leg,
        stretchers=stretchers and kind == "dining",
        cushion=0.04 if upholstered else 0.0,
        arm_width=arm,
        arm_height=arm_height,
        arm_setback=setback,
        wood=wood,
        fabric=fabric,
    )


def build_chair(object_id: str, shape: ChairShape) -> SceneObject:
    """The chair of that shape. Raises BadObject if nobody could sit on it."""
    parts = Parts()
    polygon_x = {"stool": _stool, "easy": _easy}.get(shape.kind, _framed)(parts, shape)
    inside = shape.width - 2 * shape.arm_width
    depth = polygon_x[1] - polygon_x[0]
    needed = MIN_BETWEEN_ARMS if shape.arm_width else MIN_SEAT_WIDTH
    if depth < MIN_SEAT_DEPTH - 1e-9 or inside < needed - 1e-9:
        raise BadObject(
            f"chair {object_id}: a seat of {depth:.2f} x {inside:.2f} m is too small; give "
            f"{MIN_SEAT_DEPTH} x {needed} m or more"
        )
    pos = parts.centered()
    back, front = np.array(polygon_x) + (pos[0] - parts.pos[0])[0]
    polygon = np.array([[front, -inside / 2], [front, inside / 2], [back, inside / 2], [back, -inside / 2]])
    return SceneObject(
        object_id,
        "chair",
        shape.kind,
        pos,
        np.array(parts.quat),
        np.array(parts.half),
        np.array(parts.rgb),
        shape.seat_height,
        polygon,
    )


def _framed(parts: Parts, shape: ChairShape) -> tuple[float, float]:
    """Dining chair or armchair: legs, seat, back, perhaps armrests. Returns where the seat begins and ends in x."""
    front, half_width = shape.length / 2, shape.width / 2
    recline, rear = _fit_back(shape)
    seat_rear = rear - shape.back_thickness
    board = shape.seat_height - shape.cushion
    parts.box((seat_rear, front), (-half_width, half_width), (board - 0.035, board), shape.wood)
    if shape.cushion:
        parts.box(
            (rear, front - 0.01),
            (-half_width + shape.arm_width, half_width - shape.arm_width),
            (board, shape.seat_height),
            shape.fabric,
        )
    _legs(parts, shape, (seat_rear, front), board - 0.02)
    _back(parts, shape, rear, recline)
    if shape.arm_width:
        top = shape.seat_height + shape.arm_height
        tip = front - shape.arm_setback
        arm_rear = rear - shape.arm_height * np.tan(recline) - shape.back_thickness / 2
        for side in (-1, 1):
            outer, inner = side * half_width, side * (half_width - shape.arm_width)
            y = (min(outer, inner), max(outer, inner))
            parts.box((arm_rear, tip), y, (top - 0.03, top), shape.wood)
            parts.box((tip - 0.05, tip - 0.015), y, (board - 0.02, top - 0.02), shape.wood)
    return rear, front - (0.01 if shape.cushion else 0.0)


def _stool(parts: Parts, shape: ChairShape) -> tuple[float, float]:
    """A seat without back: on four legs, or an upholstered block."""
    front, half_width = shape.length / 2, shape.width / 2
    if shape.back == "block":
        parts.box((-front + 0.02, front - 0.02), (-half_width + 0.02, half_width - 0.02), (0.0, 0.05), shape.wood)
        parts.box((-front, front), (-half_width, half_width), (0.05, shape.seat_height - 0.08), shape.fabric)
        parts.box(
            (-front, front), (-half_width, half_width), (shape.seat_height - 0.07, shape.seat_height), shape.fabric
        )
        parts.box(
            (-front + 0.01, front - 0.01),
            (-half_width + 0.01, half_width - 0.01),
            (shape.seat_height - 0.08, shape.seat_height - 0.07),
            shape.wood,
        )
    else:
        board = shape.seat_height - shape.cushion
        parts.box((-front, front), (-half_width, half_width), (board - 0.035, board), shape.wood)
        if shape.cushion:
            parts.box((-front, front), (-half_width, half_width), (board, shape.seat_height), shape.fabric)
        _legs(parts, shape, (-front, front), board - 0.02)
    return -front, front


def _easy(parts: Parts, shape: ChairShape) -> tuple[float, float]:
    """A wide, low chair: solid base on short feet, thick back and arms."""
    front, half_width = shape.length / 2, shape.width / 2
    recline, rear = _fit_back(shape)
    seat_rear = rear - shape.back_thickness
    inner = half_width - shape.arm_width
    board = shape.seat_height - shape.cushion
    dark = tuple(0.85 * value for value in shape.fabric)
    parts.box((seat_rear, front - 0.02), (-inner, inner), (shape.leg, board), (dark[0], dark[1], dark[2]))
    parts.box((rear - 0.01, front), (-inner, inner), (board, shape.seat_height), shape.fabric)
    quat = np.array([np.cos(recline / 2), 0.0, -np.sin(recline / 2), 0.0])
    # the back reaches down into the base, so that no gap opens behind the cushion
    foot = -(shape.seat_height - shape.leg) * 0.5
    top = (shape.height - shape.seat_height) / np.cos(recline)
    center = np.array([rear, 0.0, shape.seat_height]) + _along_back(
        recline, -shape.back_thickness / 2, (foot + top) / 2
    )
    parts.add(
        center,
        np.array([shape.back_thickness / 2, inner + shape.arm_width * 0.6, (top - foot) / 2]),
        shape.fabric,
        quat,
    )
    for side in (-1, 1):
        y = (min(side * inner, side * half_width), max(side * inner, side * half_width))
        parts.box(
            (seat_rear, front - shape.arm_setback), y, (shape.leg, shape.seat_height + shape.arm_height), shape.fabric
        )
        for x in (seat_rear + 0.06, front - shape.arm_setback - 0.06):
            parts.box(
                (x - 0.025, x + 0.025),
                (side * (half_width - 0.05) - 0.025, side * (half_width - 0.05) + 0.025),
                (0.0, shape.leg),
                shape.wood,
            )
    return rear, front


def _fit_back(shape: ChairShape) -> tuple[float, float]:
    """The angle of the back, and the x at which its front face meets the seat, such that the chair has its length."""
    rise = shape.height - shape.seat_height
    free = shape.length - shape.back_thickness - (MIN_SEAT_DEPTH + 0.04)
    recline = float(min(shape.recline, np.arctan2(max(free, 0.0), rise)))
    return recline, -shape.length / 2 + rise * np.tan(recline) + shape.back_thickness * np.cos(recline)


def _along_back(recline: float, out: float, up: float) -> np.ndarray:
    """Offset (3,) from the foot of the back's front face: `out` of the face to the front, `up` along it."""
    return np.array([out * np.cos(recline) - up * np.sin(recline), 0.0, out * np.sin(recline) + up * np.cos(recline)])


def _back(parts: Parts, shape: ChairShape, rear: float, recline: float) -> None:
    """Two posts and a top rail filled with slats, rails or a panel."""
    quat = np.array([np.cos(recline / 2), 0.0, -np.sin(recline / 2), 0.0])
    thickness = shape.back_thickness
    top = (shape.height - shape.seat_height) / np.cos(recline)
    post = max(shape.arm_width, shape.leg)
    inner = shape.width / 2 - post

    def piece(y: tuple[float, float], up: tuple[float, float], depth: float, rgb: Color) -> None:
        center = np.array([rear, sum(y) / 2, shape.seat_height]) + _along_back(recline, -thickness / 2, sum(up) / 2)
        parts.add(center, np.array([depth / 2, (y[1] - y[0]) / 2, (up[1] - up[0]) / 2]), rgb, quat)

    foot = -shape.cushion - 0.03
    for side in (-1, 1):
        piece(
            (side * (inner + post / 2) - post / 2, side * (inner + post / 2) + post / 2),
            (foot, top),
            thickness,
            shape.wood,
        )
    rail = min(0.075, 0.2 * top)
    piece((-inner, inner), (top - rail, top - 0.005), 0.9 * thickness, shape.wood)
    if shape.back == "slats":
        pitch = 2 * inner / shape.bars
        for i in range(shape.bars):
            middle = -inner + (i + 0.5) * pitch
            piece((middle - 0.28 * pitch, middle + 0.28 * pitch), (foot, top - rail), 0.5 * thickness, shape.wood)
    elif shape.back == "rails":
        # level bars from a hand's breadth above the seat up to the top rail
        pitch = (top - rail - 0.06) / shape.bars
        for i in range(shape.bars):
            low = 0.06 + i * pitch
            piece((-inner, inner), (low, low + 0.6 * pitch), 0.6 * thickness, shape.wood)
    else:
        piece((-inner, inner), (0.02, top - rail), 0.9 * thickness, shape.fabric if shape.cushion else shape.wood)


def _legs(parts: Parts, shape: ChairShape, x: tuple[float, float], top: float) -> None:
    """Four legs under the corners of the seat, and perhaps bars between them."""
    inset = shape.leg / 2
    half_width = shape.width / 2 - inset
    lean = -shape.splay
    for end in (x[0] + inset, x[1] - inset):
        sign = 1 if end > sum(x) / 2 else -1
        for side in (-1, 1):
            foot = np.array([end, side * half_width])
            parts.leg(
                np.array([end - sign * 1.5 * lean, side * (half_width - 1.5 * lean), top]), foot, shape.leg, shape.wood
            )
    if shape.stretchers:
        height = 0.3 * top
        reach = half_width - 0.45 * lean
        for side in (-1, 1):
            parts.box(
                (x[0] + inset, x[1] - inset),
                (side * reach - 0.01, side * reach + 0.01),
                (height - 0.015, height + 0.015),
                shape.wood,
            )


FAMILY = Family("chair", make_chair)
