"""What the elevation map is worth beside color and depth of the cameras that it is made of, to the same learner."""

from mimicbench.comparisons.spec import Comparison, Variant

COMPARISON = Comparison(
    "vision",
    "a clone that sees the elevation map, or color and depth",
    "imitate",
    (
        Variant("elevation map", counterpart="Elevation map"),
        Variant(
            "color and depth",
            {"imitate": {"network": {"inputs": {"views": True, "elevation": False}}}},
            counterpart="Color and depth, four cameras",
        ),
    ),
    common={"imitate": {"learner": "act"}},
    paper=("tab:vision_comparison",),
)
