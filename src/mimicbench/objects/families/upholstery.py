"""Sofas of all kinds, built of at most SLOTS boxes. Frame: x to where who sits faces, y left, z up, metres.

A sofa's long side is y: who sits on it faces +x, who lies on it lies along y.
"""

from dataclasses import dataclass

import numpy as np

from mimicbench.core.errors import BadObject
from mimicbench.objects.families.draws import FABRICS, WOODS, shade
from mimicbench.objects.families.joinery import GROOVE, SEAM, cushions, feet, lean, roll
from mimicbench.objects.families.parts import Color, Parts
from mimicbench.objects.shape import SceneObject

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


def build_sofa(object_id: str, family: str, shape: SofaShape) -> SceneObject:
    """The sofa of that shape. Raises BadObject if nobody could sit on it."""
    parts = Parts()
    builders = {
        "bench": _bench,
        "ottoman": _ottoman,
        "divan": _ottoman,
        "settee": _framed,
        "futon": _framed,
        "chesterfield": _chesterfield,
        "daybed": _daybed,
        "chaise": _chaise,
    }
    rear, front, right, left = builders.get(shape.kind, _upholstered)(parts, shape)
    needed = MIN_LYING_DEPTH if shape.head else MIN_SEAT_DEPTH
    if front - rear < needed - 1e-9 or left - right < MIN_BETWEEN_ARMS - 1e-9:
        raise BadObject(
            f"sofa {object_id}: a seat of {front - rear:.2f} x {left - right:.2f} m is too small; "
            f"give {needed} x {MIN_BETWEEN_ARMS} m or more"
        )
    head = np.zeros(0)
    if shape.head:
        end = left if shape.head > 0 else right
        head = np.array([(rear + front) / 2, end - shape.head * HEAD_ROOM])
        if shape.pillow:
            half = np.array([min(0.22, (front - rear) / 2 - 0.03), 0.14, (shape.pillow + 0.02) / 2])
            parts.add(np.array([*head, shape.seat_height + shape.pillow - half[2]]), half, shape.accent)
    pos = parts.centered()
    moved = (pos[0] - parts.pos[0])[:2]
    polygon = np.array([[front, right], [front, left], [rear, left], [rear, right]]) + moved
    head = head + moved if shape.head else head
    return SceneObject(
        object_id,
        family,
        shape.kind,
        pos,
        np.array(parts.quat),
        np.array(parts.half),
        np.array(parts.rgb),
        shape.seat_height,
        polygon,
        head,
    )


def _support(parts: Parts, shape: SofaShape, x: tuple[float, float], y: tuple[float, float]) -> None:
    """Feet or a plinth below a body that fills this rectangle."""
    if shape.plinth:
        parts.box(
            (x[0] + 0.04, x[1] - 0.04), (y[0] + 0.04, y[1] - 0.04), (0.0, shape.feet + 0.01), shade(shape.wood, 0.6)
        )
    else:
        feet(parts, (x[0] + 0.03, x[1] - 0.03), (y[0] + 0.03, y[1] - 0.03), shape.feet + 0.01, 0.05, shape.wood)


def _fit_back(shape: SofaShape, depth: float, lower: float) -> tuple[float, float]:
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


def _upholstered(parts: Parts, shape: SofaShape) -> Area:
    """Base, arms, back and cushions, all covered; perhaps with a chaise that reaches to the front."""
    half_length, height = shape.length / 2, shape.seat_height
    depth = shape.run or shape.width
    front = depth - shape.width / 2
    loose = shape.back == "cushions"
    lower = 0.05 if loose else 0.0
    angle, rear = _fit_back(shape, depth, lower)
    thick = shape.back_cushion + shape.back_thickness
    ends = tuple(
        sign * (half_length - (shape.arm_width if arm else 0.0)) for sign, arm in zip((-1, 1), shape.arms, strict=True)
    )
    y = (ends[0], ends[1])
    dark = shade(shape.fabric, 0.84)
    base_y = (y[0] if shape.arms[0] else y[0] + 0.012, y[1] if shape.arms[1] else y[1] - 0.012)
    parts.box((rear - 0.05, front - 0.011), base_y, (shape.feet, height - GROOVE), dark)
    top = (shape.height - height) / np.cos(angle)
    sides = [half_length - (0.5 * shape.arm_width if arm else 0.006) for arm in shape.arms]
    foot = np.array([rear, 0.0, height])
    lean(
        parts,
        foot,
        0.0,
        angle,
        (-thick, -0.9 * shape.back_cushion),
        (-sides[0], sides[1]),
        (-0.7 * (height - shape.feet), top - lower),
        shape.fabric,
    )
    edges = np.linspace(*y, shape.seats + 1)
    if shape.chaise:
        inner = y[0] + shape.chaise if shape.head > 0 else y[1] - shape.chaise
        others = np.linspace(inner, y[1], shape.seats) if shape.head > 0 else np.linspace(y[0], inner, shape.seats)
        edges = np.r_[y[0], others] if shape.head > 0 else np.r_[others, y[1]]
    for i, (a, b) in enumerate(zip(edges[:-1], edges[1:], strict=True)):
        low, high = a + (SEAM if i else 0.0), b - (SEAM if i + 1 < shape.seats else 0.0)
        long = shape.chaise and i == (0 if shape.head > 0 else shape.seats - 1)
        end = shape.width / 2 if long else front
        parts.box((rear - 0.01, end), (low, high), (height - shape.cushion, height), shape.fabric)
        if loose:
            lean(parts, foot, 0.0, angle, (-shape.back_cushion, 0.0), (low, high), (0.0, top), shape.fabric)
        if long:
            parts.box(
                (front - 0.03, end - 0.011),
                (max(low, base_y[0]), min(high, base_y[1])),
                (shape.feet, height - GROOVE),
                dark,
            )
            parts.box(
                (front - 0.08, end - 0.06), (low + 0.04, high - 0.04), (0.0, shape.feet + 0.01), shade(shape.wood, 0.6)
            )
    arm_rear = max(-shape.width / 2, rear - thick * np.cos(angle) - shape.arm_height * np.tan(angle))
    for sign, arm, end in zip((-1, 1), shape.arms, y, strict=True):
        if arm:
            limits = (min(end, sign * half_length), max(end, sign * half_length))
            parts.box((arm_rear, front - 0.018), limits, (shape.feet, height + shape.arm_height), shape.fabric)
    body_y = (-half_length if shape.arms[0] else base_y[0], half_length if shape.arms[1] else base_y[1])
    _support(parts, shape, (arm_rear if all(shape.arms) else rear - 0.05, front - 0.02), body_y)
    return rear, front, *y


def _chesterfield(parts: Parts, shape: SofaShape) -> Area:
    """Rolled arms as high as the rolled back."""
    half_length, half_width, radius = shape.length / 2, shape.width / 2, shape.arm_width / 2
    thin = radius * np.tan(np.pi / 8)
    axis_z = shape.height - radius
    inner = half_length - radius - thin
    rear = -half_width + radius
    parts.box(
        (rear, half_width - 0.011), (-inner, inner), (shape.feet, shape.seat_height - GROOVE), shade(shape.fabric, 0.84)
    )
    cushions(
        parts,
        shape.seats,
        (rear, half_width),
        (-inner, inner),
        (shape.seat_height - shape.cushion, shape.seat_height),
        shape.fabric,
    )
    parts.box((rear - thin, rear + thin), (-inner, inner), (shape.feet, shape.height), shape.fabric)
    roll(parts, np.array([rear, 0.0, axis_z]), 1, radius, half_length - 1.2 * radius, shape.fabric)
    for side in (-1, 1):
        y = side * (half_length - radius)
        parts.box(
            (-half_width + 0.4 * radius, half_width - 0.03),
            (y - thin, y + thin),
            (shape.feet, shape.height),
            shape.fabric,
        )
        roll(
            parts, np.array([0.2 * radius - 0.01, y, axis_z]), 0, radius, half_width - 0.2 * radius - 0.01, shape.fabric
        )
    outer = half_length - radius + thin
    parts.box(
        (rear, half_width - 0.05), (-outer + 0.02, outer - 0.02), (0.0, shape.feet + 0.01), shade(shape.wood, 0.6)
    )
    return -half_width + 2 * radius, half_width, -half_length + 2 * radius, half_length - 2 * radius


def _framed(parts: Parts, shape: SofaShape) -> Area:
    """A wooden frame with cushions: settee or futon."""
    half_length, front, height = shape.length / 2, shape.width / 2, shape.seat_height
    angle, rear = _fit_back(shape, shape.width, 0.0)
    post = shape.arm_width
    board = height - shape.cushion
    with_arms = all(shape.arms)
    inner = half_length - (post if with_arms else 0.0)
    foot = np.array([rear, 0.0, height])
    thick = shape.back_cushion + shape.back_thickness
    top = (shape.height - height) / np.cos(angle)
    parts.box(
        (rear - thick, front - 0.01), (-half_length + 0.008, half_length - 0.008), (board - 0.06, board), shape.wood
    )
    # a single mattress lies on the frame, cushions are set into it
    cushions(parts, shape.seats, (rear - 0.5 * thick, front), (-inner, inner), (board - GROOVE, height), shape.fabric)
    if shape.seats > 1:  # closes the seams below
        parts.box(
            (rear, front - 0.01),
            (-inner + 0.01, inner - 0.01),
            (board - 0.01, height - GROOVE),
            shade(shape.fabric, 0.84),
        )
    arm_top = height + shape.arm_height
    for side in (-1, 1):
        y = (min(side * half_length, side * (half_length - post)), max(side * half_length, side * (half_length - post)))
        parts.box(
            (front - 0.06 - post, front - 0.06), y, (0.0, arm_top - 0.02 if with_arms else board - 0.01), shape.wood
        )
        parts.box((rear - thick, rear - thick + post), y, (0.0, board - 0.01), shape.wood)
        lean(
            parts,
            foot,
            0.0,
            angle,
            (-thick, -thick + max(shape.back_thickness, 0.04)),
            y,
            (-shape.cushion - 0.04, top),
            shape.wood,
        )
        if with_arms:
            parts.box(
                (rear - thick - shape.arm_height * np.tan(angle) + 0.02, front - 0.02),
                y,
                (arm_top - 0.03, arm_top),
                shape.wood,
            )
    wood = (-thick, -thick + 0.8 * shape.back_thickness)
    lean(
        parts, foot, 0.0, angle, wood, (-half_length + post, half_length - post), (top - 0.09, top - 0.006), shape.wood
    )
    if shape.back == "rails":
        pitch = (top - 0.15) / 3
        for i in range(3):
            lean(
                parts,
                foot,
                0.0,
                angle,
                wood,
                (-half_length + post, half_length - post),
                (0.06 + i * pitch, 0.06 + (i + 0.55) * pitch),
                shape.wood,
            )
    else:
        edges = np.linspace(-inner + 0.01, inner - 0.01, shape.seats + 1)
        for a, b in zip(edges[:-1] + SEAM, edges[1:] - SEAM, strict=True):
            lean(
                parts,
                foot,
                0.0,
                angle,
                (-thick + 0.5 * shape.back_thickness, 0.0),
                (a, b),
                (0.0, top - 0.03),
                shape.fabric,
            )
    return rear, front, -inner, inner


def _bench(parts: Parts, shape: SofaShape) -> Area:
    """A padded board on legs."""
    x, y = (-shape.width / 2, shape.width / 2), (-shape.length / 2, shape.length / 2)
    board = shape.seat_height - shape.cushion
    parts.box(
        (x[0] + 0.012, x[1] - 0.012),
        (y[0] + 0.012, y[1] - 0.012),
        (board - 0.05, board + shape.cushion - GROOVE),
        shape.wood,
    )
    cushions(parts, shape.seats, x, y, (board, shape.seat_height), shape.fabric)
    feet(parts, (x[0] + 0.02, x[1] - 0.02), (y[0] + 0.02, y[1] - 0.02), board - 0.04, 0.05, shape.wood)
    if shape.plinth:  # a shelf below
        parts.box(
            (x[0] + 0.03, x[1] - 0.03), (y[0] + 0.03, y[1] - 0.03), (0.3 * board, 0.3 * board + 0.025), shape.wood
        )
    return *x, *y


def _ottoman(parts: Parts, shape: SofaShape) -> Area:
    """An upholstered block without back."""
    x, y = (-shape.width / 2, shape.width / 2), (-shape.length / 2, shape.length / 2)
    inset_x, inset_y = (x[0] + 0.011, x[1] - 0.011), (y[0] + 0.011, y[1] - 0.011)
    parts.box(inset_x, inset_y, (shape.feet, shape.seat_height - GROOVE), shade(shape.fabric, 0.84))
    cushions(parts, shape.seats, x, y, (shape.seat_height - shape.cushion, shape.seat_height), shape.fabric)
    _support(parts, shape, inset_x, inset_y)
    return *x, *y


def _daybed(parts: Parts, shape: SofaShape) -> Area:
    """A mattress in a wooden frame between two ends, the one at the head higher, perhaps with rails behind."""
    half_length, half_width, height = shape.length / 2, shape.width / 2, shape.seat_height
    post = shape.arm_width
    behind = 0.05 if shape.back == "rails" else 0.0
    inner = half_length - post
    board = height - shape.cushion
    parts.box(
        (-half_width + 0.01, half_width - 0.01), (-inner - 0.01, inner + 0.01), (board - 0.09, board + 0.02), shape.wood
    )
    parts.box((-half_width + behind, half_width), (-inner, inner), (board, height), shape.fabric)
    for side in (-1, 1):
        top = shape.height if side * shape.head >= 0 or behind else height + 0.6 * (shape.height - height)
        y = (min(side * half_length, side * inner), max(side * half_length, side * inner))
        for x in (-half_width, half_width - post):
            parts.box((x, x + post), y, (0.0, top), shape.wood)
        panel = (y[0] + 0.2 * post, y[1] - 0.2 * post)
        parts.box((-half_width + 0.5 * post, half_width - 0.5 * post), panel, (board - 0.09, top - 0.025), shape.wood)
    if behind:
        pitch = (shape.height - height) / 3
        for i in range(3):
            low = height + (i + 0.3) * pitch
            parts.box(
                (-half_width + 0.008, -half_width + 0.04),
                (-inner - 0.01, inner + 0.01),
                (low, low + 0.55 * pitch),
                shape.wood,
            )
    return -half_width + behind, half_width, -inner, inner


def _chaise(parts: Parts, shape: SofaShape) -> Area:
    """A couch with one sloping end for the head and half a back."""
    half_length, half_width, height, side = shape.length / 2, shape.width / 2, shape.seat_height, shape.head or 1
    thick = shape.arm_width
    rise = shape.height - height
    slope = min(2.2 * shape.recline, 0.5)
    foot = half_length - rise * np.tan(slope) - thick * np.cos(slope)
    end = foot + 0.8 * thick * np.cos(slope)
    y = (min(side * end, -side * half_length), max(side * end, -side * half_length))
    back = shape.back_thickness if shape.back == "panel" else 0.0
    body_x, body_y = (-half_width + 0.012, half_width - 0.012), (y[0] + 0.012, y[1] - 0.012)
    parts.box(body_x, body_y, (shape.feet, height - GROOVE), shade(shape.fabric, 0.84))
    parts.box((-half_width + back, half_width), y, (height - shape.cushion, height), shape.fabric)
    top = rise / np.cos(slope)
    lean(
        parts,
        np.array([0.0, side * foot, height]),
        -side * np.pi / 2,
        slope,
        (-thick, 0.0),
        (-half_width + 0.005, half_width - 0.005),
        (-shape.cushion, top),
        shape.fabric,
    )
    if back:
        reach = foot - 1.1 * shape.length * 0.55
        ends = (min(side * (foot + 0.3 * thick), side * reach), max(side * (foot + 0.3 * thick), side * reach))
        parts.box((-half_width, -half_width + back), ends, (shape.feet, height + 0.62 * rise), shape.fabric)
    _support(parts, shape, body_x, body_y)
    right, left = (-half_length, foot) if side > 0 else (-foot, half_length)
    return -half_width + back, half_width, right, left
