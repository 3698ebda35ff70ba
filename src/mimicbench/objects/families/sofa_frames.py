"""Sofas whose wood is seen: settees, futons, benches and daybeds."""

import numpy as np

from mimicbench.objects.families.draws import shade
from mimicbench.objects.families.joinery import GROOVE, SEAM, cushions, feet, lean
from mimicbench.objects.families.parts import Parts
from mimicbench.objects.families.sofa_shape import Area, SofaShape, fit_back


def framed(parts: Parts, shape: SofaShape) -> Area:
    """A wooden frame with cushions: settee or futon."""
    half_length, front, height = shape.length / 2, shape.width / 2, shape.seat_height
    angle, rear = fit_back(shape, shape.width, 0.0)
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
    _framed_back(parts, shape, foot, angle, inner)
    return rear, front, -inner, inner


def _framed_back(parts: Parts, shape: SofaShape, foot: np.ndarray, angle: float, inner: float) -> None:
    """What is between the posts of a back that meets the seat at `foot` (3,) [m]: a top rail, with rails or cushions
    as far as `inner` to both sides.
    """
    half_length, post = shape.length / 2, shape.arm_width
    thick = shape.back_cushion + shape.back_thickness
    top = (shape.height - shape.seat_height) / np.cos(angle)
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


def bench(parts: Parts, shape: SofaShape) -> Area:
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


def daybed(parts: Parts, shape: SofaShape) -> Area:
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
