"""Sofas of all kinds, built of at most SLOTS boxes. Frame: x to where who sits faces, y left, z up, metres.

A sofa's long side is y: who sits on it faces +x, who lies on it lies along y.
"""

import numpy as np

from mimicbench.core.errors import BadObject
from mimicbench.objects.families.draws import shade
from mimicbench.objects.families.joinery import GROOVE, SEAM, cushions, lean, roll
from mimicbench.objects.families.parts import Parts
from mimicbench.objects.families.sofa_frames import bench, daybed, framed
from mimicbench.objects.families.sofa_shape import (
    HEAD_ROOM,
    MIN_BETWEEN_ARMS,
    MIN_LYING_DEPTH,
    MIN_SEAT_DEPTH,
    Area,
    SofaShape,
    fit_back,
    support,
)
from mimicbench.objects.shape import SceneObject


def build_sofa(object_id: str, family: str, shape: SofaShape) -> SceneObject:
    """The sofa of that shape. Raises BadObject if nobody could sit on it."""
    parts = Parts()
    builders = {
        "bench": bench,
        "ottoman": _ottoman,
        "divan": _ottoman,
        "settee": framed,
        "futon": framed,
        "chesterfield": _chesterfield,
        "daybed": daybed,
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


def _upholstered(parts: Parts, shape: SofaShape) -> Area:
    """Base, arms, back and cushions, all covered; perhaps with a chaise that reaches to the front."""
    half_length, height = shape.length / 2, shape.seat_height
    depth = shape.run or shape.width
    front = depth - shape.width / 2
    loose = shape.back == "cushions"
    lower = 0.05 if loose else 0.0
    angle, rear = fit_back(shape, depth, lower)
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
    support(parts, shape, (arm_rear if all(shape.arms) else rear - 0.05, front - 0.02), body_y)
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


def _ottoman(parts: Parts, shape: SofaShape) -> Area:
    """An upholstered block without back."""
    x, y = (-shape.width / 2, shape.width / 2), (-shape.length / 2, shape.length / 2)
    inset_x, inset_y = (x[0] + 0.011, x[1] - 0.011), (y[0] + 0.011, y[1] - 0.011)
    parts.box(inset_x, inset_y, (shape.feet, shape.seat_height - GROOVE), shade(shape.fabric, 0.84))
    cushions(parts, shape.seats, x, y, (shape.seat_height - shape.cushion, shape.seat_height), shape.fabric)
    support(parts, shape, inset_x, inset_y)
    return *x, *y


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
    support(parts, shape, body_x, body_y)
    right, left = (-half_length, foot) if side > 0 else (-foot, half_length)
    return -half_width + back, half_width, right, left
