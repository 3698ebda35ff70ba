"""One tracker on the clips of every way to retarget: the one that is shipped, or the recipe's own."""

from mimicbench.comparisons.spec import Comparison, Variant

COMPARISON = Comparison(
    "retargeting",
    "one tracker on the clips of every way to retarget",
    "track",
    (
        Variant("interaction", {"retarget": {"method": "interaction"}}),
        Variant("optimization", {"retarget": {"method": "optimization"}}, counterpart="Optimization"),
        Variant("OmniH2O", {"retarget": {"method": "omnih2o"}}, counterpart="OmniH2O"),
        Variant("copy-rotation", {"retarget": {"method": "copy-rotation"}}, counterpart="Copy-rotation"),
    ),
    learns=False,
    paper=("tab:retargeting_comparison",),
)
