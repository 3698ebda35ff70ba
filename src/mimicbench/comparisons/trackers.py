"""Designs of trackers, each trained on the same clips for as many samples."""

from mimicbench.comparisons.spec import Comparison, Variant

COMPARISON = Comparison(
    "trackers",
    "designs of trackers, trained alike",
    "track",
    (
        Variant("residual (ours)", {"track": {"tracker": "residual"}}),
        Variant("improved HST", {"track": {"tracker": "hst"}}, counterpart="Improved HST"),
        Variant("simplified PHC", {"track": {"tracker": "phc"}}, counterpart="Simplified PHC"),
        Variant("original HST", {"track": {"tracker": "hst-original"}}, counterpart="Original HST"),
    ),
    paper=("tab:supp_experiment_tracking",),
)
