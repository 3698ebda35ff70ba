"""Boxes to lift, of four kinds; every box follows from a seed and an index.

Thirty boxes, numbers 0 to 29 of any seed, have the statistics of the paper's table of objects for lifting: length 67.3
+- 6.4 cm, width
43.4 +- 6.2 cm, height 88.9 +- 7.8 cm. So few independent draws would miss these by more than the paper's last digit, so
the sizes and the mass are a
Latin hypercube: each of the four takes every thirtieth of its distribution once, in an order of its own. The next
thirty are another such set.

A box is its solid body and a few thin boxes for looks, none of which stands out by more than 4 mm: its mass is spread
through its volume, and
its sides are flat. It is clasped between the hands by its left and right side, at 80 to 90 % of its height near its
middle; that is where
its touch points are: first those of the left hand of somebody in front of the box (negative y), then, in the same
order, the right hand's.
"""

from statistics import NormalDist

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.seeds import rng
from mimicbench.objects.families.draws import WOODS, shade, tint
from mimicbench.objects.families.furnishing import METALS, PAINTS
from mimicbench.objects.families.parts import Color, Parts
from mimicbench.objects.family import Family
from mimicbench.objects.shape import SceneObject

KINDS = ("carton", "wooden case", "tote", "flight case")
COUNT = 30
"""Boxes in a set that has the table's statistics."""
SIZE_MEAN, SIZE_DEVIATION = np.array([0.673, 0.434, 0.889]), np.array([0.064, 0.062, 0.078])
"""[m] length, width, height: row L of the paper's table."""
_EVEN = np.array([NormalDist().inv_cdf((i + 0.5) / COUNT) for i in range(COUNT)])
QUANTILES = _EVEN / _EVEN.std()
"""(COUNT,) evenly spaced quantiles of a normal distribution; without the division they would be a little too narrow."""
MASS = (1.0, 4.0)
"""[kg] of the lightest and the heaviest; in between all are as likely."""
FRICTION = 1.0
CLASP_HEIGHTS = (0.8, 0.85, 0.9)
"""Where the hands go, as parts of the height."""
CLASP_FORWARD = (0.0, 0.06, 0.12)
"""[m] and how far in front of the middle."""
SKIN = 0.002
"""[m] how far what is only for looks stands out."""


def make_box(index: int, seed: int = 0) -> SceneObject:
    """Box number `index` of the family that `seed` names."""
    order = rng(seed, "box", "set", index // COUNT)
    places = [int(order.permutation(COUNT)[index % COUNT]) for _ in range(4)]
    length, width, height = np.round(SIZE_MEAN + SIZE_DEVIATION * QUANTILES[places[:3]], 4)
    mass = round(MASS[0] + (MASS[1] - MASS[0]) * (places[3] + 0.5) / COUNT, 3)
    random = rng(seed, "box", index)
    return build_box(
        f"box-{seed}-{index:05d}", KINDS[index % len(KINDS)], (float(length), float(width), float(height)), mass, random
    )


def build_box(
    object_id: str, kind: str, size: tuple[float, float, float], mass: float, random: np.random.Generator
) -> SceneObject:
    """The box of that kind, size over everything (length, width, height) [m] and mass [kg]; its colors are drawn."""
    parts = Parts()
    makers = {"carton": _carton, "wooden case": _wooden_case, "tote": _tote, "flight case": _flight_case}
    makers[kind](parts, size, random)
    side = float((np.abs(parts.pos[0]) + parts.half[0])[1])
    places = [(x, y, share * size[2]) for y in (-side, side) for share in CLASP_HEIGHTS for x in CLASP_FORWARD]
    points = np.round(places, 5)
    pos, half, rgb = (
        np.round(array, 5) + 0.0 for array in (np.array(parts.pos), np.array(parts.half), np.array(parts.rgb))
    )
    return SceneObject(
        object_id,
        "box",
        kind,
        pos,
        np.tile(rot.IDENTITY, (len(pos), 1)),
        half,
        rgb,
        touch_points=points,
        touch_normals=np.array([[0.0, np.sign(point[1]), 0.0] for point in points]),
        movable=True,
        mass=mass,
        friction=FRICTION,
    )


def _carton(parts: Parts, size: tuple[float, float, float], random: np.random.Generator) -> None:
    """A cardboard box, closed with tape, with a label."""
    x, y, h = size[0] / 2, size[1] / 2, size[2]
    brown = shade((0.76, 0.60, 0.42), float(random.uniform(0.85, 1.08)))
    tape = shade((0.86, 0.76, 0.58), float(random.uniform(0.9, 1.1)))
    parts.box((-x + SKIN, x - SKIN), (-y, y), (0.0, h - SKIN), brown)
    parts.box((-x + SKIN, x - SKIN), (-0.028, 0.028), (h - SKIN, h), tape)
    for side in (-1, 1):
        low, high = sorted((side * (x - SKIN), side * x))
        parts.box((low, high), (-0.028, 0.028), (h - 0.12, h), tape)
    left = random.uniform(-0.8, -0.1) * y
    parts.box((x - SKIN, x), (left, left + 0.75 * y), (0.45 * h, 0.6 * h), (0.94, 0.94, 0.91))
    parts.box((x - SKIN, x), (0.45 * y, 0.8 * y), (0.06 * h, 0.06 * h + 0.07), shade(brown, 0.6))


def _wooden_case(parts: Parts, size: tuple[float, float, float], random: np.random.Generator) -> None:
    """A case of boards with battens across its front and back."""
    x, y, h = size[0] / 2, size[1] / 2, size[2]
    wood = tint(random, WOODS[:4])
    thick = 2 * SKIN
    parts.box((-x + thick, x - thick), (-y, y), (0.0, h), wood)
    for side in (-1, 1):
        low, high = sorted((side * (x - thick), side * x))
        parts.box((low, high), (-y, y), (h - 0.075, h - 0.005), shade(wood, 0.75))
        parts.box((low, high), (-y, y), (0.005, 0.075), shade(wood, 0.75))
    parts.box((x - thick, x - 0.0005), (-0.035, 0.035), (0.075, h - 0.075), shade(wood, 0.82))


def _tote(parts: Parts, size: tuple[float, float, float], random: np.random.Generator) -> None:
    """A tall plastic container with a lid and two clips."""
    x, y, h = size[0] / 2, size[1] / 2, size[2]
    color, lid = tint(random, PAINTS), shade(tint(random, PAINTS), 0.6)
    parts.box((-x + SKIN, x - SKIN), (-y, y), (0.0, h - 0.05), color)
    parts.box((-x + 0.001, x - 0.001), (-y, y), (h - 0.05, h), lid)
    for side in (-1, 1):
        middle = side * 0.5 * y
        parts.box((x - SKIN, x), (middle - 0.03, middle + 0.03), (h - 0.11, h - 0.02), (0.9, 0.9, 0.88))
    for side in (-1, 1):
        low, high = sorted((side * (x - SKIN), side * x))
        parts.box((low, high), (-0.7 * y, 0.7 * y), (0.12 * h, 0.5 * h), shade(color, 0.85))


def _flight_case(parts: Parts, size: tuple[float, float, float], random: np.random.Generator) -> None:
    """A dark case with metal edges round its lid and foot, and two locks."""
    x, y, h = size[0] / 2, size[1] / 2, size[2]
    color = shade(tint(random, PAINTS), 0.55) if random.uniform() < 0.6 else (0.16, 0.16, 0.18)
    metal: Color = METALS[0]
    # body and bands together are the case: the bands stand out to the front and back only
    parts.box((-x + SKIN, x - SKIN), (-y, y), (0.03, h - 0.03), color)
    parts.box((-x, x), (-y, y), (h - 0.03, h), metal)
    parts.box((-x, x), (-y, y), (0.0, 0.03), metal)
    parts.box((-x + 0.001, x - 0.001), (-y + 0.0005, y - 0.0005), (0.70 * h, 0.70 * h + 0.02), metal)
    for side in (-1, 1):
        middle = side * 0.45 * y
        parts.box((x - SKIN, x), (middle - 0.03, middle + 0.03), (0.70 * h - 0.05, 0.70 * h + 0.07), shade(metal, 0.6))


FAMILY = Family("box", make_box)
