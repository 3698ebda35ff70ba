"""What ACT's chunks are worth: how long they are, and whether what is carried out is their mean."""

from mimicbench.comparisons.spec import Comparison, Variant


def _network(**values: object) -> dict:
    return {"imitate": {"network": values}}


COMPARISON = Comparison(
    "chunks",
    "ACT with shorter chunks, longer ones, and the mean of all",
    "imitate",
    (
        Variant("25 frames", _network(chunk=25)),
        Variant("5 frames", _network(chunk=5)),
        Variant("50 frames", _network(chunk=50)),
        Variant("mean of the chunks", _network(ensembles=True)),
    ),
    common={"imitate": {"learner": "act"}},
)
