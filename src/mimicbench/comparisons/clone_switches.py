"""What each switch of a clone is worth: as the paper has it, and with one thing changed."""

from mimicbench.comparisons.spec import Comparison, Variant


def _inputs(**values: object) -> dict:
    return {"imitate": {"network": {"inputs": values}}}


COMPARISON = Comparison(
    "clone-switches",
    "a clone of demonstrations with one thing changed",
    "imitate",
    (
        Variant("as it is"),
        Variant("clean demonstrations", {"demos": {"action_noise": 0.0, "push": 0.0}}),
        Variant("without its last action", _inputs(last_action=False)),
        Variant("clock", _inputs(clock=True)),
        Variant("memory of the start", _inputs(memory=True)),
        Variant("three frames", _inputs(history=3)),
        Variant("relative targets", {"imitate": {"network": {"relative": True}}}),
        Variant("DAgger", {"imitate": {"dagger": {"rounds": 6, "clips": 256}}}),
        Variant(
            "relative targets and DAgger",
            {"imitate": {"network": {"relative": True}, "dagger": {"rounds": 6, "clips": 256}}},
        ),
    ),
    common={"imitate": {"learner": "act"}},
)
