"""Chairs of four kinds, made of at most SLOTS boxes; every chair follows from a seed and an index.

The sizes are drawn so that a large family has the statistics of the paper's table of objects for sitting on a chair:
length 57.8 +- 14.9 cm, width 55.6 +- 15.1 cm, height 80.6 +- 17.6 cm. Every chair can be sat on: the seat is at least
0.34 m deep and 0.42 m wide, 0.52 m between armrests.
"""

from dataclasses import replace

import numpy as np

from mimicbench.core.errors import BadObject
from mimicbench.core.seeds import rng
from mimicbench.objects.families.chair_parts import (
    MIN_BETWEEN_ARMS,
    MIN_SEAT_DEPTH,
    MIN_SEAT_WIDTH,
    ChairShape,
    easy,
    framed,
    stool,
)
from mimicbench.objects.families.draws import FABRICS, WOODS, SizeDistribution, tint, truncated
from mimicbench.objects.families.parts import Parts
from mimicbench.objects.family import Family
from mimicbench.objects.shape import SceneObject

KINDS = ("dining", "stool", "armchair", "easy")
MAX_SEAT_DEPTH = 0.56
"""[m]; of a longer chair, the back leans more or is thicker."""

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
    basis = ChairShape(
        kind,
        length,
        width,
        max(height, seat + 0.3),
        seat,
        leg=leg,
        cushion=0.04 if upholstered else 0.0,
        arm_height=arm_height,
        arm_setback=setback,
        wood=wood,
        fabric=fabric,
    )
    if kind == "stool":
        return _draw_stool(random, replace(basis, stretchers=stretchers))
    if kind == "easy":
        return _draw_easy(random, replace(basis, recline=recline), max(height - seat, 0.3))
    recline = max(recline, min(0.38, np.arctan2(length - MAX_SEAT_DEPTH, max(height - seat, 0.3))))
    thickness = random.uniform(0.022, 0.035) if back != "panel" else random.uniform(0.025, 0.05)
    arm = min(random.uniform(0.04, 0.06), (width - MIN_BETWEEN_ARMS) / 2) if kind == "armchair" else 0.0
    return replace(
        basis,
        back=back,
        bars=bars,
        recline=recline,
        back_thickness=thickness,
        stretchers=stretchers and kind == "dining",
        arm_width=arm,
    )


def _draw_stool(random: np.random.Generator, basis: ChairShape) -> ChairShape:
    """A chair as high as its seat."""
    return replace(
        basis,
        height=basis.seat_height,
        back="none" if random.uniform() < 0.7 else "block",
        splay=random.uniform(-0.03, 0.0),
        cushion=0.045 if basis.cushion else 0.0,
    )


def _draw_easy(random: np.random.Generator, basis: ChairShape, rise: float) -> ChairShape:
    """A wide, low chair whose back is the thicker, the longer it is; `rise` of the back above the seat [m]."""
    spare = basis.length - MAX_SEAT_DEPTH - rise * np.tan(basis.recline)
    return replace(
        basis,
        back="panel",
        back_thickness=max(random.uniform(0.13, 0.18), min(spare, 0.38)),
        arm_width=min(random.uniform(0.09, 0.16), (basis.width - MIN_BETWEEN_ARMS) / 2),
        leg=random.uniform(0.04, 0.10),
        cushion=random.uniform(0.10, 0.15),
        arm_height=random.uniform(0.12, 0.20),
        arm_setback=random.uniform(0.0, 0.05),
    )


def build_chair(object_id: str, shape: ChairShape) -> SceneObject:
    """The chair of that shape. Raises BadObject if nobody could sit on it."""
    parts = Parts()
    polygon_x = {"stool": stool, "easy": easy}.get(shape.kind, framed)(parts, shape)
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


FAMILY = Family("chair", make_chair)
