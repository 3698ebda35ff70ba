"""The report of one task: a page that stands alone, and beside it the same tables and plots as files."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO

from mimicbench.core.errors import MimicbenchError
from mimicbench.core.files import write_atomic
from mimicbench.drawing.opengl import NoPictures
from mimicbench.evaluate.failures import failure
from mimicbench.evaluate.rows import EpisodeRow, Summary, write_rows
from mimicbench.report import plots
from mimicbench.report.curves import Curve
from mimicbench.report.grouping import breakdowns, failures, label
from mimicbench.report.paper_tables import methods
from mimicbench.report.pictures.gallery import MOST_OBJECTS, counted, draw_failures, draw_objects
from mimicbench.report.pictures.showcase import draw
from mimicbench.report.sections import COMPARED, Pictures, ReportInputs, page_of
from mimicbench.report.sizes import of_policies, size_plot
from mimicbench.report.table import to_csv, to_latex, to_markdown
from mimicbench.report.tables.registry import TABLES
from mimicbench.report.tables.spec import Episodes


def write_report(
    folder: Path, inputs: ReportInputs, say: Callable[[str], None] | None = None, workers: int = 0, quiet: bool = True
) -> Path:
    """Write `index.html`, `tables/`, `plots/`, `media/` and `episodes.parquet` into `folder`; return the page's path.

    The page needs none of the others. The same inputs give the same files; pictures that are there already are not
    drawn again. `say` hears of pictures that had to be left out; unless `quiet` there is a progress bar for those that
    are drawn.
    """
    episodes = Episodes(inputs.rows, inputs.objects)
    found = episodes.summaries
    if strange := sorted({s.task for s in found} - {inputs.task}):
        raise MimicbenchError(f"a report is of one task; the rows for {inputs.task} also hold {', '.join(strange)}")
    if not found:
        raise MimicbenchError(
            f"there are no episodes of {inputs.task} to report; run `mimicbench evaluate --task {inputs.task}` first"
        )
    tables = [table for spec in TABLES.all() if spec.per_task for table in spec.of(episodes)]
    drawn, narrow = (draw_plots(inputs.task, episodes, inputs.curves, narrow) for narrow in (False, True))
    for data in tables:
        for suffix, write in (("md", to_markdown), ("tex", to_latex), ("csv", to_csv)):
            _write(folder / "tables" / f"{data.name}.{suffix}", write(data))
    for name, svg in drawn.items():
        _write(folder / "plots" / f"{name}.svg", svg)
    write_rows(folder / "episodes.parquet", episodes.ordered)
    try:
        pictures = _draw(inputs, episodes.methods[0][1], folder / "media", workers, quiet)
    except NoPictures as error:
        pictures = Pictures(str(error))
        if say:
            say(str(error))
    both = {name: (svg, narrow[name]) for name, svg in drawn.items()}
    html = page_of(inputs, episodes, {data.name: data for data in tables}, both, pictures)
    _write(folder / "index.html", html)
    return folder / "index.html"


def draw_plots(task: str, episodes: Episodes, curves: Sequence[Curve], narrow: bool = False) -> dict[str, str]:
    """All plots as SVG by name; `narrow` for a phone."""
    known = "-narrow" if narrow else ""  # plots of one page have different names within
    panels = {title: _lines(task, episodes.summaries, energy) for title, energy in (("K", False), ("K and P", True))}
    drawn = {"rates": plots.rates_plot(f"rates{known}", panels, narrow)}
    for i, curve in enumerate(curves):
        if not plots.shown(curve):  # stopped before it recorded anything
            continue
        drawn[f"curve-{i}"] = plots.curve_plot(f"curve-{i}{known}", curve, narrow)
    if any(failure(row) for row in episodes.rows):
        by_policy = {label(s): failures(rows) for s, rows in episodes.methods}
        drawn["failures"] = plots.failures_plot(f"failures{known}", by_policy, narrow)
    policies = [one for one in episodes.methods if one[0].stage == "imitate"][:COMPARED]
    trackers = [one for one in episodes.methods if one[0].stage == "track"][:1]
    parts = {label(s): breakdowns(rows, episodes.rows) for s, rows in (*policies, *trackers)}
    if any(parts.values()):
        drawn["breakdown"] = plots.breakdown_plot(f"breakdown{known}", parts, narrow)
    if by_size := of_policies(episodes):
        drawn["sizes"] = size_plot(f"sizes{known}", next(iter(by_size.values())), narrow)
    return drawn


def _lines(task: str, found: Sequence[Summary], energy: bool) -> list[tuple[str, plots.Mark]]:
    """Policies, then trackers, each followed by the paper's."""
    lines: list[tuple[str, plots.Mark]] = []
    for color, (stage, measures) in enumerate((("imitate", "imitation"), ("track", "tracking"))):
        ours = [s for s in found if s.stage == stage]
        lines += [(label(s), plots.Mark(s.energy if energy else s.kinematic, color)) for s in ours]
        for method, rate in methods(task, measures).items() if ours else ():
            lines.append((f"paper: {method}", plots.Mark(float(rate.energy if energy else rate.kinematic), color)))
    return lines


def _draw(inputs: ReportInputs, rows: Sequence[EpisodeRow], folder: Path, workers: int, quiet: bool) -> Pictures:
    """All pictures. `rows` are those of the best. Raises NoPictures."""
    if inputs.showcase is None:
        return Pictures()
    shown = draw(inputs.showcase, folder, inputs.show, workers, quiet)
    failed = draw_failures(inputs.failed, folder, inputs.show.fps, workers, quiet) if inputs.failed else []
    objects = counted(rows, list(inputs.objects.values()))[:MOST_OBJECTS]
    tiles = draw_objects(objects, folder, workers, quiet) if objects else []
    return Pictures(
        "", tuple(shown), tuple(zip(inputs.failed, failed, strict=True)), tuple(zip(objects, tiles, strict=True))
    )


def _write(path: Path, words: str) -> None:
    def write(stream: IO[bytes]) -> None:
        stream.write(words.encode())

    write_atomic(path, write)
