"""Sofas to lie on (family `couch`), drawn with the statistics of the paper's table of objects: 191.2 +- 28.3 cm long,
86.7 +- 25.2 cm from front to back, 78.5 +- 25.7 cm high.
"""

from mimicbench.core.seeds import rng
from mimicbench.objects.families.draws import SizeDistribution
from mimicbench.objects.families.sofa import SEAT, draw_sofa
from mimicbench.objects.families.upholstery import build_sofa
from mimicbench.objects.family import Family
from mimicbench.objects.shape import SceneObject

COUCHES = {
    "couch": SizeDistribution(0.24, (1.90, 0.29, 1.50, 2.70), (0.86, 0.17, 0.66, 1.45), (0.98, 0.25, 0.60, 1.30), SEAT),
    "chesterfield": SizeDistribution(
        0.10, (1.92, 0.24, 1.55, 2.60), (0.82, 0.09, 0.70, 1.10), (0.80, 0.12, 0.62, 1.05), SEAT
    ),
    "sectional": SizeDistribution(
        0.14, (2.32, 0.24, 1.90, 2.85), (1.36, 0.17, 1.10, 1.75), (0.92, 0.18, 0.62, 1.25), SEAT
    ),
    "chaise": SizeDistribution(
        0.10, (1.78, 0.23, 1.45, 2.40), (0.71, 0.10, 0.63, 1.00), (0.92, 0.18, 0.62, 1.25), SEAT
    ),
    "futon": SizeDistribution(0.09, (1.84, 0.25, 1.45, 2.50), (0.81, 0.13, 0.66, 1.20), (0.90, 0.18, 0.62, 1.25), SEAT),
    "daybed": SizeDistribution(
        0.07, (1.88, 0.23, 1.50, 2.50), (0.74, 0.12, 0.56, 1.10), (0.84, 0.20, 0.56, 1.25), SEAT
    ),
    "divan": SizeDistribution(0.16, (1.74, 0.24, 1.35, 2.40), (0.70, 0.15, 0.50, 1.15), SEAT, SEAT),
    "bench": SizeDistribution(0.10, (1.78, 0.24, 1.35, 2.40), (0.64, 0.11, 0.48, 0.95), SEAT, SEAT),
}
"""Sizes of sofas to lie on."""


def make_couch(index: int, seed: int = 0) -> SceneObject:
    """Sofa to lie on, number `index` of the family that `seed` names."""
    return build_sofa(f"couch-{seed}-{index:05d}", "couch", draw_sofa(rng(seed, "couch", index), COUCHES, lying=True))


FAMILY = Family("couch", make_couch)
