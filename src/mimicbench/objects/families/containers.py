"""Makers of things that hold things: crates, cartons, bins, plant pots, suitcases, serving trolleys.

Fronts look to +x.
"""

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.objects.families.draws import shade
from mimicbench.objects.families.furnishing import DARK, Draft, Furnishing


def crate(parts: Furnishing, draft: Draft, random: np.random.Generator) -> None:
    """An open crate: boards with gaps between four corner posts."""
    x, y, h = draft.length / 2, draft.width / 2, draft.height
    board = 0.016
    wood = draft.wood
    parts.box((-x + board, x - board), (-y + board, y - board), (0.0, 0.02), shade(wood, 0.8))
    post = 0.04
    for sx in (-1, 1):
        for sy in (-1, 1):
            inner = (sx * (x - board - post), sx * (x - board)), (sy * (y - board - post), sy * (y - board))
            spans = [(min(span), max(span)) for span in inner]
            parts.box(spans[0], spans[1], (0.02, h - 0.01), shade(wood, 0.85))
    # two rows of boards, and a wide one in front and behind at the bottom
    for low, high in ((0.0, 0.40 * h), (0.48 * h, h)):
        for side in (-1, 1):
            outer, inner = side * y, side * (y - board)
            parts.box((-x + board, x - board), (min(outer, inner), max(outer, inner)), (low, high), wood)
            parts.touch("right" if side > 0 else "left", *(("top",) if low else ()))
    for side in (-1, 1):
        for low, high in ((0.0, 0.40 * h), (0.48 * h, h)):
            outer, inner = side * x, side * (x - board)
            parts.box((min(outer, inner), max(outer, inner)), (-y, y), (low, high), shade(wood, 1.06))
            if side > 0:
                parts.touch("front", *(("top",) if low else ()))


def tote(parts: Furnishing, draft: Draft, random: np.random.Generator) -> None:
    """A plastic storage box with a lid and two grips."""
    x, y, h = draft.length / 2, draft.width / 2, draft.height
    color = draft.paint
    lid = shade(color, 0.7) if random.uniform() < 0.5 else (0.88, 0.88, 0.86)
    grip = 0.03
    foot = 0.9
    parts.box((-foot * x + 0.02, foot * x - 0.02), (-foot * y + grip, foot * y - grip), (0.0, 0.3 * h), color)
    parts.box((-0.95 * x + 0.01, 0.95 * x - 0.01), (-0.95 * y + grip, 0.95 * y - grip), (0.3 * h, 0.65 * h), color)
    parts.touch("front", "left", "right")
    parts.box((-x + 0.012, x - 0.012), (-y + grip, y - grip), (0.65 * h, h - 0.045), color)
    parts.touch("front", "left", "right")
    parts.box((-x, x), (-y + grip - 0.012, y - grip + 0.012), (h - 0.045, h - 0.012), lid)
    parts.touch("front", "left", "right", "top")
    parts.box((-x + 0.05, x - 0.05), (-y + grip + 0.04, y - grip - 0.04), (h - 0.012, h), lid)
    parts.touch("top")
    for side in (-1, 1):
        outer, inner = side * y, side * (y - grip)
        parts.box((-0.09, 0.09), (min(outer, inner), max(outer, inner)), (h - 0.12, h - 0.045), shade(lid, 0.9))
        parts.touch("right" if side > 0 else "left")


def carton(parts: Furnishing, draft: Draft, random: np.random.Generator) -> None:
    """A cardboard box, open, its flaps folded outward."""
    brown = shade((0.76, 0.60, 0.42), float(random.uniform(0.85, 1.08)))
    angle = random.uniform(0.85, 1.15)  # of the flaps to the vertical
    flap = min(0.17 * draft.width, 0.12)
    out, rise = flap * np.sin(angle), flap * np.cos(angle)
    x, y, wall = draft.length / 2 - out, draft.width / 2 - out, draft.height - rise
    thick = 0.012
    inside = shade(brown, 0.7)
    parts.box((-x + thick, x - thick), (-y + thick, y - thick), (0.0, 0.015), inside)
    for side in (-1, 1):
        outer, inner = side * x, side * (x - thick)
        parts.box((min(outer, inner), max(outer, inner)), (-y, y), (0.0, wall), brown)
        if side > 0:
            parts.touch("front")
        outer, inner = side * y, side * (y - thick)
        parts.box((-x + thick, x - thick), (min(outer, inner), max(outer, inner)), (0.0, wall), brown)
        parts.touch("right" if side > 0 else "left")
        half = np.array([thick / 3, 0.0, flap / 2])
        for turn, reach, across in ((0.0, x, y), (np.pi / 2, y, x)):
            yaw = rot.from_yaw(np.array(turn + (0.0 if side > 0 else np.pi)))
            tilt = np.array([np.cos(angle / 2), 0.0, np.sin(angle / 2), 0.0])
            place = rot.rotate(yaw, np.array([reach - thick / 2 + out / 2, 0.0, wall - thick / 3 + rise / 2]))
            parts.add(place, half + np.array([0.0, across - 0.01, 0.0]), shade(brown, 1.05), rot.multiply(yaw, tilt))
            if turn or side > 0:
                parts.touch("front" if not turn else "right" if side > 0 else "left")
    parts.box((x, x + 0.001), (-0.4 * y, 0.1 * y), (0.35 * wall, 0.65 * wall), (0.93, 0.93, 0.90))
    parts.box((x, x + 0.001), (-0.025, 0.025), (0.0, 0.22 * wall), shade(brown, 0.8))


def bin_(parts: Furnishing, draft: Draft, random: np.random.Generator) -> None:
    """A waste bin or laundry bin: eight walls, open or with a lid, perhaps with a pedal."""
    x, y, h = draft.length / 2, draft.width / 2, draft.height
    radius = (x + y) / 2
    color = draft.metal if random.uniform() < 0.5 else draft.paint
    closed = random.uniform() < 0.5
    if closed:
        parts.prism((0, 0, 0.02), radius, 0.02, DARK)
        parts.prism((0, 0, 0.04 + (h - 0.16) / 2), 0.97 * radius, (h - 0.16) / 2, color, touch=("around",))
        parts.prism((0, 0, h - 0.08), radius, 0.04, shade(DARK, 1.5), touch=("around",))
        parts.box((-0.55 * radius, 0.55 * radius), (-0.55 * radius, 0.55 * radius), (h - 0.04, h), shade(DARK, 1.9))
        parts.touch("top")
        parts.box((0.5 * radius, radius + 0.05), (-0.05, 0.05), (0.012, 0.03), shade(DARK, 2.2))
        return
    parts.wall((0, 0, 0), (0.78 * radius, radius), h, 0.014, color)
    parts.prism((0, 0, 0.015), 0.74 * radius, 0.015, shade(color, 0.6))


def plant(parts: Furnishing, draft: Draft, random: np.random.Generator) -> None:
    """A pot with a rim, and a plant of long leaves in it."""
    x, y, h = draft.length / 2, draft.width / 2, draft.height
    radius = (x + y) / 2
    pot = float(np.clip(0.5 * h, 0.3, 0.5))
    color = draft.paint if random.uniform() < 0.6 else (0.72, 0.40, 0.28)
    parts.prism((0, 0, (pot - 0.06) / 2), 0.86 * radius, (pot - 0.06) / 2, color, touch=("around",))
    parts.prism((0, 0, pot - 0.03), radius, 0.03, shade(color, 1.1), touch=("around",))
    parts.box((-0.6 * radius, 0.6 * radius), (-0.6 * radius, 0.6 * radius), (pot, pot + 0.008), (0.25, 0.18, 0.13))
    green = (0.24, 0.46, 0.22)
    leaves = 7
    start = random.uniform(0, 2 * np.pi)
    for i in range(leaves):
        upright = i == 0
        lean = 0.05 if upright else random.uniform(0.2, 0.5)
        angle = start + i * 2 * np.pi / (leaves - 1)
        long = (h - pot) / np.cos(lean) if upright else random.uniform(0.62, 0.95) * (h - pot)
        long = min(long, 0.75 * radius / np.sin(lean)) if not upright else long - 0.03
        quat = rot.multiply(rot.from_yaw(np.array(angle)), np.array([np.cos(lean / 2), 0.0, np.sin(lean / 2), 0.0]))
        middle = np.array([0.0, 0.0, pot]) + rot.rotate(quat, np.array([0.0, 0.0, long / 2]))
        wide = min(0.03 + 0.1 * long, 0.07)
        parts.add(middle, np.array([0.006, wide, long / 2]), shade(green, float(random.uniform(0.75, 1.35))), quat)


def suitcase(parts: Furnishing, draft: Draft, random: np.random.Generator) -> None:
    """A suitcase that stands on its wheels, its handle drawn out; ribs on its front."""
    x, y, h = draft.length / 2, draft.width / 2, draft.height
    top = 0.78 * h
    color = draft.paint
    parts.box((-x, x - 0.01), (-y, y), (0.05, top), color)
    parts.touch("left", "right", "top")
    parts.box((-0.15 * x - 0.008, -0.15 * x + 0.008), (-y - 0.002, y + 0.002), (0.052, top + 0.002), shade(color, 0.45))
    ribs = 4
    for i in range(ribs):
        middle = (-1 + (2 * i + 1) / ribs) * 0.84 * y
        parts.box(
            (x - 0.01, x), (middle - 0.3 * y / ribs, middle + 0.3 * y / ribs), (0.09, top - 0.04), shade(color, 0.88)
        )
        parts.touch("front")
    for sx in (-1, 1):
        parts.box((sx * (x - 0.045) - 0.03, sx * (x - 0.045) + 0.03), (-y + 0.03, -y + 0.075), (0.0, 0.055), DARK)
        parts.box((sx * (x - 0.045) - 0.03, sx * (x - 0.045) + 0.03), (y - 0.075, y - 0.03), (0.0, 0.055), DARK)
    back = -x + 0.05
    wide = min(0.42 * y, 0.11)
    for side in (-1, 1):
        parts.box(
            (back - 0.008, back + 0.008), (side * wide - 0.008, side * wide + 0.008), (top, h - 0.02), draft.metal
        )
    parts.box((back - 0.015, back + 0.015), (-wide - 0.02, wide + 0.02), (h - 0.03, h), DARK)
    parts.touch("front", "top")
    parts.box((0.1 * x, 0.1 * x + 0.03), (-0.09, 0.09), (top, top + 0.028), shade(color, 0.45))


def trolley(parts: Furnishing, draft: Draft, random: np.random.Generator) -> None:
    """A serving trolley on castors: two or three trays between four posts, a push bar in front."""
    x, y, h = draft.length / 2, draft.width / 2, draft.height
    front = x - 0.09
    metal = draft.metal
    tray = draft.paint if random.uniform() < 0.5 else draft.wood
    top = h - 0.06
    for cx in (-x + 0.015, front - 0.015):
        for cy in (-y + 0.015, y - 0.015):
            parts.box((cx - 0.012, cx + 0.012), (cy - 0.012, cy + 0.012), (0.06, top), metal)
            parts.box((cx - 0.025, cx + 0.025), (cy - 0.013, cy + 0.013), (0.0, 0.06), DARK)
    for z in np.linspace(0.13, top - 0.03, 2 if h < 0.6 else 3):
        parts.box((-x, front), (-y, y), (z, z + 0.03), tray)
        parts.touch("front", "left", "right", *(("top",) if z > top - 0.04 else ()))
    for side in (-1, 1):
        parts.box((front - 0.03, x - 0.02), (side * (y - 0.02) - 0.01, side * (y - 0.02) + 0.01), (top, h - 0.0), metal)
    parts.box((x - 0.025, x), (-y + 0.01, y - 0.01), (h - 0.025, h), metal)
    parts.touch("front", "top")
