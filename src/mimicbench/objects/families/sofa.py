"""Sofas to sit on (family `sofa`), drawn with the statistics of the paper's table of objects, and what sofas to lie on
share with them.

The table's length is a sofa's long side, here y, and its width the side from front to back, here x, since who sits on
it faces +x: 131.1 +- 21.1 x 63.0 +- 21.7 x 57.3 +- 21.8 cm. A mean height of 57 cm says that most backs are low: half
of the sofas are seats near the floor with a back that ends at the loins, a quarter have high backs, a fifth none.
"""

from dataclasses import dataclass, replace

import numpy as np

from mimicbench.core.seeds import rng
from mimicbench.objects.families.draws import FABRICS, WOODS, Range, SizeDistribution, tint, truncated
from mimicbench.objects.families.sofa_shape import MIN_BETWEEN_ARMS, SofaShape
from mimicbench.objects.families.upholstery import build_sofa
from mimicbench.objects.family import Family
from mimicbench.objects.shape import SceneObject

SEAT: Range = (0.415, 0.032, 0.35, 0.50)
MAX_SEAT_DEPTH, MAX_LYING_DEPTH = 0.53, 0.64
"""Of a sofa with a back, to sit on, so that who sits reaches the back, and to lie on [m]; a deeper one has a thicker
back."""

LOW_SEAT: Range = (0.375, 0.022, 0.35, 0.45)

SOFAS = {
    "bench": SizeDistribution(0.13, (1.26, 0.21, 0.80, 1.85), (0.42, 0.06, 0.38, 0.66), SEAT, SEAT),
    "ottoman": SizeDistribution(0.08, (1.17, 0.19, 0.78, 1.70), (0.58, 0.20, 0.40, 1.20), SEAT, SEAT),
    "daybed": SizeDistribution(
        0.03, (1.38, 0.19, 0.90, 1.90), (0.50, 0.09, 0.40, 0.80), (0.57, 0.06, 0.50, 0.80), SEAT
    ),
    "lowback": SizeDistribution(
        0.52, (1.25, 0.185, 0.80, 1.80), (0.51, 0.08, 0.48, 0.90), (0.465, 0.05, 0.45, 0.65), LOW_SEAT
    ),
    "loveseat": SizeDistribution(
        0.10, (1.40, 0.18, 1.00, 1.85), (1.02, 0.24, 0.56, 1.60), (0.92, 0.27, 0.52, 1.50), SEAT
    ),
    "settee": SizeDistribution(
        0.05, (1.33, 0.17, 0.95, 1.80), (0.60, 0.08, 0.52, 0.90), (0.92, 0.18, 0.62, 1.30), SEAT
    ),
    "chesterfield": SizeDistribution(
        0.03, (1.44, 0.16, 1.10, 1.90), (0.78, 0.08, 0.60, 0.98), (0.72, 0.08, 0.56, 0.95), SEAT
    ),
    "three-seater": SizeDistribution(
        0.06, (1.66, 0.17, 1.30, 2.10), (1.04, 0.24, 0.58, 1.60), (0.93, 0.27, 0.52, 1.50), SEAT
    ),
}
"""Sizes of sofas to sit on. Length is the long side (y), width from front to back (x)."""


@dataclass(frozen=True)
class _Details:
    """What is drawn for every sofa, though not every kind uses it."""

    arm: float
    """Width of the arms [m]."""
    rise: float
    """Of the arms above the seat [m]."""
    thickness: float
    """Of the back [m]."""
    fancy: float
    """0 to 1, which back it has."""
    side: float
    """0 to 1, whether it has arms."""


BACKLESS = ("bench", "ottoman", "divan")


def make_sofa(index: int, seed: int = 0) -> SceneObject:
    """Sofa to sit on, number `index` of the family that `seed` names."""
    return build_sofa(f"sofa-{seed}-{index:05d}", "sofa", draw_sofa(rng(seed, "sofa", index)))


def draw_sofa(
    random: np.random.Generator, kinds: dict[str, SizeDistribution] = SOFAS, lying: bool = False
) -> SofaShape:
    """Draw one sofa of any of the kinds; one to lie on has an end for the head.

    Its arms are low enough, and its seat high enough, that the ankles of who lies on it are above half of its height.
    """
    kind = str(random.choice(list(kinds), p=[sizes.share for sizes in kinds.values()]))
    sizes = kinds[kind]
    # one scale for the whole sofa, and a stretch of each side by itself
    scale = random.standard_normal()
    length, width, height = (truncated(random, side, scale) for side in (sizes.length, sizes.width, sizes.height))
    seat = truncated(random, sizes.seat, 0.0)
    wood, fabric, accent = tint(random, WOODS), tint(random, FABRICS), tint(random, FABRICS)
    head = int(random.choice([-1, 1])) if lying else 0
    pillow = random.uniform(0.03, 0.05) if lying and random.uniform() < 0.6 else 0.0
    feet, plinth = random.uniform(0.05, 0.13), bool(random.uniform() < 0.3)
    recline, arm = random.uniform(0.08, 0.26), random.uniform(0.10, 0.19)
    rise, thickness = random.uniform(0.12, 0.22), random.uniform(0.09, 0.14)
    seats = int(np.clip(round(length / random.uniform(0.62, 0.85)), 1, 3))
    details = _Details(arm, rise, thickness, random.uniform(), random.uniform())
    basis = SofaShape(
        kind,
        length,
        width,
        height,
        seat,
        seats,
        recline=recline,
        feet=feet,
        plinth=plinth,
        head=head,
        pillow=pillow,
        wood=wood,
        fabric=fabric,
        accent=accent,
    )
    if kind in BACKLESS:
        return replace(basis, height=seat, back="none", cushion=0.08 if kind == "bench" else 0.12)
    if lying:
        seat = max(seat, height / 2 - 0.05)
    height = max(height, seat + {"settee": 0.2, "futon": 0.2, "lowback": 0.1}.get(kind, 0.14))
    basis = replace(basis, height=height, seat_height=seat)
    return _special(basis, details, lying) or _covered(random, basis, details, lying)


def _special(basis: SofaShape, details: _Details, lying: bool) -> SofaShape | None:
    """The sofa if it is of a kind whose parts follow from what was drawn already."""
    kind, width = basis.kind, basis.width
    between = (basis.length - MIN_BETWEEN_ARMS) / 2
    if kind == "daybed":
        return replace(
            basis, seats=1, back="rails" if details.fancy < 0.3 and lying else "none", arm_width=0.055, cushion=0.14
        )
    if kind == "chesterfield":
        arm = min(max(details.arm, 0.16) + 0.4 * max(width - 0.8, 0.0), between)
        return replace(basis, seats=2, arm_width=arm, pillow=0.0)  # its boxes are all in use
    if kind == "chaise":
        return replace(basis, back="panel" if details.fancy < 0.7 else "none", arm_width=0.13, cushion=0.12)
    if kind in ("settee", "futon"):
        soft = kind == "futon" or details.fancy < 0.5
        padding = 0.0 if not soft else 0.12 if width > 0.66 else 0.05
        return replace(
            basis,
            seats=1 if kind == "futon" else min(basis.seats, 2),
            back="cushions" if soft else "rails",
            back_thickness=0.035,
            back_cushion=padding,
            arms=(details.side < 0.8, details.side < 0.8),
            arm_width=0.055,
            arm_height=details.rise,
            cushion=0.13 if kind == "futon" else 0.08,
        )
    return None


def _covered(random: np.random.Generator, basis: SofaShape, details: _Details, lying: bool) -> SofaShape:
    """An upholstered sofa, perhaps with a chaise; its back is as thick as its depth asks for."""
    kind, width, height, seat = basis.kind, basis.width, basis.height, basis.seat_height
    chaise = random.uniform(0.58, 0.72) if kind == "sectional" else 0.0
    run = min(random.uniform(0.78, 0.95), width - 0.3) if chaise else 0.0
    loose = details.fancy < 0.65 and (run or width) > 0.66
    thickness = details.thickness * (0.6 if kind == "lowback" else 1.0)
    deepest, thickest = (MAX_LYING_DEPTH, 0.40) if lying else (MAX_SEAT_DEPTH, 0.55)
    thick = float(np.clip((run or width) - deepest - (height - seat) * np.tan(basis.recline), thickness, thickest))
    padding = 0.45 * thick if loose else 0.0
    # legs lie more easily over an end without arm
    open_end = bool(chaise) or (lying and details.side < 0.35)
    arms = (basis.head < 0, basis.head > 0) if open_end else (kind != "lowback" or details.side < 0.55,) * 2
    return replace(
        basis,
        back="cushions" if loose else "panel",
        back_thickness=thick - padding,
        back_cushion=padding,
        arms=arms,
        arm_width=min(details.arm, (basis.length - MIN_BETWEEN_ARMS) / 2),
        arm_height=min(details.rise, height - seat - 0.02),
        chaise=chaise,
        run=run,
    )


FAMILY = Family("sofa", make_sofa)
