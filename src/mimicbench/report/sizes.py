"""Success by the size of objects, as in the paper's figure of lying on beds.

Length and width are the longer and the shorter side of the bounding rectangle on the floor, height is that of the
surface to sit or lie on, and of the whole where there is none.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from mimicbench.evaluate.intervals import Rate
from mimicbench.evaluate.rows import EpisodeRow
from mimicbench.objects.shape import SceneObject
from mimicbench.report.grouping import label
from mimicbench.report.plots import SERIES, panels, styled, svg
from mimicbench.report.tables.spec import Episodes

SIZES = ("length", "width", "height")
PARTS = 5
"""Parts of the episodes, of about as many each, that a size divides them into."""


@dataclass(frozen=True)
class Part:
    """Episodes beside objects of about one size."""

    low: float
    """The smallest [m]."""
    high: float
    """The largest [m]."""
    kinematic: Rate
    stays: Rate


def size_of(obj: SceneObject) -> tuple[float, float, float]:
    """Length, width and height of an object [m]."""
    low, high = obj.bounds()
    width, length = sorted((high - low)[:2].tolist())
    return length, width, float(high[2]) if obj.seat_height is None else obj.seat_height


def by_size(rows: Sequence[EpisodeRow], objects: Mapping[str, SceneObject]) -> dict[str, list[Part]]:
    """Of each of SIZES the rates over parts of the episodes, from small to large; no episode is in two of them.

    A size of which all objects have the same is left out.
    """
    sizes = np.array([size_of(objects[row.object_id]) for row in rows]).reshape(-1, len(SIZES))
    found = {}
    for name, values in zip(SIZES, sizes.T, strict=True):
        edges = np.unique(np.quantile(values, np.linspace(0, 1, PARTS + 1)[1:-1])) if len(values) else values
        part = np.searchsorted(edges, values, side="left")
        parts = [np.flatnonzero(part == i) for i in range(len(edges) + 1)]
        told = [_part(values[of], [rows[i] for i in of.tolist()]) for of in parts if len(of)]
        if len(told) > 1:
            found[name] = told
    return found


def _part(values: np.ndarray, rows: Sequence[EpisodeRow]) -> Part:
    rates = (Rate(sum(row.success for row in rows), len(rows)), Rate(sum(row.stays for row in rows), len(rows)))
    return Part(float(values.min()), float(values.max()), *rates)


def of_policies(episodes: Episodes) -> dict[str, dict[str, list[Part]]]:
    """Rates over sizes of every policy, the best first, all of whose objects are known."""
    told = {}
    for s, rows in episodes.methods:
        known = s.stage == "imitate" and all(row.object_id in episodes.objects for row in rows)
        if known and (parts := by_size(rows, episodes.objects)):
            told[label(s)] = parts
    return told


def size_plot(name: str, found: Mapping[str, Sequence[Part]], narrow: bool = False) -> str:
    """K and stays over each size, as SVG."""
    with styled():
        figure, axes = panels(len(found), 2.3, narrow)
        for axis, (size, parts) in zip(axes, found.items(), strict=True):
            draw_sizes(axis, size, parts)
        figure.axes[0].legend(loc="lower left")
        figure.subplots_adjust(wspace=0.25, hspace=0.45)
        return svg(figure, name)


def draw_sizes(axis: Axes, size: str, parts: Sequence[Part]) -> None:
    """K and stays over one size: a line across the sizes of each part, with its 95 % interval."""
    beside = 0.006 * (parts[-1].high - parts[0].low)  # so that both intervals are seen
    for number, part in enumerate(parts):
        for word, rate, color, wide, aside in (
            ("K", part.kinematic, SERIES[0], 5.0, -beside),
            ("stays", part.stays, SERIES[1], 1.8, beside),
        ):
            middle, told = 0.5 * (part.low + part.high) + aside, word if number == 0 else None
            axis.plot(
                [part.low, part.high],
                [100 * rate.rate] * 2,
                color=color,
                linewidth=wide,
                alpha=0.5 if wide > 2 else 1.0,
                label=told,
                solid_capstyle="butt",
            )
            axis.plot([middle] * 2, [100 * rate.low, 100 * rate.high], color=color, linewidth=1.6, alpha=0.45)
            axis.plot([middle], [100 * rate.rate], "o", color=color, markersize=4)  # objects of one size have no line
    axis.set_xlabel(f"{size} [m]")
    axis.xaxis.set_major_locator(MaxNLocator(4))
    axis.set_ylim(-2, 108)
    axis.set_yticks([0, 25, 50, 75, 100], ["0", "25", "50", "75", "100 %"])
