"""Makers of household machines: washing machine, fridge, oven, microwave on a trolley, radiator, floor lamp.

Fronts look to +x.
"""

import numpy as np

from mimicbench.objects.families.draws import shade
from mimicbench.objects.families.furnishing import DARK, GLASS, Draft, Furnishing

BULGE = 0.04
"""[m] how far doors and handles stand out of a machine's front."""


def washer(parts: Furnishing, draft: Draft, random: np.random.Generator) -> None:
    """A washing machine: porthole, panel with a knob, detergent drawer."""
    x, y, h = draft.length / 2, draft.width / 2, draft.height
    front = x - BULGE
    panel = h - 0.16 * h
    parts.box((-x, front), (-y, y), (0.0, h - 0.03), draft.white)
    parts.touch("left", "right")
    parts.box((-x, front + 0.008), (-y, y), (h - 0.03, h), shade(draft.white, 0.95))
    parts.touch("front", "top", "left", "right")
    parts.box((front, front + 0.006), (-0.3 * y, y - 0.012), (panel + 0.01, h - 0.04), (0.30, 0.32, 0.35))
    parts.box((front, front + 0.02), (-y + 0.015, -0.34 * y), (panel + 0.01, h - 0.04), shade(draft.white, 0.88))
    parts.touch("front")
    knob = front + 0.006
    parts.prism((knob + 0.012, 0.1 * y, (panel + h - 0.03) / 2), 0.03, 0.012, draft.white, axis=0, corners=6)
    radius = min(0.62 * y, 0.34 * panel)
    low = 0.5 * panel + 0.01
    parts.prism((front + 0.01, 0.0, low), radius, 0.01, (0.62, 0.64, 0.67), axis=0)
    parts.prism((front + 0.02, 0.0, low), 0.74 * radius, 0.012, GLASS, axis=0)
    parts.handle((front + 0.01, x), (0.80 * radius, 0.80 * radius + 0.03), (low - 0.07, low + 0.07), (0.5, 0.52, 0.55))


def fridge(parts: Furnishing, draft: Draft, random: np.random.Generator) -> None:
    """A fridge: one door, or a freezer's small one above; upright handles on one side."""
    x, y, h = draft.length / 2, draft.width / 2, draft.height
    front = x - BULGE
    side = 1 if random.uniform() < 0.5 else -1
    color = draft.white if random.uniform() < 0.7 else draft.paint
    parts.box((-x, front - 0.045), (-y + 0.004, y - 0.004), (0.05, h), shade(color, 0.92))
    parts.touch("top", "left", "right")
    parts.box((-x + 0.03, front - 0.07), (-y + 0.03, y - 0.03), (0.0, 0.05), DARK)
    split = h * random.uniform(0.66, 0.74) if h > 0.6 else h
    doors = [(0.06, split - 0.004), (split + 0.004, h - 0.003)] if h > 0.6 else [(0.06, h - 0.003)]
    for low, high in doors:
        parts.box((front - 0.045, front), (-y + 0.002, y - 0.002), (low, high), color)
        parts.touch("right" if side > 0 else "left", "front", *(("top",) if high > h - 0.01 else ()))
        tall = min(0.6 * (high - low), 0.3)
        near = high - 0.05 - tall if low < 0.1 else low + 0.03
        middle = side * (y - 0.055)
        parts.handle((x - 0.018, x), (middle - 0.011, middle + 0.011), (near, near + tall), draft.metal)
        for end in (near + 0.01, near + tall - 0.03):
            parts.box((front, x - 0.018), (middle - 0.009, middle + 0.009), (end, end + 0.02), draft.metal)
    badge = -side * (y - 0.07)
    parts.box((front, front + 0.003), (badge - 0.04, badge + 0.04), (h - 0.07, h - 0.05), shade(draft.metal, 0.8))


def oven(parts: Furnishing, draft: Draft, random: np.random.Generator) -> None:
    """A cooker: four plates on top, knobs, an oven door with window and bar, a drawer below."""
    x, y, h = draft.length / 2, draft.width / 2, draft.height
    front = x - BULGE
    color = draft.white
    parts.box((-x, front - 0.03), (-y, y), (0.0, h - 0.02), color)
    parts.touch("left", "right")
    parts.box((-x, front + 0.005), (-y, y), (h - 0.02, h - 0.006), DARK)
    parts.touch("front", "top", "left", "right")
    for sx in (-1, 1):
        for sy in (-1, 1):
            size = 0.3 * min(x, y) if sx * sy > 0 else 0.36 * min(x, y)
            cx, cy = -0.02 + sx * 0.42 * (x - 0.03), sy * 0.48 * y
            parts.box((cx - size, cx + size), (cy - size, cy + size), (h - 0.006, h), (0.32, 0.30, 0.30))
    strip = h - 0.14 * h
    parts.box((front - 0.03, front), (-y, y), (strip, h - 0.02), shade(color, 0.85))
    for i in range(4):
        middle = (-0.66 + 0.44 * i) * y
        parts.box(
            (front, front + 0.022),
            (middle - 0.018, middle + 0.018),
            ((strip + h - 0.02) / 2 - 0.018, (strip + h - 0.02) / 2 + 0.018),
            DARK,
        )
    foot = 0.22 * h
    parts.box((front - 0.03, front - 0.004), (-y + 0.004, y - 0.004), (foot + 0.004, strip - 0.004), shade(color, 0.96))
    parts.box(
        (front - 0.004, front),
        (-0.72 * y, 0.72 * y),
        (foot + 0.18 * (strip - foot), strip - 0.3 * (strip - foot)),
        GLASS,
    )
    bar = strip - 0.07
    parts.handle((front - 0.004, x), (-0.8 * y, 0.8 * y), (bar, bar + 0.022), draft.metal)
    parts.box((front - 0.03, front - 0.004), (-y + 0.004, y - 0.004), (0.05, foot - 0.004), shade(color, 0.9))


def microwave(parts: Furnishing, draft: Draft, random: np.random.Generator) -> None:
    """A microwave on a trolley with two boards."""
    x, y, h = draft.length / 2, draft.width / 2, draft.height
    tall = min(0.32, 0.42 * h)
    board = h - tall
    metal = draft.metal
    for sx in (-1, 1):
        for sy in (-1, 1):
            cx, cy = sx * (x - 0.015), sy * (y - 0.015)
            parts.box((cx - 0.015, cx + 0.015), (cy - 0.015, cy + 0.015), (0.0, board - 0.025), metal)
    parts.box((-x, x), (-y, y), (board - 0.025, board), draft.wood)
    parts.touch("front", "left", "right")
    low = random.uniform(0.25, 0.45) * board
    parts.box((-x + 0.005, x - 0.005), (-y + 0.005, y - 0.005), (low, low + 0.02), draft.wood)
    parts.touch("front", "left", "right")
    depth, wide = min(x - 0.03, 0.2), min(y - 0.02, 0.26)
    case = draft.white if random.uniform() < 0.5 else shade(DARK, 1.5)
    parts.box((-depth, depth - 0.02), (-wide, wide), (board + 0.012, h), case)
    parts.touch("front", "left", "right", "top")
    parts.box((-depth + 0.02, depth - 0.04), (-wide + 0.03, wide - 0.03), (board, board + 0.012), DARK)
    door = wide - 0.27 * 2 * wide
    parts.box((depth - 0.02, depth - 0.002), (-wide + 0.004, door), (board + 0.016, h - 0.004), shade(case, 0.9))
    parts.box((depth - 0.002, depth), (-wide + 0.04, door - 0.05), (board + 0.05, h - 0.04), GLASS)
    parts.handle((depth - 0.002, depth + 0.026), (door - 0.035, door - 0.015), (board + 0.04, h - 0.03), draft.metal)
    parts.box((depth - 0.02, depth - 0.006), (door + 0.006, wide - 0.004), (board + 0.016, h - 0.004), shade(DARK, 1.1))
    parts.box((depth - 0.006, depth), (door + 0.03, wide - 0.03), (h - 0.08, h - 0.04), (0.35, 0.75, 0.55))
    parts.box((depth - 0.006, depth), (door + 0.03, wide - 0.03), (board + 0.05, h - 0.11), (0.62, 0.63, 0.65))


def radiator(parts: Furnishing, draft: Draft, random: np.random.Generator) -> None:
    """An oil radiator on castors: upright fins, a control box, a handle.

    Its fins stand one behind the other along x.
    """
    x, y, h = draft.length / 2, draft.width / 2, draft.height
    color = draft.white if random.uniform() < 0.7 else draft.paint
    front = x - 0.10
    fins = 7
    pitch = (front + x) / fins
    for i in range(fins):
        middle = -x + (i + 0.5) * pitch
        parts.box((middle - 0.3 * pitch, middle + 0.3 * pitch), (-y, y), (0.08, h - 0.05), color)
        if i >= fins - 4:
            parts.touch("left", "right", *(("top",) if i > fins - 3 else ()))
    for z in (0.14, h - 0.12):
        parts.box((-x + 0.2 * pitch, front), (-0.03, 0.03), (z - 0.025, z + 0.025), shade(color, 0.85))
    parts.box((front - 0.01, x), (-0.75 * y, 0.75 * y), (0.12, h - 0.02), shade(DARK, 1.6))
    parts.touch("front", "left", "right", "top")
    parts.box((-0.3 * x, front), (-0.02, 0.02), (h - 0.06, h), DARK)
    for middle in (-x + 0.12, front - 0.06):
        parts.box((middle - 0.03, middle + 0.03), (-y + 0.01, y - 0.01), (0.03, 0.085), DARK)
        for side in (-1, 1) if middle < 0 else (0,):
            wide = 0.025 if side else y - 0.01
            parts.box(
                (middle - 0.03, middle + 0.03),
                (side * (y - 0.035) - wide, side * (y - 0.035) + wide),
                (0.0, 0.035),
                shade(DARK, 0.8),
            )


def lamp(parts: Furnishing, draft: Draft, random: np.random.Generator) -> None:
    """A floor lamp: round foot, pole, round shade at the height of the chest."""
    x, y, h = draft.length / 2, draft.width / 2, draft.height
    radius = (x + y) / 2
    tall = random.uniform(0.24, 0.32)
    light = (0.96, 0.91, 0.78) if random.uniform() < 0.6 else shade(draft.paint, 1.2)
    # two rings make the shade wider below than above
    for part, (share, low, high) in enumerate(((1.0, h - tall, h - 0.45 * tall), (0.84, h - 0.45 * tall, h))):
        parts.prism(
            (0, 0, (low + high) / 2),
            share * radius,
            (high - low) / 2,
            light,
            touch=("around", "top") if part else ("around",),
        )
    parts.box((-0.014, 0.014), (-0.014, 0.014), (0.02, h - tall), draft.metal)
    parts.prism((0, 0, 0.0125), 0.72 * radius, 0.0125, draft.metal)
