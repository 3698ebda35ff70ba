"""Plots as SVG, the same bytes for the same numbers.

They stand alone, and can be put into a page that has its own colors.
"""

import io
import re
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mimicbench.core.errors import MimicbenchError
from mimicbench.evaluate.intervals import Rate
from mimicbench.report.curves import Curve
from mimicbench.report.grouping import Breakdown

INK, MUTED, LINE = "#1c2126", "#68727d", "#d9dee3"
SERIES = ("#0b7285", "#c2410c", "#6741d9", "#2b8a3e", "#a61e4d", "#5c940d", "#795548", "#1864ab")
"""Told apart by people who do not see all colors, and on light and dark ground."""
VARIABLES = {
    INK: "--ink",
    MUTED: "--muted",
    LINE: "--line",
    **{color: f"--series-{i}" for i, color in enumerate(SERIES)},
}
"""Color of a plot -> the page's variable that takes its place."""

_STYLE: Any = {
    "svg.fonttype": "none",
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "text.color": INK,
    "text.parse_math": False,  # names of policies are other people's, and may have a $
    "axes.labelcolor": MUTED,
    "axes.edgecolor": LINE,
    "axes.titlesize": 10.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": LINE,
    "grid.linewidth": 0.7,
    "xtick.color": MUTED,
    "ytick.color": MUTED,
    "xtick.major.size": 0,
    "ytick.major.size": 0,
    "legend.frameon": False,
    "lines.linewidth": 1.8,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
    "savefig.facecolor": "none",
}


def styled() -> AbstractContextManager[None]:
    """While it is open, figures are made in the style of this project."""
    return mpl.rc_context(_STYLE)


@dataclass(frozen=True)
class Mark:
    """One dot."""

    rate: Rate | float
    """Ours with its interval, or a published one in percent, drawn hollow."""
    color: int = 0
    """Index into SERIES."""


def panels(count: int, height: float, narrow: bool, share: bool = False) -> tuple[Figure, list[Axes]]:
    """A figure of so many panels, each `height` inches high: beside each other, or below each other for a phone.

    If they `share` their vertical axis, its labels stand once where they stand beside each other.
    """
    figure = Figure(figsize=(3.9, count * (height + 0.15)) if narrow else (9.2, height))
    axes = figure.subplots(count if narrow else 1, 1 if narrow else count, sharey=share and not narrow, squeeze=False)
    return figure, list(axes.flat)


def svg(figure: Figure, name: str) -> str:
    """A figure as SVG without date and metadata; `name` keeps its inner ids apart from other plots'."""
    stream = io.StringIO()
    with mpl.rc_context(_STYLE | {"svg.hashsalt": name}):
        figure.savefig(
            stream,
            format="svg",
            metadata={"Date": None, "Creator": None, "Format": None, "Type": None},
            bbox_inches="tight",
            pad_inches=0.04,
        )
    text = stream.getvalue()
    # matplotlib numbers its groups from 1 in every file; two plots in one page need different names
    return re.sub(r'\b(id="|href="#|url\(#)', rf"\g<1>{name}-", text)


def inline(plot: str) -> str:
    """The SVG as an element of an HTML page, in the page's colors."""
    body = plot[plot.index("<svg") :]
    body = re.sub(r"<metadata>.*?</metadata>", "", body, flags=re.DOTALL)
    body = re.sub(r'\sxmlns(:\w+)?="[^"]*"', "", body)
    body = re.sub(r'(<svg[^>]*?)\swidth="[^"]*"', r"\1", body, count=1)
    body = re.sub(r'(<svg[^>]*?)\sheight="([\d.]+)pt"', r'\1 role="img"', body, count=1)
    for color, variable in VARIABLES.items():
        body = body.replace(color, f"var({variable})")
    return body


def rates_plot(name: str, lines: Mapping[str, Sequence[tuple[str, Mark]]], narrow: bool = False) -> str:
    """Dots with intervals beside each other.

    Args:
        name: of the plot.
        lines: title -> lines (label, mark); all panels have the same labels in the same order.
        narrow: for a phone.
    """
    with mpl.rc_context(_STYLE):
        count = max(len(each) for each in lines.values())
        figure, axes = panels(len(lines), 0.55 + 0.27 * count, narrow, share=True)
        for axis, (title, each) in zip(axes, lines.items(), strict=True):
            for y, (_, mark) in enumerate(each):
                rate, color = mark.rate, SERIES[mark.color % len(SERIES)]
                if isinstance(rate, Rate):
                    _dot(axis, rate, y, color, 6.0)
                else:
                    axis.plot([rate], [y], "o", markersize=5.5, mfc="none", mec=color, mew=1.2)
            _percent(axis, title)
            axis.grid(axis="y", visible=False)
            axis.set_ylim(count - 0.4, -0.6)
            if axis is not axes[0] and not narrow:  # the labels stand at the left
                continue
            axis.set_yticks(range(count), [words for words, _ in each])
            for tick, (_, mark) in zip(axis.get_yticklabels(), each, strict=True):
                tick.set_color(INK if isinstance(mark.rate, Rate) else MUTED)
        figure.subplots_adjust(wspace=0.06, hspace=0.3)
        return svg(figure, name)


def _dot(axis: Axes, rate: Rate, y: float, color: str, size: float, words: str | None = None) -> None:
    """A rate with its interval."""
    ends = [100 * rate.low, 100 * rate.high]
    axis.plot(ends, [y, y], color=color, linewidth=0.44 * size, alpha=0.45, solid_capstyle="butt")
    axis.plot([100 * rate.rate], [y], "o", color=color, markersize=size, label=words)


def breakdown_plot(name: str, by_policy: Mapping[str, Sequence[Breakdown]], narrow: bool = False) -> str:
    """K over parts of the episodes: one panel per breakdown, one color per policy."""
    titles = list(dict.fromkeys(breakdown.title for breakdowns in by_policy.values() for breakdown in breakdowns))
    if not titles:
        raise MimicbenchError("there is nothing to break down: all episodes are alike")
    with mpl.rc_context(_STYLE):
        most = max(len(b.parts) for breakdowns in by_policy.values() for b in breakdowns)
        figure, axes = panels(len(titles), 0.8 + most * (0.20 + 0.12 * len(by_policy)), narrow)
        for axis, title in zip(axes, titles, strict=True):
            parts = list(dict.fromkeys(p for bs in by_policy.values() for b in bs if b.title == title for p in b.parts))
            for i, (policy, breakdowns) in enumerate(by_policy.items()):
                offset = (i - 0.5 * (len(by_policy) - 1)) * 0.7 / len(by_policy)
                rates = {p: r for b in breakdowns if b.title == title for p, r in b.parts.items()}
                for y, part in enumerate(parts):
                    if part in rates:
                        color, told = SERIES[i % len(SERIES)], policy if y == 0 else None
                        _dot(axis, rates[part], y + offset, color, 4.5, told)
            _percent(axis, title)
            axis.set_yticks(range(len(parts)), parts)
            axis.set_ylim(len(parts) - 0.4, -0.6)
            axis.grid(axis="y", visible=False)
        handles, labels = figure.axes[0].get_legend_handles_labels()
        if len(by_policy) > 1:
            figure.legend(
                handles,
                labels,
                loc="lower left",
                bbox_to_anchor=(0.0, 0.93) if narrow else (0.06, 0.97),
                ncols=1 if narrow else len(by_policy),
                borderaxespad=0,
            )
        figure.subplots_adjust(wspace=0.62, hspace=0.35)
        return svg(figure, name)


def failures_plot(name: str, by_policy: Mapping[str, Mapping[str, Rate]], narrow: bool = False) -> str:
    """Stacked bars: the share of each way to fail, per policy."""
    with mpl.rc_context(_STYLE):
        figure, (axis,) = panels(1, 0.95 + 0.3 * len(by_policy), narrow)
        kinds = list(dict.fromkeys(kind for failures in by_policy.values() for kind in failures))
        left = [0.0] * len(by_policy)
        for i, kind in enumerate(kinds):
            shares = [100 * failures[kind].rate if kind in failures else 0.0 for failures in by_policy.values()]
            if not any(shares):  # the others keep their colors, whatever happens
                continue
            axis.barh(range(len(by_policy)), shares, left=left, height=0.55, color=SERIES[i % len(SERIES)], label=kind)
            left = [a + b for a, b in zip(left, shares, strict=True)]
        for y, total in enumerate(left):
            axis.annotate(f"{total:.1f} %", (total, y), (5, 0), textcoords="offset points", va="center", color=MUTED)
        axis.set_yticks(range(len(by_policy)), list(by_policy))
        axis.set_ylim(len(by_policy) - 0.5, -0.5)
        axis.set_xlim(0, max(1.0, 1.15 * max(left, default=0)))
        axis.set_xlabel("% of all episodes")
        axis.grid(axis="y", visible=False)
        axis.legend(loc="lower left", bbox_to_anchor=(-0.01, 1.0), ncols=1 if narrow else 3, borderaxespad=0)
        return svg(figure, name)


_PANELS = (
    (
        "Success (K)",
        {"k": "K", "k_train": "training objects", "k_held_out": "unseen objects", "stays_held_out": "unseen, stays"},
        100.0,
    ),
    ("Reward", {"reward": "reward"}, 1.0),
    ("Training episodes that fail", {"failed": "failed"}, 100.0),
    ("Loss", {"loss": "loss"}, 1.0),
    # in the units of targets, so no matter of a loss that has parts besides
    ("Error on unseen episodes [rad]", {"validation_error": "error"}, 1.0),
)
"""Title, series that a training may record and what they are called, factor."""


def shown(curve: Curve) -> list[tuple[str, dict[str, str], float]]:
    """The panels that a training has something for; at most two."""
    panels = [
        (title, {key: word for key, word in names.items() if key in curve.series}, factor)
        for title, names, factor in _PANELS
    ]
    return [panel for panel in panels if panel[1]][:2]


def curve_plot(name: str, curve: Curve, narrow: bool = False) -> str:
    """A learning curve: success, reward, failures, loss or error, the first two that the training recorded."""
    told = shown(curve)
    if not told:
        raise MimicbenchError(
            f"the training {curve.name} recorded neither success nor reward nor loss; train it for longer"
        )
    with mpl.rc_context(_STYLE):
        # one panel alone is as wide as two: a page shows all plots at one width, and would enlarge its letters
        figure, axes = panels(len(told), 2.3, narrow)
        for axis, (title, names, factor) in zip(axes, told, strict=True):
            for i, (key, word) in enumerate(names.items()):
                points = curve.series[key]
                marker = "o" if len(points) < 30 else ""
                axis.plot(
                    [x for x, _ in points],
                    [factor * y for _, y in points],
                    color=SERIES[i],
                    label=word,
                    marker=marker,
                    markersize=3.5,
                )
            axis.set_title(title)
            axis.set_xlabel(curve.x)
            axis.xaxis.set_major_formatter(_thousands)
            axis.set_xlim(left=0)
            if factor == 100:
                axis.set_ylim(0, 102)
                axis.yaxis.set_major_formatter("{x:g} %")
            if len(names) > 1:
                axis.legend(loc="best")
        figure.subplots_adjust(hspace=0.55)
        return svg(figure, name)


def _thousands(value: float, _: object = None) -> str:
    return f"{value / 1e6:g}M" if value >= 1e6 else f"{value / 1e3:g}k" if value >= 1e4 else f"{value:g}"


def _percent(axis: Axes, title: str) -> None:
    axis.set_title(title)
    axis.set_xlim(-2, 102)
    axis.set_xticks([0, 25, 50, 75, 100], ["0", "25", "50", "75", "100 %"])
