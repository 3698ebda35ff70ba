"""Who clones the same demonstrations best, by what the paper lets them see."""

from mimicbench.comparisons.spec import Comparison, Variant

COMPARISON = Comparison(
    "learners",
    "learners that clone the same demonstrations",
    "imitate",
    (
        Variant("ACT", {"imitate": {"learner": "act"}}, counterpart="ACT"),
        Variant("HIT", {"imitate": {"learner": "hit"}}, counterpart="HIT"),
        Variant("BC", {"imitate": {"learner": "bc"}}, counterpart="Behavior Cloning"),
        Variant("Diffusion Policy", {"imitate": {"learner": "diffusion"}}, counterpart="Diffusion Policy"),
    ),
    paper=("tab:supp_experiment_IL", "tab:IL_comparison"),
)
