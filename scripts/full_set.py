"""Writes the table of the paper's full set into docs/retargeting.md: `python scripts/full_set.py [WORKDIR]`.

The table is of the summaries in `runs/full-set`, one for each task. From WORKDIR they are taken first, for the tasks
whose clips are there; one task takes some three to forty minutes on two cores:

    mimicbench retarget --task TASK --preset paper-size --method interaction --workdir WORKDIR
"""

import sys
from pathlib import Path
from typing import Any

from measure_retargeting import put
from mimicbench.benchmark.finding import largest
from mimicbench.core.files import read_json, write_json
from mimicbench.evaluate.intervals import Rate
from mimicbench.report.table import Table, to_markdown
from mimicbench.tasks.registry import TASKS

RUN = Path(__file__).parents[1] / "runs" / "full-set"
SHOWN = {
    "penetration": ("Frames > 1 cm in something [%]", 100),
    "contact_kept": ("Contact kept [%]", 100),
    "step_skate": ("Skating [cm per step]", 100),
    "self_collision": ("Frames in itself [%]", 100),
    "limit_violation": ("Beyond limits [deg]", 57.3),
}
TAKEN = ("clips", "frames", "fulfilled", "kept", "rejected_for")
"""What is taken of a summary, beside the means of the measures that are shown."""


def take(workdir: Path) -> None:
    """Write the summary of every task whose clips are in a workdir."""
    for task, stage in largest(workdir, list(TASKS), "retarget", None).items():
        told = stage.summary
        means = {name: told["measures"][name]["mean"] for name in SHOWN if name in told["measures"]}
        write_json(RUN / f"{task}.json", {name: told[name] for name in TAKEN} | {"means": means})


def table() -> Table:
    """The table of all summaries that were taken."""
    rows = [_row(task, read_json(RUN / f"{task}.json")) for task in TASKS]
    columns = ("Task", "Clips", "Frames", "K", *(title for title, _ in SHOWN.values()), "Kept", "Kept out for")
    return Table(
        "retargeting-full",
        "All clips of the paper's size, by `interaction`",
        columns,
        tuple(rows),
        "Measures: means over all clips, kept or not.",
    )


def _row(task: str, told: dict[str, Any]) -> tuple[Any, ...]:
    means, clips = told["means"], told["clips"]
    shown = [round(means[name] * factor, 2) if name in means else None for name, (_, factor) in SHOWN.items()]
    reasons = ", ".join(f"{name} {count}" for name, count in told["rejected_for"].items()) or "-"
    return (
        task,
        clips,
        told["frames"],
        Rate(told["fulfilled"], clips),
        *shown,
        Rate(told["kept"], clips),
        reasons,
    )


def main() -> None:
    """Take the summaries of every workdir that is named, and write the table."""
    for folder in sys.argv[1:]:
        take(Path(folder))
    put("retargeting-full", to_markdown(table()))


if __name__ == "__main__":
    main()
