"""How much more people teach: a clone of the demonstrations that come from parts of the human clips, or, where a policy
demonstrates that needs none, from parts of the starts.
"""

from mimicbench.comparisons.spec import Comparison, Variant

COMPARISON = Comparison(
    "data-scale",
    "a clone of 3 to 100 per cent of the people",
    "imitate",
    (
        Variant("100 %", counterpart="100 %"),
        Variant("30 %", share=0.3),
        Variant("10 %", share=0.1, counterpart="10 %"),
        Variant("3 %", share=0.03),
    ),
    common={"imitate": {"learner": "act"}},
    paper=("tab:data_scale_comparison",),
)
