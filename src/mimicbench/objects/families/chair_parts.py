"""What a chair is built from, and the boxes of dining chairs and armchairs, of stools, and of easy chairs."""

from dataclasses import dataclass

import numpy as np

from mimicbench.objects.families.draws import FABRICS, WOODS
from mimicbench.objects.families.parts import Color, Parts

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


def framed(parts: Parts, shape: ChairShape) -> tuple[float, float]:
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


def stool(parts: Parts, shape: ChairShape) -> tuple[float, float]:
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


def easy(parts: Parts, shape: ChairShape) -> tuple[float, float]:
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
