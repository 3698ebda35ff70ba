"""What mimicking people is worth: the paper's best pipeline, and PPO that has nobody to mimic. And planning, ours."""

from mimicbench.comparisons.spec import Comparison, Variant

COMPARISON = Comparison(
    "pipelines",
    "learning from people beside learning from nobody",
    "imitate",
    (
        Variant("planned online", {"imitate": {"learner": "online"}}),
        Variant("ACT on demonstrations", {"imitate": {"learner": "act"}}, counterpart="Best Combination"),
        Variant("PPO without people", {"imitate": {"learner": "ppo"}}, counterpart="PPO"),
    ),
    paper=("tab:pipeline_comparison",),
)
