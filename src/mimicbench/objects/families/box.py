"""Boxes to lift, of five kinds that are as light as they look; every box follows from a seed and an index.

Thirty boxes, numbers 0 to 29 of any seed, have the statistics of the paper's table of objects for lifting: length 67.3
+- 6.4 cm, width 43.4 +- 6.2 cm, height 88.9 +- 7.8 cm. So few independent draws would miss these by more than the
paper's last digit, so the sizes and the mass are a Latin hypercube: each of the four takes every thirtieth of its
distribution once, in an order of its own. The next thirty are another such set.

What a box weighs for its surface says what it can be made of: foam and cloth below 0.7 kg/m^2, cardboard of one or two
layers from there to 1.2, plastic sheet and moulded plastic up to 1.6. None of them is of wood or metal.

A box is its solid body and a few thin boxes for looks, none of which stands out by more than 4 mm: its mass is spread
through its volume, and its sides are flat. It is clasped between the hands by its left and right side, at 80 to 90 % of
its height near its middle; that is where its touch points are: first those of the left hand of somebody in front of the
box (negative y), then, in the same order, the right hand's.
"""

from collections.abc import Sequence
from statistics import NormalDist

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.seeds import rng
from mimicbench.objects.families.draws import WOODS, shade, tint
from mimicbench.objects.families.furnishing import PAINTS
from mimicbench.objects.families.parts import Color, Parts
from mimicbench.objects.family import Family
from mimicbench.objects.shape import SceneObject

KINDS = ("foam box", "hamper", "carton", "sheet crate", "tote")
MADE_OF = {
    "foam box": (0.0, 0.66),
    "hamper": (0.42, 0.80),
    "carton": (0.58, 1.18),
    "sheet crate": (0.85, 1.32),
    "tote": (1.08, np.inf),
}
"""Least and most [kg/m^2] of the surface of each kind: 3 cm of polystyrene; cloth on a wire frame; corrugated cardboard
with its flaps; corrugated polypropylene; 1.5 mm of polyethylene."""
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
LINENS: tuple[Color, ...] = ((0.86, 0.82, 0.73), (0.74, 0.76, 0.75), (0.80, 0.72, 0.62), (0.62, 0.68, 0.72))
SHEETS: tuple[Color, ...] = ((0.72, 0.82, 0.90), (0.78, 0.88, 0.76), (0.92, 0.86, 0.66), (0.86, 0.86, 0.88))
MILKY: tuple[Color, ...] = ((0.88, 0.90, 0.91), (0.82, 0.88, 0.92), (0.90, 0.88, 0.84))
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
    size = (float(length), float(width), float(height))
    possible = kinds_of(size, mass)
    return build_box(f"box-{seed}-{index:05d}", possible[index % len(possible)], size, mass, random)


def kinds_of(size: tuple[float, float, float], mass: float) -> list[str]:
    """What a box of that size [m] and mass [kg] can be made of."""
    x, y, h = size
    per_area = mass / (2.0 * (x * y + x * h + y * h))
    return [kind for kind, (least, most) in MADE_OF.items() if least <= per_area < most]


def build_box(
    object_id: str, kind: str, size: tuple[float, float, float], mass: float, random: np.random.Generator
) -> SceneObject:
    """The box of that kind, size over everything (length, width, height) [m] and mass [kg]; its colors are drawn.

    There are cases of wood as well, for whatever heavy thing a recorded person lifts.
    """
    parts = Parts()
    makers = {
        "foam box": _foam_box,
        "hamper": _hamper,
        "carton": _carton,
        "sheet crate": _sheet_crate,
        "tote": _tote,
        "wooden case": _wooden_case,
    }
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


def _layers(parts: Parts, size: tuple[float, float, float], layers: Sequence[tuple[float, Color]]) -> None:
    """The body as layers one on the other: (share of the height at which it ends, color)."""
    x, y, low = size[0] / 2 - SKIN, size[1] / 2, 0.0
    for share, color in layers:
        parts.box((-x, x), (-y, y), (low, share * size[2]), color)
        low = share * size[2]


def _foam_box(parts: Parts, size: tuple[float, float, float], random: np.random.Generator) -> None:
    """White polystyrene with a lid, held by two straps, and an address."""
    x, y, h = size[0] / 2, size[1] / 2, size[2]
    white = shade((0.95, 0.96, 0.96), float(random.uniform(0.94, 1.0)))
    lid = float(random.uniform(0.86, 0.91))
    strap = tint(random, PAINTS)
    _layers(parts, size, ((lid, white), (lid + 0.006, shade(white, 0.72)), (1.0, shade(white, 1.02))))
    for middle in (-0.45 * y, 0.45 * y):
        for low, high in ((x - SKIN, x), (-x, SKIN - x)):
            parts.box((low, high), (middle - 0.012, middle + 0.012), (0.0, h), strap)
    parts.box((x - SKIN, x), (-0.2 * y, 0.3 * y), (0.5 * h, 0.62 * h), (0.86, 0.84, 0.70))


def _hamper(parts: Parts, size: tuple[float, float, float], random: np.random.Generator) -> None:
    """Linen on a frame of wire, with a rim, and rope handles in front and behind."""
    x, y, h = size[0] / 2, size[1] / 2, size[2]
    cloth = tint(random, LINENS)
    rim, rope = shade(cloth, 0.62), (0.80, 0.72, 0.58)
    below = float(random.uniform(0.0, 0.35))
    layers = [(below, tint(random, PAINTS))] if below > 0.12 else []
    _layers(parts, size, (*layers, (0.955, cloth), (1.0, rim)))
    for low, high in ((x - SKIN, x), (-x, SKIN - x)):
        for middle in (-0.3 * y, 0.3 * y):
            parts.box((low, high), (middle - 0.009, middle + 0.009), (0.80 * h, 0.90 * h), rope)
        parts.box((low, high), (-0.3 * y, 0.3 * y), (0.78 * h, 0.80 * h), rope)


def _sheet_crate(parts: Parts, size: tuple[float, float, float], random: np.random.Generator) -> None:
    """A folding crate of corrugated plastic: pale sheet, white edges, grip holes in front and behind, a card."""
    x, y, h = size[0] / 2, size[1] / 2, size[2]
    sheet = tint(random, SHEETS)
    edge, hole = (0.93, 0.93, 0.92), shade(sheet, 0.35)
    _layers(parts, size, ((0.03, edge), (0.955, sheet), (1.0, edge)))
    for low, high in ((x - SKIN, x), (-x, SKIN - x)):
        for side in (-1, 1):
            inner, outer = sorted((side * (y - 0.025), side * y))
            parts.box((low, high), (inner, outer), (0.03 * h, 0.955 * h), edge)
        parts.box((low, high), (-0.22 * y, 0.22 * y), (0.80 * h, 0.80 * h + 0.035), hole)
    parts.box((x - SKIN, x), (-0.5 * y, 0.1 * y), (0.40 * h, 0.40 * h + 0.11), (0.96, 0.95, 0.90))


def _tote(parts: Parts, size: tuple[float, float, float], random: np.random.Generator) -> None:
    """A tall container of thin, milky plastic with ribs around it, a colored lid and two clips."""
    x, y, h = size[0] / 2, size[1] / 2, size[2]
    milky, lid = tint(random, MILKY), tint(random, PAINTS)
    ribs = int(random.integers(2, 5))
    edges = 0.93 * (np.arange(1, ribs + 1) / (ribs + 1))
    layers: list[tuple[float, Color]] = []
    for edge in edges:
        layers += [(float(edge) - 0.012, milky), (float(edge), shade(milky, 0.86))]
    _layers(parts, size, (*layers, (0.93, milky), (1.0, lid)))
    for low, high in ((x - SKIN, x), (-x, SKIN - x)):
        for middle in (-0.5 * y, 0.5 * y):
            parts.box((low, high), (middle - 0.03, middle + 0.03), (0.90 * h, 0.975 * h), (0.9, 0.9, 0.88))


FAMILY = Family("box", make_box)
