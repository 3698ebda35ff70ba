"""Writes the table of the paper's full set into docs/retargeting.md: `python scripts/full_set.py WORKDIR`.

WORKDIR holds what this made, the retargeting in some 80 minutes on two cores:

    mimicbench retarget --task all --preset paper-size --method interaction --workdir WORKDIR
"""

import sys
from pathlib import Path

from measure_retargeting import put
from mimicbench.benchmark.finding import largest
from mimicbench.evaluate.intervals import Rate
from mimicbench.report.table import Table, to_markdown
from mimicbench.tasks.registry import TASKS

SHOWN = {
    "penetration": ("Frames > 1 cm in something [%]", 100),
    "contact_kept": ("Contact kept [%]", 100),
    "step_skate": ("Skating [cm per step]", 100),
    "self_collision": ("Frames in itself [%]", 100),
    "limit_violation": ("Beyond limits [deg]", 57.3),
}


def main() -> None:
    """Read the summaries and write the table."""
    rows = []
    for task, stage in largest(Path(sys.argv[1]), list(TASKS), "retarget", None).items():
        told = stage.summary
        measures = [
            round(told["measures"][name]["mean"] * factor, 2) if name in told["measures"] else None
            for name, (_, factor) in SHOWN.items()
        ]
        reasons = ", ".join(f"{name} {count}" for name, count in told["rejected_for"].items()) or "-"
        rows.append(
            (
                task,
                told["clips"],
                told["frames"],
                Rate(told["fulfilled"], told["clips"]),
                *measures,
                Rate(told["kept"], told["clips"]),
                reasons,
            )
        )
    columns = ("Task", "Clips", "Frames", "K", *(title for title, _ in SHOWN.values()), "Kept", "Kept out for")
    table = Table(
        "retargeting-full",
        "All clips of the paper's size, by `interaction`",
        columns,
        tuple(rows),
        "Measures: means over all clips, kept or not.",
    )
    put(table.name, to_markdown(table))


if __name__ == "__main__":
    main()
