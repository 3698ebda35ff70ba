"""Pictures of what was measured, from the episode rows in `runs/`."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from doc_pictures.picture import DocPicture
from mimicbench.evaluate.rows import read_rows
from mimicbench.objects.registry import make_object
from mimicbench.report.plots import styled
from mimicbench.report.sizes import SIZES, Part, by_size, draw_sizes
from mimicbench.tasks.registry import TASKS

RUNS = Path(__file__).parents[2] / "runs"
POLICY = "online"
Sizes = Mapping[str, Sequence[Part]]


def found() -> dict[str, Sizes]:
    """Of every task what its best policy comes to over the size of objects."""
    told = {}
    for task in TASKS:
        rows = read_rows(RUNS / task / "evaluate" / f"{POLICY}.parquet")
        told[task] = by_size(rows, {name: make_object(name) for name in {row.object_id for row in rows}})
    return told


def arrays(shown: Mapping[str, Sizes]) -> list[np.ndarray]:
    """Borders of the parts and their counts."""
    return [
        np.array([(p.low, p.high, p.kinematic.successes, p.stays.successes, p.stays.episodes) for p in parts])
        for sizes in shown.values()
        for parts in sizes.values()
    ]


def draw(shown: Mapping[str, Sizes]) -> np.ndarray:
    """A row for each task, a column for each size."""
    with styled():
        figure = Figure(figsize=(9.6, 1.75 * len(shown)), dpi=110, facecolor="white")
        canvas = FigureCanvasAgg(figure)
        for axes, (task, sizes) in zip(figure.subplots(len(shown), len(SIZES)), shown.items(), strict=True):
            for axis, size in zip(axes, SIZES, strict=True):
                draw_sizes(axis, size, sizes[size])
            axes[0].set_title(TASKS.get(task).title)
        figure.axes[0].legend(loc="lower left")
        figure.tight_layout()
        canvas.draw()
        return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def pictures() -> list[DocPicture]:
    """The one."""
    return [DocPicture("success-by-size.png", found, arrays, draw)]
