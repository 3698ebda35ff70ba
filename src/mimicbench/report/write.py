"""The report of one task: a page that stands alone, and beside it the same tables and plots as files."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from markupsafe import Markup

from mimicbench.core.errors import MimicbenchError
from mimicbench.core.files import write_atomic
from mimicbench.evaluate.rows import EpisodeRow, Summary, group, write_rows
from mimicbench.objects.shape import SceneObject
from mimicbench.report import compare, page, plots, sizes
from mimicbench.report.curves import Curve
from mimicbench.report.paper_tables import CITATION, methods
from mimicbench.report.provenance import Provenance
from mimicbench.report.showcase import Showcase, ShowConfig, Shown, draw
from mimicbench.report.tables import Table, to_csv, to_latex, to_markdown
from mimicbench.sensors.opengl import NoPictures
from mimicbench.tasks.registry import TASKS

COMPARED = 3
"""Policies whose rates over parts of the episodes are plotted; the table has all."""


@dataclass(frozen=True)
class ReportInputs:
    """What a report is made of."""

    task: str
    """Slug of the task that all rows are of."""
    rows: tuple[EpisodeRow, ...]
    """Of all trackers and policies, in any order."""
    provenance: Provenance
    objects: Mapping[str, SceneObject] = field(default_factory=dict)
    """Those of the episodes by id, if success by their size shall be told."""
    curves: tuple[Curve, ...] = ()
    """Of the trainings, if there were any."""
    showcase: Showcase | None = None
    """Motions to show on one object."""
    show: ShowConfig = ShowConfig()
    """How they are drawn."""


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
    pictures = _draw(folder / "media", inputs, say, workers, quiet)
    _write(folder / "index.html", _page(inputs, found, ordered, {data.name: data for data in tables}, drawn, pictures))
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


def _draw(
    folder: Path, inputs: ReportInputs, say: Callable[[str], None] | None, workers: int, quiet: bool
) -> list[Shown] | str:
    """The pictures, or why there are none."""
    if inputs.showcase is None:
        return "No motions were given to show."
    try:
        return draw(inputs.showcase, folder, inputs.show, workers, quiet)
    except NoPictures as error:
        if say:
            say(str(error))
        return str(error)


def _page(
    inputs: ReportInputs,
    found: Sequence[Summary],
    rows: Sequence[EpisodeRow],
    tables: dict[str, Table],
    drawn: dict[str, str],
    pictures: list[Shown] | str,
) -> str:
    task = TASKS.get(inputs.task)
    sections = [page.Section("From a person to a policy", _pictures_html(inputs, pictures))] if inputs.showcase else []
    beside = page.plot(
        drawn["rates"], "Filled: ours, with 95 % Wilson intervals. Hollow: as the paper reports them."
    ) + page.table(tables["beside_paper"])
    sections.append(page.Section("Ours beside the paper's", beside))
    sections.append(
        page.Section(
            "All rates",
            page.table(tables["results"]) + page.folded("At each limit of the energy", page.table(tables["energy"])),
        )
    )
    learned = [(curve.name, drawn[name]) for i, curve in enumerate(inputs.curves) if (name := f"curve-{i}") in drawn]
    if learned:
        sections.append(
            page.Section("Learning", page.joined(page.heading(name) + page.plot(svg) for name, svg in learned))
        )
    sections.append(page.Section("Where failures happen", _failures_html(rows, tables, drawn)))
    sections.append(page.Section("Where the numbers come from", _provenance_html(inputs.provenance)))
    footer = f"Written by mimicbench. The paper's numbers: {CITATION}."
    return page.page(
        task.title, f"mimicbench · {inputs.task}", _lead(found, rows), _tiles(inputs.task, found), sections, footer
    )


def _lead(found: Sequence[Summary], rows: Sequence[EpisodeRow]) -> str:
    best = found[0]
    mine = [row for row in rows if (row.stage, row.policy, row.preset) == (best.stage, best.policy, best.preset)]
    objects = {row.object_id for row in mine}
    unseen = " that it never saw in training" if all(row.split == "test" for row in mine) else ""
    who = "policy" if best.stage == "imitate" else "tracker"
    k, n = best.kinematic.successes, best.kinematic.episodes
    return (
        f"The best {who}, {compare.label(best.policy, best.preset)}, succeeds in {k:.0f} of {n} "
        f"episodes on {len(objects)} objects{unseen}: "
        f"{best.kinematic.percent()}, with a 95 % interval of {best.kinematic.interval()} %."
    )


def _tiles(task: str, found: Sequence[Summary]) -> list[page.Tile]:
    tiles = []
    for stage, word, measures in (("imitate", "Best policy", "imitation"), ("track", "Best tracker", "tracking")):
        ours = [s for s in found if s.stage == stage]
        published = methods(task, measures)
        if not ours:
            continue
        method, theirs = next(iter(published.items()), (None, None))
        for what, rate, their in (
            ("K", ours[0].kinematic, theirs and theirs.kinematic),
            ("K and P", ours[0].energy, theirs and theirs.energy),
        ):
            paper = f"paper's best: {their} % ({method})" if method and their is not None else ""
            tiles.append(
                page.Tile(
                    f"{word}, {what}", f"{100 * rate.rate:.1f}", "%", (f"{rate.interval()} · {rate.counts()}", paper)
                )
            )
    return tiles


def _pictures_html(inputs: ReportInputs, pictures: list[Shown] | str) -> Markup:
    if isinstance(pictures, str):
        return page.paragraph(pictures[:1].upper() + pictures[1:] + ("" if pictures.endswith(".") else "."))
    assert inputs.showcase is not None
    obj = inputs.showcase.obj
    labeled = f", seat at {obj.seat_height:.2f} m" if obj.seat_height is not None else ""
    intro = page.paragraph(
        f"The same object in every row: {obj.id} ({obj.kind}{labeled}, {obj.split} split). Moments are "
        "chosen where as much has happened since the last one."
    )
    strips = page.joined(page.stage(shown.clip.title, shown.clip.note, shown.strip) for shown in pictures)
    return (
        intro + strips + page.videos((f"{shown.clip.title}, {shown.seconds:.1f} s", shown.video) for shown in pictures)
    )


def _failures_html(rows: Sequence[EpisodeRow], tables: dict[str, Table], drawn: dict[str, str]) -> Markup:
    failed = [row for row in rows if compare.failure(row)]
    body = page.plot(drawn["failures"]) if "failures" in drawn else page.paragraph("No episode failed.")
    body += page.folded("How episodes fail, in numbers", page.table(tables["failures"]))
    if "breakdown" in drawn:
        body += page.plot(
            drawn["breakdown"],
            f"K over parts of the episodes, with 95 % Wilson intervals: the best {COMPARED} policies "
            "and the best tracker.",
        )
        body += page.folded("The same in numbers", page.table(tables["breakdown"]))
    if "sizes" in drawn:
        body += page.plot(drawn["sizes"], "The best policy's success over the size of objects, a fifth at a time.")
        body += page.folded("The same of all policies, in numbers", page.table(tables["sizes"]))
    if failed:
        title = "The failed episode" if len(failed) == 1 else f"The {len(failed)} failed episodes"
        look = page.code(f"mimicbench view --task {failed[0].task} --failed    # in this workdir: look at them")
        body += page.folded(title, page.table(compare.failed_table(failed)) + look)
    return body


def _provenance_html(provenance: Provenance) -> Markup:
    body = page.facts({"seed": str(provenance.seed), **provenance.versions, **provenance.hardware})
    if provenance.commands:
        body += page.code("\n".join(provenance.commands))
    if provenance.made_from:
        body += page.folded("Fingerprints of the stages", page.facts(provenance.made_from))
    if provenance.config:
        body += page.folded("Configuration", page.code(json.dumps(provenance.config, indent=1, sort_keys=True)))
    return body


def _write(path: Path, words: str) -> None:
    def write(stream: IO[bytes]) -> None:
        stream.write(words.encode())

    write_atomic(path, write)
