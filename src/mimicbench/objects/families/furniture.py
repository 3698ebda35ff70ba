"""Makers of wooden household furniture: tables, desks, shelves, cabinets and their kin.

Each fills a Furnishing to the size of its draft.

Fronts look to +x. Handles stand out of the front, and count as part of the length.
"""

import numpy as np

from mimicbench.objects.families.draws import shade
from mimicbench.objects.families.furnishing import DARK, Draft, Furnishing
from mimicbench.objects.families.parts import Color

HANDLE = 0.03
"""[m] how far handles stand out of a front."""


def table(parts: Furnishing, draft: Draft, random: np.random.Generator) -> None:
    """A top on four legs with aprons; low ones may have a shelf."""
    x, y, h = draft.length / 2, draft.width / 2, draft.height
    thick, leg, inset = random.uniform(0.022, 0.045), random.uniform(0.035, 0.065), random.uniform(0.0, 0.06)
    top = draft.wood if random.uniform() < 0.7 else draft.paint
    frame = draft.wood if random.uniform() < 0.7 else draft.metal
    parts.box((-x, x), (-y, y), (h - thick, h), top)
    parts.touch("front", "left", "right", "top")
    _legs(parts, (x - inset, y - inset), leg, h - thick, frame)
    ax, ay, low = x - inset - leg / 2, y - inset - leg / 2, h - thick - random.uniform(0.05, 0.09)
    for side in (-1, 1):
        parts.box((-ax, ax), (side * ay - 0.011, side * ay + 0.011), (low, h - thick), shade(frame, 0.95))
        parts.box((side * ax - 0.011, side * ax + 0.011), (-ay, ay), (low, h - thick), shade(frame, 0.95))
    if h < 0.58 and random.uniform() < 0.6:
        parts.box((-ax, ax), (-ay, ay), (0.3 * h, 0.3 * h + 0.02), top)


def desk(parts: Furnishing, draft: Draft, random: np.random.Generator) -> None:
    """A writing desk: drawers under one end, a panel under the other, a modesty panel behind.

    Its open side is the front.
    """
    x, y, h = draft.length / 2, draft.width / 2, draft.height
    side = 1 if random.uniform() < 0.5 else -1
    front = x - 0.02
    wood, dark = draft.wood, shade(draft.wood, 0.8)
    drawer = draft.paint if random.uniform() < 0.4 else shade(wood, 1.12)
    width = min(0.36, 0.46 * draft.width)
    parts.box((-x, x), (-y, y), (h - 0.03, h), wood)
    parts.touch("front", "left", "right", "top")
    inner, outer = side * (y - 0.02 - width), side * (y - 0.02)
    span = (min(inner, outer), max(inner, outer))
    parts.box((-x + 0.02, front - 0.03), span, (0.0 if random.uniform() < 0.5 else 0.28 * h, h - 0.03), dark)
    floor = parts.pos[-1][2] - parts.half[-1][2]
    if floor > 0:  # a hanging block of drawers needs a leg panel as well
        parts.box(
            (-x + 0.05, front - 0.06),
            (outer - 0.03, outer) if side > 0 else (outer, outer + 0.03),
            (0.0, h - 0.03),
            dark,
        )
    far = -side * (y - 0.03)
    parts.box((-x + 0.03, front - 0.03), (far - 0.015, far + 0.015), (0.0, h - 0.03), wood)
    parts.box((-x + 0.06, -x + 0.08), (min(far, inner), max(far, inner)), (0.45 * h, h - 0.03), dark)
    rows = 3 if floor == 0 else 2
    pitch = (h - 0.05 - floor - 0.02) / rows
    for i in range(rows):
        z = floor + 0.02 + i * pitch
        parts.box(
            (front - 0.03, front - 0.012), (span[0] + 0.008, span[1] - 0.008), (z + 0.006, z + pitch - 0.006), drawer
        )
        middle = sum(span) / 2
        parts.handle(
            (front - 0.012, front + 0.012),
            (middle - 0.06, middle + 0.06),
            (z + pitch * 0.6, z + pitch * 0.6 + 0.02),
            draft.metal,
        )


def side_table(parts: Furnishing, draft: Draft, random: np.random.Generator) -> None:
    """A small table like a stool: an eight-cornered top on a column, or a square one on four splayed legs."""
    x, y, h = draft.length / 2, draft.width / 2, draft.height
    if random.uniform() < 0.5:
        # round tops are as long as they are wide
        radius = (x + y) / 2
        parts.prism((0, 0, h - 0.015), radius, 0.015, draft.wood, touch=("around", "top"))
        parts.prism((0, 0, (h - 0.03) / 2 + 0.01), 0.035, (h - 0.03) / 2 - 0.01, draft.metal)
        parts.prism((0, 0, 0.0125), 0.62 * radius, 0.0125, draft.metal)
        return
    parts.box((-x, x), (-y, y), (h - 0.03, h), draft.wood)
    parts.touch("front", "left", "right", "top")
    top = np.array([x - 0.09, y - 0.09])
    for sx in (-1, 1):
        for sy in (-1, 1):
            head = np.array([sx * top[0], sy * top[1], h - 0.02])
            parts.leg(head, np.array([sx * (x - 0.025), sy * (y - 0.025)]), 0.035, shade(draft.wood, 0.85))
    reach = top + 0.3 * (np.array([x, y]) - 0.025 - top)
    parts.box((-reach[0], reach[0]), (-0.012, 0.012), (0.7 * h, 0.7 * h + 0.02), shade(draft.wood, 0.8))
    for sx in (-1, 1):
        parts.box(
            (sx * reach[0] - 0.01, sx * reach[0] + 0.01),
            (-reach[1], reach[1]),
            (0.7 * h, 0.7 * h + 0.02),
            shade(draft.wood, 0.8),
        )


def tv_stand(parts: Furnishing, draft: Draft, random: np.random.Generator) -> None:
    """A low board with two doors and an open middle, and a television on it."""
    x, y, h = draft.length / 2, draft.width / 2, draft.height
    low = float(np.clip(0.5 * h, 0.28, 0.5))
    front = x - 0.02
    wood = draft.wood
    parts.box((-x, front), (-y, y), (low - 0.025, low), wood)
    parts.touch("front", "top")
    parts.box((-x, front - 0.01), (-y + 0.01, y - 0.01), (0.06, 0.085), wood)
    parts.box((-x, -x + 0.015), (-y + 0.01, y - 0.01), (0.085, low - 0.025), shade(wood, 0.7))
    third = 0.36 * y
    for side in (-1, 1):
        inner, outer = side * third, side * (y - 0.01)
        span = (min(inner, outer), max(inner, outer))
        parts.box((-x + 0.015, front - 0.018), span, (0.085, low - 0.025), shade(wood, 0.85))
        parts.box(
            (front - 0.018, front - 0.002), (span[0] + 0.006, span[1] - 0.006), (0.09, low - 0.031), shade(wood, 1.08)
        )
        knob = side * (third + 0.05)
        parts.handle((front - 0.002, x), (knob - 0.008, knob + 0.008), (0.3 * low, low - 0.09), draft.metal)
        parts.box(
            (-x + 0.03, front - 0.04), (side * (y - 0.06) - 0.02, side * (y - 0.06) + 0.02), (0.0, 0.06), draft.metal
        )
    middle = (0.06 + low) / 2
    parts.box((-x + 0.015, front - 0.03), (-third, third), (middle - 0.009, middle + 0.009), wood)
    screen = 0.9 * y
    parts.box((-0.06, 0.06), (-0.16, 0.16), (low, low + 0.012), DARK)
    parts.box((-0.012, 0.012), (-0.04, 0.04), (low + 0.012, low + 0.06), DARK)
    parts.box((-0.02, 0.015), (-screen, screen), (low + 0.045, h), DARK)
    parts.touch("left", "right", "top")
    parts.box((0.015, 0.0175), (-screen + 0.012, screen - 0.012), (low + 0.065, h - 0.012), (0.22, 0.30, 0.42))


def bookshelf(parts: Furnishing, draft: Draft, random: np.random.Generator) -> None:
    """Sides, back and boards, with rows of books."""
    x, y, h = draft.length / 2, draft.width / 2, draft.height
    board = 0.022
    wood = draft.wood
    for side in (-1, 1):
        outer, inner = side * y, side * (y - board)
        parts.box((-x, x), (min(outer, inner), max(outer, inner)), (0, h), wood)
        parts.touch("front", "right" if side > 0 else "left")
    parts.box((-x, -x + 0.012), (-y + board, y - board), (0.05, h), shade(wood, 0.72))
    shelves = 2 if h < 0.72 else 3
    levels = np.linspace(0.06, h - board, shelves + 1)
    for z in levels:
        parts.box((-x + 0.012, x - (0.0 if z == levels[-1] else 0.008)), (-y + board, y - board), (z, z + board), wood)
        parts.touch("front", *(("top",) if z == levels[-1] else ()))
    inside = y - board
    spare = 16 - len(parts.pos)
    for row in range(shelves):
        count = spare // shelves + (1 if row < spare % shelves else 0)
        start = -inside + 0.01
        room = levels[row + 1] - levels[row] - board
        for _ in range(count):
            wide = float(min(random.uniform(0.5, 1.0) * 2 * inside / (count + 0.6), inside - 0.02 - start))
            if wide < 0.02:
                break
            color = (
                draft.paint
                if random.uniform() < 0.3
                else (random.uniform(0.2, 0.75), random.uniform(0.2, 0.6), random.uniform(0.2, 0.6))
            )
            parts.box(
                (-x + 0.012, x - random.uniform(0.05, 0.09)),
                (start, start + wide),
                (levels[row] + board, levels[row] + board + random.uniform(0.6, 0.9) * room),
                color,
            )
            start += wide + 0.004


def cabinet(parts: Furnishing, draft: Draft, random: np.random.Generator) -> None:
    """A cupboard with two doors, on a plinth or on legs."""
    x, y, h = draft.length / 2, draft.width / 2, draft.height
    front = x - HANDLE
    base = _base(parts, draft, front, random)
    body = draft.wood if random.uniform() < 0.6 else draft.paint
    door = shade(body, 1.1)
    parts.box((-x + 0.01, front - 0.02), (-y + 0.01, y - 0.01), (base, h - 0.025), body)
    parts.touch("left", "right")
    parts.box((-x, front + 0.005), (-y, y), (h - 0.025, h), shade(body, 0.85))
    parts.touch("front", "top", "left", "right")
    long = random.uniform(0.1, 0.28) * (h - base)
    middle = base + 0.62 * (h - base)
    for side in (-1, 1):
        inner, outer = side * 0.003, side * (y - 0.014)
        span = (min(inner, outer), max(inner, outer))
        parts.box((front - 0.02, front - 0.004), span, (base + 0.006, h - 0.032), door)
        rim = 0.055
        if y > 0.2:  # a sunken panel
            parts.box(
                (front - 0.004, front - 0.002),
                (span[0] + rim, span[1] - rim),
                (base + 0.006 + rim, h - 0.032 - rim),
                shade(door, 0.88),
            )
        knob = side * 0.032 if y < 0.2 else side * 0.03
        parts.handle(
            (front - 0.004, x), (knob - 0.008, knob + 0.008), (middle - long / 2, middle + long / 2), draft.metal
        )


def drawers(parts: Furnishing, draft: Draft, random: np.random.Generator) -> None:
    """A chest of three or four drawers."""
    x, y, h = draft.length / 2, draft.width / 2, draft.height
    front = x - HANDLE
    base = _base(parts, draft, front, random)
    body = draft.wood if random.uniform() < 0.7 else draft.paint
    parts.box((-x + 0.01, front - 0.02), (-y + 0.01, y - 0.01), (base, h - 0.025), shade(body, 0.8))
    parts.touch("left", "right")
    parts.box((-x, front + 0.005), (-y, y), (h - 0.025, h), body)
    parts.touch("front", "top", "left", "right")
    rows = 3 if h < 0.75 or len(parts.pos) > 4 else 4
    pitch = (h - 0.035 - base) / rows
    pulls = [(-0.5 * y, 0.05), (0.5 * y, 0.05)] if rows == 3 or len(parts.pos) <= 4 else [(0.0, 0.13)]
    for i in range(rows):
        z = base + i * pitch
        parts.box((front - 0.02, front), (-y + 0.02, y - 0.02), (z + 0.008, z + pitch - 0.004), shade(body, 1.1))
        for middle, half in pulls:
            parts.handle(
                (front, x), (middle - half, middle + half), (z + 0.5 * pitch, z + 0.5 * pitch + 0.018), draft.metal
            )


def nightstand(parts: Furnishing, draft: Draft, random: np.random.Generator) -> None:
    """A bedside table: a drawer over an open compartment, on four short legs."""
    x, y, h = draft.length / 2, draft.width / 2, draft.height
    front = x - HANDLE
    leg = min(random.uniform(0.08, 0.2), 0.35 * h)
    wood = draft.wood
    parts.box((-x, front + 0.004), (-y, y), (h - 0.022, h), wood)
    parts.touch("front", "top", "left", "right")
    for side in (-1, 1):
        outer, inner = side * (y - 0.01), side * (y - 0.03)
        parts.box((-x + 0.01, front - 0.01), (min(outer, inner), max(outer, inner)), (leg, h - 0.022), wood)
        parts.touch("front", "right" if side > 0 else "left")
    parts.box((-x + 0.01, -x + 0.022), (-y + 0.03, y - 0.03), (leg, h - 0.022), shade(wood, 0.7))
    parts.box((-x + 0.01, front - 0.01), (-y + 0.03, y - 0.03), (leg, leg + 0.02), wood)
    parts.touch("front")
    drop = random.uniform(0.36, 0.5) * (h - leg)
    parts.box((-x + 0.022, front - 0.02), (-y + 0.03, y - 0.03), (h - 0.022 - drop, h - 0.022), shade(wood, 0.8))
    parts.box(
        (front - 0.02, front - 0.004),
        (-y + 0.034, y - 0.034),
        (h - 0.022 - drop, h - 0.028),
        draft.paint if random.uniform() < 0.5 else shade(wood, 1.1),
    )
    level = h - 0.022 - 0.5 * drop
    parts.handle((front - 0.004, x), (-0.055, 0.055), (level - 0.01, level + 0.01), draft.metal)
    _legs(parts, (min(x - 0.02, front - 0.01), y - 0.012), 0.035, leg, shade(wood, 0.8), back=-x + 0.012)
    if random.uniform() < 0.5:
        parts.box((-0.06 - 0.2 * x, 0.08 - 0.2 * x), (-0.5 * y, 0.2 * y), (leg + 0.02, leg + 0.06), draft.paint)


def chest(parts: Furnishing, draft: Draft, random: np.random.Generator) -> None:
    """A wooden trunk: lid, two straps, a latch, handles at its ends."""
    x, y, h = draft.length / 2, draft.width / 2, draft.height
    front, side = x - 0.018, y - 0.03
    lid = random.uniform(0.68, 0.76) * h
    parts.box((-x + 0.018, front - 0.012), (-side + 0.012, side - 0.012), (0.0, lid), draft.wood)
    parts.touch("left", "right")
    parts.box((-x + 0.006, front), (-side, side), (lid, h - 0.004), shade(draft.wood, 1.12))
    parts.touch("front", "left", "right", "top")
    strap = draft.metal
    for end in (-1, 1):
        middle = end * 0.55 * side
        parts.box((-x, x - 0.012), (middle - 0.025, middle + 0.025), (lid + 0.02, h), shade(strap, 0.7))
        parts.box((-x + 0.012, x - 0.024), (middle - 0.025, middle + 0.025), (0.0, lid - 0.02), shade(strap, 0.7))
        outer, inner = end * y, end * (side - 0.012)
        parts.box((-0.08, 0.08), (min(outer, inner), max(outer, inner)), (0.66 * lid, 0.66 * lid + 0.025), strap)
        parts.touch("right" if end > 0 else "left")
    parts.box((front - 0.012, x), (-0.035, 0.035), (lid - 0.08, lid + 0.05), strap)
    parts.touch("front")


def _base(parts: Furnishing, draft: Draft, front: float, random: np.random.Generator) -> float:
    """A plinth or four legs under a cabinet; returns its height."""
    x, y = draft.length / 2, draft.width / 2
    if random.uniform() < 0.5:
        parts.box((-x + 0.03, front - 0.05), (-y + 0.03, y - 0.03), (0.0, 0.06), DARK)
        return 0.06
    height = float(random.uniform(0.08, 0.14))
    _legs(parts, (front - 0.03, y - 0.02), 0.04, height, shade(draft.wood, 0.7), back=-x + 0.02)
    return height


def _legs(
    parts: Furnishing, corner: tuple[float, float], thick: float, top: float, rgb: Color, back: float | None = None
) -> None:
    """Four upright legs whose outer edges are at +-corner; `back` is the rear ones' x if it is not -corner[0]."""
    rear = -corner[0] if back is None else back
    for x in ((rear, rear + thick), (corner[0] - thick, corner[0])):
        for y in ((-corner[1], -corner[1] + thick), (corner[1] - thick, corner[1])):
            parts.box(x, y, (0.0, top), rgb)
