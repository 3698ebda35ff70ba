"""Beds of eight kinds, made of at most SLOTS boxes; every bed follows from a seed and an index.

The sizes are drawn so that the family has the statistics of the paper's table of objects for lying on a bed: length
227.3 +- 42.7 cm, width 177.7 +- 39.4 cm, height 85.7 +- 27.0 cm, all over everything. Length is along x: the head end
is at -x, the bed faces +x with its foot. Every mattress is at least 1.70 m long, so that a robot or a person of 1.8 m
can lie on it lengthwise; the long and the wide beds have a deep headboard, a bench at the foot, or tables beside the
head.
"""

import numpy as np

from mimicbench.core.errors import BadObject
from mimicbench.core.seeds import rng
from mimicbench.objects.families.bed_frames import BEDDING, MIN_MATTRESS, BedShape, build_frame
from mimicbench.objects.families.draws import WOODS, Range, SizeDistribution, shade, tint, truncated
from mimicbench.objects.families.parts import Color, Parts
from mimicbench.objects.family import Family
from mimicbench.objects.shape import SceneObject

PILLOW_DEPTH = 0.38
"""[m] along the bed."""
LIE: Range = (0.49, 0.055, 0.36, 0.64)
"""Height of the plane to lie on."""

BEDS = {
    "platform": SizeDistribution(0.24, (2.03, 0.28, 1.76, 2.80), (1.72, 0.34, 0.95, 2.50), LIE, LIE),
    "headboard": SizeDistribution(
        0.16, (1.96, 0.30, 1.76, 2.80), (1.62, 0.34, 0.85, 2.40), (0.88, 0.19, 0.66, 1.45), LIE
    ),
    "storage": SizeDistribution(
        0.09, (2.03, 0.30, 1.80, 2.80), (1.66, 0.34, 0.90, 2.40), (0.92, 0.19, 0.68, 1.45), LIE
    ),
    "panel": SizeDistribution(0.11, (2.00, 0.30, 1.86, 2.80), (1.60, 0.34, 0.85, 2.40), (0.90, 0.19, 0.66, 1.45), LIE),
    "sleigh": SizeDistribution(0.07, (2.24, 0.28, 1.98, 2.95), (1.70, 0.30, 0.95, 2.40), (0.90, 0.15, 0.72, 1.30), LIE),
    "poster": SizeDistribution(0.06, (2.06, 0.28, 1.86, 2.80), (1.72, 0.30, 1.00, 2.40), (1.42, 0.32, 0.95, 2.10), LIE),
    "bench": SizeDistribution(0.15, (3.12, 0.30, 2.45, 3.80), (1.78, 0.28, 1.10, 2.50), (0.94, 0.19, 0.68, 1.45), LIE),
    "suite": SizeDistribution(0.12, (2.10, 0.30, 1.85, 2.80), (2.48, 0.26, 1.90, 3.10), (0.94, 0.19, 0.70, 1.45), LIE),
}
"""Sizes by kind; length along x, width along y, height over everything (without a headboard, of the plane to lie
on)."""

GOLDEN = (5**0.5 - 1) / 2
LINEN: Color = (0.94, 0.93, 0.91)


def make_bed(index: int, seed: int = 0) -> SceneObject:
    """Bed number `index` of the family that `seed` names."""
    # steps of the golden ratio give every few dozen beds the kinds' shares: a family is small, and its statistics
    # should not hang on luck
    place = (index * GOLDEN + rng(seed, "bed", "kinds").uniform()) % 1.0
    kind = list(BEDS)[
        int(np.searchsorted(np.cumsum([sizes.share for sizes in BEDS.values()])[:-1], place, side="right"))
    ]
    return build_bed(f"bed-{seed}-{index:05d}", draw_bed(rng(seed, "bed", index), kind))


def draw_bed(random: np.random.Generator, kind: str) -> BedShape:
    """Draw one bed of the given kind."""
    sizes = BEDS[kind]
    # one scale for the whole bed, and a stretch of each side by itself
    scale = random.standard_normal()
    length, width, height = (truncated(random, side, scale) for side in (sizes.length, sizes.width, sizes.height))
    seat = truncated(random, sizes.seat, 0.0)
    wood, fabric = tint(random, WOODS), tint(random, BEDDING)
    mattress = min(random.uniform(0.17, 0.28), seat - 0.16)
    pillow = random.uniform(0.03, 0.05) if random.uniform() < 0.85 else 0.0
    side, thickness, foot = int(random.choice([-1, 1])), random.uniform(0.035, 0.10), random.uniform(0.04, 0.30)
    bench, table = random.uniform(0.34, 0.48), random.uniform(0.40, 0.52)
    margin = random.uniform(0.07, 0.20) if kind == "platform" else random.uniform(0.02, 0.05)
    canopy = kind == "poster" and height > 1.6 and bool(random.uniform() < 0.7)
    height = seat if kind == "platform" else max(height, seat + 0.18)
    if kind == "bench":  # a bookcase at the head takes what is left of a very long bed
        thickness = float(np.clip(length - bench - 2.25, thickness, 0.36))
    thickness = min(thickness, length - bench * (kind == "bench") - MIN_MATTRESS[0] - 0.035)
    return BedShape(
        kind,
        length,
        width,
        height,
        seat,
        mattress,
        min(margin, (width - MIN_MATTRESS[1]) / 2),
        thickness,
        min(foot, 0.7 * (height - seat)),
        bench if kind == "bench" else 0.0,
        table if kind == "suite" else 0.0,
        canopy,
        pillow,
        side,
        wood,
        fabric,
    )


def build_bed(object_id: str, shape: BedShape) -> SceneObject:
    """The bed of that shape. Raises BadObject if nobody could lie on it."""
    parts = Parts()
    half_width = shape.width / 2 - shape.table
    head, foot = build_frame(parts, shape, half_width)
    y = half_width - shape.margin
    if foot - head < MIN_MATTRESS[0] - 1e-9 or 2 * y < MIN_MATTRESS[1] - 1e-9:
        raise BadObject(
            f"bed {object_id}: a mattress of {foot - head:.2f} x {2 * y:.2f} m is too small; give "
            f"{MIN_MATTRESS[0]} x {MIN_MATTRESS[1]} m or more"
        )
    height = shape.seat_height
    fold = head + 0.30 * (foot - head)
    over, low = min(0.012, shape.margin - 0.005), height - (0.7 if shape.kind == "platform" else 0.78) * shape.mattress
    parts.box((head, foot), (-y, y), (height - shape.mattress, height - 0.006), LINEN)
    # sheet and duvet end at the same height: one level plane
    parts.box((head + 0.002, fold), (-y + 0.002, y - 0.002), (height - 0.02, height), LINEN)
    parts.box((fold, foot + 0.004), (-y - over, y + over), (low, height), shape.fabric)
    double = 2 * y > 1.25
    across = (-y / 2, y / 2) if double else (0.0,)
    if shape.pillow:
        for middle in across:
            half = np.array([PILLOW_DEPTH / 2, min(0.36, (0.44 if double else 0.80) * y), (shape.pillow + 0.02) / 2])
            parts.add(
                np.array([head + 0.04 + half[0], middle, height + shape.pillow - half[2]]), half, shade(LINEN, 1.05)
            )
    head_xy = np.array([head + 0.04 + PILLOW_DEPTH / 2, shape.side * y / 2 if double else 0.0])
    pos = parts.centered()
    moved = (pos[0] - parts.pos[0])[:2]
    polygon = np.array([[foot, -y], [foot, y], [head, y], [head, -y]]) + moved
    return SceneObject(
        object_id,
        "bed",
        shape.kind,
        pos,
        np.array(parts.quat),
        np.array(parts.half),
        np.array(parts.rgb),
        height,
        polygon,
        head_xy + moved,
    )


FAMILY = Family("bed", make_bed)
