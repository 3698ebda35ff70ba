"""The table of a comparison: a row for each variant, beside the paper's."""

from collections.abc import Sequence

from mimicbench.comparisons.comparing import Compared, on_shared_clips
from mimicbench.comparisons.spec import Comparison
from mimicbench.evaluate.rows import summarize
from mimicbench.report.paper_tables import CITATION, TABLES, PaperRate
from mimicbench.report.table import Cell, Reported, Table


def comparison_table(comparison: Comparison, found: Sequence[Compared]) -> Table:
    """Rates of one task, in the order of the variants; the paper's columns only if it has any of these, those of shared
    clips only if the variants have different ones.
    """
    told = [summarize(one.rows) if one.rows else None for one in found]
    shared = on_shared_clips(found)
    task = next(s.task for s in told if s is not None)
    theirs = [paper_rate(comparison, one.variant.counterpart, task) for one in found]
    beside = any(rate is not None for rate in theirs)
    rows: list[tuple[Cell, ...]] = []
    for one, s, rate, same in zip(found, told, theirs, shared or found, strict=True):
        paper = (None, None) if rate is None else (Reported(rate.kinematic), Reported(rate.energy))
        k, energy, stays, fell = (None,) * 4 if s is None else (s.kinematic, s.energy, s.stays, s.fell)
        cells = (k, paper[0], energy, paper[1]) if beside else (k, energy)
        if shared is not None:
            both = summarize(same.rows) if same.rows else None
            cells = (*cells, *((None, None) if both is None else (both.kinematic, both.energy)))
        rows.append((one.variant.label, *cells, stays, fell))
    rates = ("K, ours", "K, paper", "K and P, ours", "K and P, paper") if beside else ("K", "K and P")
    if shared is not None:
        rates = (*rates, "K, shared clips", "K and P, shared clips")
    return Table(
        comparison.name,
        f"{comparison.what[0].upper()}{comparison.what[1:]} ({task})",
        ("Variant", *rates, "Stays", "Fell"),
        tuple(rows),
        " ".join(
            [
                "Rates with 95 % Wilson intervals and k/n, "
                + ("on the same people and objects." if shared is None else _unlike(shared)),
                *(f"{one.variant.label}: {one.problem}." for one in found if one.problem),
            ]
        ),
        CITATION if beside else "",
    )


def _unlike(shared: Sequence[Compared]) -> str:
    """What a table has to say whose variants were judged on different clips."""
    count = max(len(one.rows) for one in shared)
    return (
        "each on the clips that its retargeting keeps, which are partly of other people and objects. Only the columns "
        f"of shared clips compare like with like: on the {count} clips that all who were judged have."
    )


def paper_rate(comparison: Comparison, counterpart: str, task: str) -> PaperRate | None:
    """What the paper says of a row at a task, where it says anything."""
    measures = "tracking" if comparison.of == "track" else "imitation"
    for label in comparison.paper:
        for table in TABLES:
            if table.label == label and table.measures == measures and task in table.rates.get(counterpart, {}):
                return table.rates[counterpart][task]
    return None
