"""What stands on the page of a report, section by section."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import groupby
from pathlib import Path

from markupsafe import Markup

from mimicbench.evaluate.rows import ENERGY_LIMITS, EpisodeRow, Summary
from mimicbench.objects.shape import SceneObject
from mimicbench.report import page
from mimicbench.report.curves import Curve
from mimicbench.report.grouping import label
from mimicbench.report.paper_tables import CITATION, methods
from mimicbench.report.pictures.gallery import Counted, Failed
from mimicbench.report.pictures.showcase import Showcase, ShowConfig, Shown
from mimicbench.report.provenance import Provenance
from mimicbench.report.table import Table
from mimicbench.report.tables.spec import Episodes
from mimicbench.tasks.registry import TASKS
from mimicbench.tasks.task import Task

COMPARED = 3
"""Policies whose rates over parts of the episodes are plotted; the table has all."""
MAX_FAILED = 60
"""Failed episodes that a page lists; the table beside it has all."""
PLACED = ("beside-paper", "results", "energy", "failures", "failed", "breakdown", "sizes")
"""Tables that have their place on the page; others follow in a section of their own."""


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
    failed: tuple[Failed, ...] = ()
    """Episodes that failed, some of each policy."""
    show: ShowConfig = ShowConfig()
    """How they are drawn."""


@dataclass(frozen=True)
class Pictures:
    """What was drawn, or why nothing was."""

    missing: str = "No motions were given to show."
    shown: tuple[Shown, ...] = ()
    failed: tuple[tuple[Failed, Path], ...] = ()
    objects: tuple[tuple[Counted, Path], ...] = ()


def page_of(
    inputs: ReportInputs,
    episodes: Episodes,
    tables: Mapping[str, Table],
    drawn: Mapping[str, Sequence[str]],
    pictures: Pictures,
) -> str:
    """The whole page; `drawn` has each plot for a wide page and for a phone."""
    task, found = TASKS.get(inputs.task), episodes.summaries
    sections = [page.Section("From a person to a policy", _pictures_html(inputs, pictures))] if inputs.showcase else []
    beside = page.plot(
        drawn["rates"], "Filled: ours, with 95 % Wilson intervals. Hollow: as the paper reports them."
    ) + page.table(tables["beside-paper"])
    sections.append(page.Section("How an episode is judged", _judging_html(task)))
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
            page.Section(
                "How they were learned", page.joined(page.heading(name) + page.plot(svgs) for name, svgs in learned)
            )
        )
    sections.append(page.Section("Where failures happen", _failures_html(inputs.task, tables, drawn, pictures)))
    if others := [table for name, table in tables.items() if name not in PLACED]:
        shown = page.joined(page.heading(table.title) + page.table(table) for table in others)
        sections.append(page.Section("Further tables", shown))
    sections.append(page.Section("Where the numbers come from", _provenance_html(inputs.provenance)))
    footer = f"Written by mimicbench. The paper's numbers: {CITATION}."
    return page.page(
        task.title,
        f"mimicbench · {inputs.task}",
        _lead(*episodes.methods[0]),
        _tiles(inputs.task, found),
        sections,
        footer,
    )


def _lead(best: Summary, mine: Sequence[EpisodeRow]) -> str:
    objects = {row.object_id for row in mine}
    unseen = " that it never saw in training" if all(row.split == "test" for row in mine) else ""
    who = "policy" if best.stage == "imitate" else "tracker"
    k, n = best.kinematic.successes, best.kinematic.episodes
    return (
        f"The best {who}, {label(best)}, succeeds in {k:.0f} of {n} "
        f"episodes on {len(objects)} object{'s' * (len(objects) != 1)}{unseen}: "
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
            paper = f"the paper's best, by {method}: {their} %" if method and their is not None else ""
            tiles.append(
                page.Tile(
                    f"{word}, {what}", f"{100 * rate.rate:.1f}", "%", (f"{rate.interval()} · {rate.counts()}", paper)
                )
            )
    return tiles


def _judging_html(task: Task) -> Markup:
    """K, P and stays, each in a sentence."""
    lacks = ", ".join(part.words.replace("{} ", "") for part in task.shortfalls)
    when = "at the end" if task.in_last_frame else "at some time"
    when += f", for {task.hold_time:g} s without a break" if task.hold_time else ""
    limits = ", ".join(f"{limit / 1e6:.0f}e6" for limit in ENERGY_LIMITS)
    told = (
        f"K, whether the task is done: {when}, none of this is so: {lacks}. The time limit is {task.time_limit:g} s.",
        "P, whether it is done gently: the effort e, which is the sum over the joints of (torque × velocity)², stays "
        f"below a limit λ in every control step until K; λ is one of {limits} W², and “K and P” is the mean over them.",
        "Stays: K's condition holds at the time limit, too, and the robot has not fallen by then. The paper looks at K "
        "and P alone.",
        "In parentheses behind a method's name are the gains that drive the joints: “improved” are ours, stiffer in "
        "hips, knees and trunk and softer in the arms; “paper” are the paper's, the same for all joints.",
    )
    return page.judging(task.time_limit, task.hold_time) + page.joined(page.paragraph(words) for words in told)


def _pictures_html(inputs: ReportInputs, pictures: Pictures) -> Markup:
    if not pictures.shown:
        why = pictures.missing
        return page.paragraph(why[:1].upper() + why[1:] + ("" if why.endswith(".") else "."))
    assert inputs.showcase is not None
    obj = inputs.showcase.obj
    labeled = f", seat at {obj.seat_height:.2f} m" if obj.seat_height is not None else ""
    intro = page.paragraph(
        f"The same object in every row: {obj.id} ({obj.kind}{labeled}, {obj.split} split). From one moment "
        "to the next about as much happens."
    )
    strips = page.joined(page.stage(shown.clip.title, shown.clip.note, shown.strip) for shown in pictures.shown)
    films = [(f"{shown.clip.title}, {shown.seconds:.1f} s", shown.video) for shown in pictures.shown]
    rests = "All four at the same moment; who is done first rests in the last frame."
    return intro + strips + page.videos(films) + page.paragraph(rests.replace("four", str(len(films))), note=True)


def _failures_html(
    task: str, tables: Mapping[str, Table], drawn: Mapping[str, Sequence[str]], pictures: Pictures
) -> Markup:
    body = page.plot(drawn["failures"]) if "failures" in drawn else page.paragraph("No episode failed.")
    body += page.folded("How episodes fail, in numbers", page.table(tables["failures"]))
    for policy, films in groupby(pictures.failed, lambda one: one[0].row.policy):
        body += page.gallery(f"Some that failed: {policy}", ((one.caption, path) for one, path in films))
    if pictures.objects:
        body += page.heading("The best policy's objects, those with the most failures first")
        body += page.objects(
            (path, one.obj.id, one.obj.kind, round(one.rate.successes), one.rate.episodes)
            for one, path in pictures.objects
        )
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
    if failed := tables["failed"].rows:
        title = "The failed episode" if len(failed) == 1 else f"The {len(failed)} failed episodes"
        left_out = f"The first {MAX_FAILED} of {len(failed)}; tables/failed.csv has all."
        note = left_out if len(failed) > MAX_FAILED else ""
        shown = replace(tables["failed"], rows=failed[:MAX_FAILED], note=note)
        look = page.code(f"mimicbench view --task {task} --failed    # in this workdir: look at them")
        body += page.folded(title, page.table(shown) + look)
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
