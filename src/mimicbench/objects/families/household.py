"""Household objects of 22 kinds to touch with both hands, made of at most SLOTS boxes.

Every one follows from a seed and an index.

The sizes are drawn so that a large family has the statistics of the paper's table of objects for touching points:
length 59.6 +- 19.2 cm, width 53.2 +- 16.2 cm, height 56.1 +- 16.7 cm. Every object has touch points and at least one
pair of them (see `touch`).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mimicbench.core.seeds import rng
from mimicbench.objects.families import appliances, containers, furniture
from mimicbench.objects.families.draws import WOODS, Range, tint, truncated
from mimicbench.objects.families.furnishing import METALS, PAINTS, WHITE_GOODS, Draft, Furnishing
from mimicbench.objects.family import Family
from mimicbench.objects.shape import SceneObject
from mimicbench.objects.touch import with_touch_points


@dataclass(frozen=True)
class Kind:
    """One kind of object: truncated normal distributions of its sizes, (mean, deviation, least, most) [m], and its
    maker.
    """

    build: Callable[[Furnishing, Draft, np.random.Generator], None]
    share: float
    """Part of the family that is of this kind."""
    length: Range
    """Front to back."""
    width: Range
    height: Range


KINDS = {
    "table": Kind(furniture.table, 0.18, (0.86, 0.18, 0.55, 1.30), (0.59, 0.17, 0.36, 1.05), (0.49, 0.13, 0.34, 0.78)),
    "desk": Kind(furniture.desk, 0.05, (0.60, 0.08, 0.48, 0.80), (0.87, 0.10, 0.70, 1.15), (0.68, 0.05, 0.58, 0.80)),
    "side table": Kind(
        furniture.side_table, 0.06, (0.46, 0.08, 0.32, 0.66), (0.46, 0.08, 0.32, 0.66), (0.47, 0.08, 0.34, 0.66)
    ),
    "tv stand": Kind(
        furniture.tv_stand, 0.025, (0.44, 0.06, 0.34, 0.60), (0.88, 0.09, 0.72, 1.10), (0.76, 0.07, 0.62, 0.94)
    ),
    "bookshelf": Kind(
        furniture.bookshelf, 0.04, (0.34, 0.05, 0.24, 0.46), (0.57, 0.12, 0.40, 0.92), (0.74, 0.11, 0.54, 1.05)
    ),
    "cabinet": Kind(
        furniture.cabinet, 0.04, (0.46, 0.06, 0.34, 0.62), (0.58, 0.12, 0.40, 0.92), (0.68, 0.10, 0.50, 0.98)
    ),
    "drawers": Kind(
        furniture.drawers, 0.04, (0.48, 0.05, 0.38, 0.62), (0.58, 0.12, 0.42, 0.94), (0.66, 0.09, 0.50, 0.92)
    ),
    "nightstand": Kind(
        furniture.nightstand, 0.05, (0.44, 0.06, 0.33, 0.60), (0.44, 0.06, 0.34, 0.60), (0.50, 0.07, 0.38, 0.66)
    ),
    "chest": Kind(furniture.chest, 0.06, (0.52, 0.07, 0.38, 0.70), (0.70, 0.12, 0.50, 1.05), (0.44, 0.06, 0.34, 0.60)),
    "washing machine": Kind(
        appliances.washer, 0.025, (0.62, 0.05, 0.52, 0.74), (0.59, 0.03, 0.52, 0.66), (0.82, 0.04, 0.72, 0.92)
    ),
    "fridge": Kind(
        appliances.fridge, 0.025, (0.60, 0.06, 0.48, 0.74), (0.54, 0.05, 0.45, 0.66), (0.84, 0.10, 0.62, 1.08)
    ),
    "oven": Kind(appliances.oven, 0.02, (0.62, 0.05, 0.52, 0.74), (0.58, 0.05, 0.48, 0.72), (0.84, 0.04, 0.76, 0.94)),
    "microwave": Kind(
        appliances.microwave, 0.025, (0.50, 0.05, 0.40, 0.64), (0.56, 0.06, 0.46, 0.72), (0.76, 0.07, 0.62, 0.96)
    ),
    "radiator": Kind(
        appliances.radiator, 0.035, (0.56, 0.08, 0.42, 0.76), (0.28, 0.03, 0.23, 0.36), (0.58, 0.05, 0.48, 0.70)
    ),
    "lamp": Kind(appliances.lamp, 0.02, (0.40, 0.05, 0.32, 0.52), (0.40, 0.05, 0.32, 0.52), (0.93, 0.08, 0.78, 1.12)),
    "crate": Kind(containers.crate, 0.08, (0.66, 0.12, 0.42, 0.95), (0.44, 0.07, 0.30, 0.62), (0.37, 0.07, 0.27, 0.55)),
    "storage box": Kind(
        containers.tote, 0.07, (0.66, 0.12, 0.42, 0.95), (0.45, 0.07, 0.31, 0.62), (0.38, 0.06, 0.28, 0.54)
    ),
    "carton": Kind(
        containers.carton, 0.07, (0.68, 0.13, 0.44, 0.98), (0.50, 0.10, 0.36, 0.76), (0.43, 0.09, 0.30, 0.68)
    ),
    "bin": Kind(containers.bin_, 0.04, (0.36, 0.05, 0.27, 0.50), (0.36, 0.05, 0.27, 0.50), (0.50, 0.09, 0.34, 0.72)),
    "plant pot": Kind(
        containers.plant, 0.03, (0.42, 0.05, 0.32, 0.56), (0.42, 0.05, 0.32, 0.56), (0.68, 0.08, 0.54, 0.84)
    ),
    "suitcase": Kind(
        containers.suitcase, 0.03, (0.30, 0.04, 0.23, 0.40), (0.46, 0.05, 0.36, 0.58), (0.72, 0.07, 0.58, 0.92)
    ),
    "trolley": Kind(
        containers.trolley, 0.03, (0.83, 0.10, 0.62, 1.08), (0.44, 0.05, 0.34, 0.58), (0.72, 0.07, 0.58, 0.92)
    ),
}


def make_household(index: int, seed: int = 0) -> SceneObject:
    """Household object number `index` of the family that `seed` names."""
    obj, faces = make_untouched(index, seed)
    return with_touch_points(obj, faces)


def make_untouched(index: int, seed: int = 0) -> tuple[SceneObject, list[tuple[int, str]]]:
    """The same without touch points, and the faces that have them: what the sizes of many need, at a quarter of the
    time.
    """
    random = rng(seed, "household", index)
    shares = np.array([kind.share for kind in KINDS.values()])
    kind = list(KINDS)[int(random.choice(len(shares), p=shares / shares.sum()))]
    return build(f"household-{seed}-{index:05d}", kind, draw_draft(random, kind), random)


def draw_draft(random: np.random.Generator, kind: str) -> Draft:
    """Draw size and colors of an object of that kind: one scale for the whole of it, and a stretch of each side by
    itself.
    """
    scale = random.standard_normal()
    sizes = KINDS[kind]
    length, width, height = (truncated(random, side, scale) for side in (sizes.length, sizes.width, sizes.height))
    return Draft(
        length,
        width,
        height,
        tint(random, WOODS),
        tint(random, PAINTS),
        tint(random, METALS),
        tint(random, WHITE_GOODS),
    )


def build(
    object_id: str, kind: str, draft: Draft, random: np.random.Generator
) -> tuple[SceneObject, list[tuple[int, str]]]:
    """The object of that kind and draft, and its faces for touching.

    What the draft leaves open, such as the number of drawers, is drawn.
    """
    parts = Furnishing()
    KINDS[kind].build(parts, draft, random)
    # a hundredth of a millimeter is exact enough, and keeps the files small
    pos, half, rgb = (
        np.round(array, 5) + 0.0 for array in (parts.centered(), np.array(parts.half), np.array(parts.rgb))
    )
    return SceneObject(object_id, "household", kind, pos, np.array(parts.quat), half, rgb), parts.faces


FAMILY = Family("household", make_household)
