"""A set of human clips for readers: the paper's table of statistics beside the paper's figures, how the clips vary,
and one picture.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mimicbench.references.checks.stats import SetStatistics
from mimicbench.references.paper import PAPER_SETS, Spread
from mimicbench.report.plots import INK, MUTED, SERIES, styled
from mimicbench.report.table import Table


def statistics_table(sets: Sequence[SetStatistics]) -> Table:
    """Numbers, sizes and durations; of the paper in the second line of each task."""
    rows = []
    for found in sets:
        sizes = (found.length, found.width, found.height)
        paper = PAPER_SETS.get(found.task)
        name = paper.abbreviation if paper else found.task
        rows.append((name, "here", found.objects, *map(_spread, sizes), found.clips, _spread(found.duration)))
        if paper:
            rows.append(
                (
                    name,
                    "paper",
                    paper.objects,
                    *map(_spread, (paper.length, paper.width, paper.height)),
                    paper.clips,
                    _spread(paper.duration),
                )
            )
    return Table(
        "references",
        "Objects and human clips",
        ("Task", "Of", "Objects", "Length [cm]", "Width [cm]", "Height [cm]", "Clips", "Duration [s]"),
        tuple(rows),
        "Means ± standard deviations.",
        "Paper: table of dataset statistics.",
    )


def variety_table(sets: Sequence[SetStatistics]) -> Table:
    """How much the clips of each task differ from each other."""
    rows = []
    for found in sets:
        v = found.variety
        rows.append(
            (
                _name(found.task),
                _spread(v.start_distance, 2),
                f"{v.start_bearing:.0f}",
                f"{v.start_heading:.2f}",
                _spread(v.path_length, 2),
                f"{v.path_spread:.2f}",
                _spread(v.walking_speed, 2),
                _spread(v.stature, 2),
                f"{100 * v.middle_pose:.1f}",
                f"{100 * v.final_pose:.1f}",
                len(v.style),
            )
        )
    columns = (
        "Task",
        "Start distance [m]",
        "Bearing ± [deg]",
        "Headings",
        "Path [m]",
        "Paths apart [m]",
        "Speed [m/s]",
        "Stature [m]",
        "Middle poses apart [cm]",
        "Final poses apart [cm]",
        "Choices",
    )
    note = (
        "Headings: 0 if all start with the same, 1 if they face anywhere. Speed: median while the "
        "pelvis moves. Apart: mean distance between two clips, "
        "of the pelvis at the same share of the clip, and of a joint seen from the pelvis at one "
        "body size. Choices: numbers that a clip draws beyond its "
        "start and object."
    )
    return Table("variety", "How the clips differ", columns, tuple(rows), note)


def style_table(sets: Sequence[SetStatistics]) -> Table:
    """Every choice that clips record, with its spread."""
    rows = tuple(
        (_name(found.task), name, f"{mean:.3g}", f"{deviation:.3g}")
        for found in sets
        for name, (mean, deviation) in found.variety.style.items()
    )
    return Table("styles", "What the clips choose", ("Task", "Choice", "Mean", "±"), rows)


def dataset_picture(sets: Sequence[SetStatistics], path: Path) -> None:
    """One PNG: per task durations, where people start, how fast they walk, and how large the objects are."""
    with styled():
        figure = Figure(figsize=(11.0, 2.3 * len(sets)), facecolor="white")
        grid = figure.subplots(len(sets), 4, squeeze=False)
        for row, found in zip(grid, sets, strict=True):
            paper, data = PAPER_SETS.get(found.task), found.samples
            _histogram(row[0], data.duration, "Duration [s]", paper.duration[0] if paper else None)
            row[0].set_ylabel(found.task, color=INK)
            row[1].plot(data.start_xy[:, 0], data.start_xy[:, 1], ".", markersize=1.5, color=SERIES[0], alpha=0.6)
            row[1].plot(0, 0, "s", color=SERIES[1], markersize=5)
            row[1].set(xlim=(-2.8, 2.8), ylim=(-2.4, 2.4), aspect="equal")
            row[1].set_title("Starts [m]; square: object")
            _histogram(row[2], data.walking_speed, "Median speed on the way [m/s]", None)
            for axis, (name, color) in enumerate(zip(("length", "width", "height"), SERIES, strict=False)):
                row[3].hist(data.size[:, axis], 24, histtype="step", color=color, label=name)
                if paper:
                    row[3].axvline(
                        (paper.length, paper.width, paper.height)[axis][0], color=color, linestyle=":", linewidth=1
                    )
            row[3].set_title("Objects [cm]")
            row[3].legend(fontsize=7, loc="upper right")
        figure.tight_layout()
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=110, metadata={"Software": None})


def _histogram(axis: Axes, values: np.ndarray, title: str, paper: float | None) -> None:
    values = values[np.isfinite(values)]
    if len(values):
        axis.hist(values, 24, color=SERIES[0], alpha=0.8)
    if paper is not None:
        axis.axvline(paper, color=MUTED, linestyle=":", linewidth=1.4)
    axis.set_title(title + ("; dotted: paper" if paper is not None else ""))


def _name(task: str) -> str:
    return PAPER_SETS[task].abbreviation if task in PAPER_SETS else task


def _spread(value: Spread, digits: int = 1) -> str:
    mean, deviation = value
    return "-" if np.isnan(mean) else f"{mean:.{digits}f} ± {deviation:.{digits}f}"
