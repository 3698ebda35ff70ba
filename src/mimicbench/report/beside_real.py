"""The judge's findings for readers: how surely synthetic people are told from real ones, by what, and their measures
side by side.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from mimicbench.references.checks.beside_real import Judgement, Person
from mimicbench.references.checks.people_measures import JOINTS, measure_people, share_within, strides_of
from mimicbench.references.paper import Spread
from mimicbench.report.table import Table


def judgement_table(found: Sequence[Judgement]) -> Table:
    """One row per phase."""
    return Table(
        "judgement",
        "Synthetic people told from real ones",
        ("Phase", "AUC", "Discriminative features [%]", "Recordings", "Real windows", "Clips", "Synthetic windows"),
        tuple(
            (
                row.phase,
                None if np.isnan(row.area) else f"{row.area:.3f}",
                f"{100 * row.discriminative:.0f}",
                row.recordings,
                row.real_windows,
                row.clips,
                row.synthetic_windows,
            )
            for row in found
        ),
        "AUC: of boosted stumps on windows of 1 s, over recordings and clips that they were not fitted to; 0.5 cannot "
        "be told apart. Discriminative features: those that alone have an AUC above 0.8 or below 0.2.",
    )


def features_table(found: Sequence[Judgement]) -> Table:
    """The features that best tell synthetic from real, per phase."""
    return Table(
        "features",
        "Most discriminative features",
        ("Phase", "Feature", "AUC alone", "Real", "Synthetic"),
        tuple(
            (row.phase if i == 0 else "", one.name, f"{one.area:.2f}", _spread(one.real), _spread(one.synthetic))
            for row in found
            for i, one in enumerate(row.features)
        ),
        "AUC alone: 1 if larger in every synthetic window, 0 if smaller. Rates per second, changes of rate per second "
        "squared; degrees and meters of a body of standard size.",
    )


def measures_table(real: Sequence[Person], tasks: Mapping[str, Sequence[Person]]) -> Table:
    """Measures of walking, sitting down and resting, one column per task beside the real ones."""
    columns = {"real": real, **tasks}
    found = {name: measure_people(people) for name, people in columns.items()}
    strides = {name: strides_of(people) for name, people in columns.items()}
    names = list(dict.fromkeys(name for measures in found.values() for name in measures))
    rows = [(name, *(_cell(measures.get(name)) for measures in found.values())) for name in names]
    for joint in JOINTS:
        shares = [share_within(curves, strides["real"])[joint] for curves in strides.values()]
        rows.append(
            (
                f"stride within a deviation of real, {joint} [%]",
                *(None if np.isnan(share) else f"{100 * share:.0f}" for share in shares),
            )
        )
    rows.append(("strides", *(str(len(curves.curves)) for curves in strides.values())))
    return Table(
        "measures",
        "Measures of synthetic and real people",
        ("", *columns),
        tuple(rows),
        "Means ± deviations over clips.",
    )


def _cell(value: Spread | None) -> str | None:
    if value is None or np.isnan(value[0]):
        return None
    return _spread(value) if value[1] else f"{value[0]:.3g}"


def _spread(value: Spread) -> str:
    return f"{value[0]:.3g} ± {value[1]:.2g}"
