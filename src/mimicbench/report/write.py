"""The report of one task: a page that stands alone, and beside it the same tables and plots as files."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import IO

from mimicbench.core.errors import MimicbenchError
from mimicbench.core.files import write_atomic
from mimicbench.evaluate.rows import EpisodeRow, Summary, group, write_rows
from mimicbench.objects.shape import SceneObject
from mimicbench.report import compare, plots, sizes
from mimicbench.report.curves import Curve
from mimicbench.report.paper_tables import methods
from mimicbench.report.pictures.gallery import MOST_OBJECTS, counted, draw_failures, draw_objects
from mimicbench.report.pictures.showcase import draw
from mimicbench.report.sections import COMPARED, Pictures, ReportInputs, page_of
from mimicbench.report.table import Table, to_csv, to_latex, to_markdown
from mimicbench.sensors.opengl import NoPictures


def write_report(
    folder: Path, inputs: ReportInputs, say: Callable[[str], None] | None = None, workers: int = 0, quiet: bool = True
) -> Path:
    """Write `index.html`, `tables/`, `plots/`, `media/` and `episodes.parquet` into `folder`; return the page's path.

    The page needs none of the others. The same inputs give the same files; pictures that are there already are not
    drawn again. `say` hears of pictures that had to be left out; unless `quiet` there is a progress bar for those that
    are drawn.
    """
    found = compare.summaries(inputs.rows)
    if strange := sorted({s.task for s in found} - {inputs.task}):
        raise MimicbenchError(f"a report is of one task; the rows for {inputs.task} also hold {', '.join(strange)}")
    if not found:
        raise MimicbenchError(
            f"there are no episodes of {inputs.task} to report; run `mimicbench evaluate --task {inputs.task}` first"
        )
    ordered = [
        row
        for s in found
        for row in inputs.rows
        if (row.stage, row.policy, row.preset) == (s.stage, s.policy, s.preset)
    ]
    of_sizes = _of_sizes(found, ordered, inputs.objects)
    tables = [*headline_tables(inputs.task, found), compare.failures_table(ordered), compare.breakdown_table(ordered)]
    drawn = draw_plots(inputs.task, found, ordered, inputs.curves)
    if of_sizes:
        tables.append(sizes.size_table(of_sizes))
        drawn["sizes"] = sizes.size_plot("sizes", next(iter(of_sizes.values())))
    for data in tables:
        for suffix, write in (("md", to_markdown), ("tex", to_latex), ("csv", to_csv)):
            _write(folder / "tables" / f"{data.name}.{suffix}", write(data))
    for name, svg in drawn.items():
        _write(folder / "plots" / f"{name}.svg", svg)
    write_rows(folder / "episodes.parquet", ordered)
    best = [row for row in ordered if (row.stage, row.policy) == (found[0].stage, found[0].policy)]
    try:
        pictures = _draw(inputs, best, folder / "media", workers, quiet)
    except NoPictures as error:
        pictures = Pictures(str(error))
        if say:
            say(str(error))
    html = page_of(inputs, found, ordered, {data.name: data for data in tables}, drawn, pictures)
    _write(folder / "index.html", html)
    return folder / "index.html"


def headline_tables(task: str, found: Sequence[Summary]) -> tuple[Table, Table, Table]:
    """Ours beside the paper's, all results, and the energy limits: for the terminal too."""
    return compare.beside_paper_table(task, found), compare.results_table(found), compare.energy_table(found)


def draw_plots(
    task: str, found: Sequence[Summary], rows: Sequence[EpisodeRow], curves: Sequence[Curve]
) -> dict[str, str]:
    """All plots as SVG by name."""
    drawn = {
        "rates": plots.rates_plot(
            "rates", {title: _lines(task, found, energy) for title, energy in (("K", False), ("K and P", True))}
        )
    }
    for i, curve in enumerate(curves):
        if not plots.shown(curve):  # stopped before it recorded anything
            continue
        drawn[f"curve-{i}"] = plots.curve_plot(f"curve-{i}", curve)
    by_policy = {compare.label(policy, preset): of_one for (_, _, policy, preset), of_one in group(rows).items()}
    if any(not row.success for row in rows):
        drawn["failures"] = plots.failures_plot(
            "failures", {name: compare.failures(of_one) for name, of_one in by_policy.items()}
        )
    shown = [*[s for s in found if s.stage == "imitate"][:COMPARED], *[s for s in found if s.stage == "track"][:1]]
    parts = {
        name: compare.breakdowns(by_policy[name], rows) for name in (compare.label(s.policy, s.preset) for s in shown)
    }
    if any(parts.values()):
        drawn["breakdown"] = plots.breakdown_plot("breakdown", parts)
    return drawn


def _of_sizes(
    found: Sequence[Summary], rows: Sequence[EpisodeRow], objects: Mapping[str, SceneObject]
) -> dict[str, dict[str, list[sizes.Part]]]:
    """Rates over sizes of every policy, the best first, all of whose objects are known."""
    told = {}
    for s in (s for s in found if s.stage == "imitate"):
        mine = [row for row in rows if (row.stage, row.policy, row.preset) == (s.stage, s.policy, s.preset)]
        if all(row.object_id in objects for row in mine) and (parts := sizes.by_size(mine, objects)):
            told[compare.label(s.policy, s.preset)] = parts
    return told


def _lines(task: str, found: Sequence[Summary], energy: bool) -> list[tuple[str, plots.Mark]]:
    """Policies, then trackers, each followed by the paper's."""
    lines: list[tuple[str, plots.Mark]] = []
    for color, (stage, measures) in enumerate((("imitate", "imitation"), ("track", "tracking"))):
        ours = [s for s in found if s.stage == stage]
        lines += [
            (compare.label(s.policy, s.preset), plots.Mark(s.energy if energy else s.kinematic, color)) for s in ours
        ]
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
