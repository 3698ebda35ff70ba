"""Writes the tables of results into README.md, docs/results.md, docs/orderings.md and the page of
`runs/retargeting-tracked`, from the episode rows in `runs/`, and which policies are the best of those that are shipped;
and those tables of docs/senses.md, docs/robot.md and docs/tracker.md that follow from the code.

`runs/<task>` holds the best of a task, whose rows are in the README's table; other folders are of several tasks, or of
what came before. A test fails where a page says something else than the rows.
"""

import json
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path

from doc_pages.methods import inputs_table
from doc_pages.robots import gains_table, joints_table
from doc_pages.settings import own_settings, settings_table
from doc_pages.tasks import terms_table
from mimicbench.benchmark.shipped import BEST, SHIPPED
from mimicbench.comparisons.comparing import Compared
from mimicbench.comparisons.registry import COMPARISONS
from mimicbench.evaluate.intervals import Rate
from mimicbench.evaluate.rows import EpisodeRow, group, read_rows, summarize
from mimicbench.report.table import to_markdown
from mimicbench.report.tables.best import best_policy
from mimicbench.report.tables.comparison import comparison_table
from mimicbench.report.tables.registry import TABLES
from mimicbench.report.tables.spec import Episodes
from mimicbench.robots.registry import DEFAULT_ROBOT, ROBOTS
from mimicbench.tasks.registry import TASKS
from mimicbench.track.learning.ppo_config import PPOConfig
from mimicbench.track.settings import DistillConfig, TrackingConfig

ROOT = Path(__file__).parents[1]
README, RESULTS, ORDERINGS = ROOT / "README.md", ROOT / "docs" / "results.md", ROOT / "docs" / "orderings.md"

COMPARED = {
    "data-scale": "sit-chair-data-scale",
    "learners": "sit-chair-learners",
    "clone-switches": "sit-chair-switches",
    "vision": "sit-chair-vision",
    "tracker-parts": "lift-box-parts",
}
"""Folder in `runs/` of each comparison whose table is in the orderings."""
TRACKED = ROOT / "runs" / "retargeting-tracked" / "README.md"
"""The page of a comparison at several tasks, beside its rows."""
PEOPLE = ("learned from", "held out")
"""What recorded people are to a tracker."""


def rows_of(folder: Path) -> list[EpisodeRow]:
    """All episode rows of a run."""
    return [row for path in sorted((folder / "evaluate").glob("*.parquet")) for row in read_rows(path)]


def best() -> str:
    """The table of the best of every task: of its own run, or else of the tracker that serves all."""
    several = rows_of(ROOT / "runs" / "six-tasks")
    own = {task: rows_of(ROOT / "runs" / task) for task in TASKS}
    return table_of("best", [row for task in TASKS for row in own[task] or several if row.task == task])


def best_policies() -> str:
    """The same as a file: which policy of ours has done best at each task."""
    rows = {task: rows_of(ROOT / "runs" / task) for task in TASKS}
    found = {task: best_policy(Episodes(tuple(rows[task])).summaries) for task in TASKS}
    return json.dumps({task: one.policy for task, one in found.items() if one is not None}, indent=1) + "\n"


def table_of(name: str, rows: Sequence[EpisodeRow]) -> str:
    """The one table of this name."""
    (table,) = TABLES.get(name).of(Episodes(tuple(rows)))
    return to_markdown(table)


def of_run(folder: Path) -> str:
    """The table of one run: of its task, or of the best of several."""
    rows = rows_of(folder)
    return table_of("best" if len({row.task for row in rows}) > 1 else "beside-paper", rows)


def recorded(parts: Mapping[str, Path], totals: Sequence[str] = ()) -> str:
    """A row for each file of episodes with recorded people, and one for each of the recordings in it.

    And before them one for all files whose titles end in each of `totals`.
    """
    lines = ["| | recordings | K | K and P | stays |", "|---|---|---:|---:|---:|"]
    for words in totals:
        paths = [path for title, path in parts.items() if title.endswith(words)]
        lines.append(_recorded(f"**all, {words}**", "", [row for path in paths for row in read_rows(path)]))
    for title, path in parts.items():
        people = defaultdict[str, list[EpisodeRow]](list)
        for row in read_rows(path):
            people[row.reference_id.partition("~")[0].removeprefix("real-").rpartition("-")[0]].append(row)
        if len(people) > 1:
            lines.append(_recorded(title, str(len(people)), [row for each in people.values() for row in each]))
        lines += [_recorded("" if len(people) > 1 else title, f"`{name}`", people[name]) for name in sorted(people)]
    return "\n".join(lines) + "\n"


def _recorded(title: str, people: str, rows: Sequence[EpisodeRow]) -> str:
    parts = [summarize(part) for part in group(rows).values()]
    rates = [[getattr(part, name) for part in parts] for name in ("kinematic", "energy", "stays")]
    sums = [Rate(sum(rate.successes for rate in each), len(rows)) for each in rates]
    return " | ".join([f"| {title}", people, *map(str, sums)]) + " |"


def trained(folder: Path) -> str:
    """A row for each task: its shipped tracker on clips of training objects, and on those of unseen ones."""
    lines = [
        "| | K, training objects | K and P | stays | K, unseen objects | stays |",
        "|---|---:|---:|---:|---:|---:|",
    ]
    for task in TASKS.all():
        seen = summarize(read_rows(folder / "rows" / f"{task.name}.parquet"))
        unseen = summarize(read_rows(ROOT / "runs" / task.name / "evaluate" / "tracker.parquet"))
        rates = (seen.kinematic, seen.energy, seen.stays, unseen.kinematic, unseen.stays)
        lines.append(" | ".join([f"| {task.abbreviation}", *map(str, rates)]) + " |")
    return "\n".join(lines) + "\n"


def compared(name: str, folder: Path, begin: str = "") -> str:
    """The table of a comparison, as far as there are rows: in files whose names begin so, and go on with the variants'
    labels.
    """
    comparison = COMPARISONS.get(name)
    paths = [(one, folder / "rows" / f"{begin}{file_of(one.label)}.parquet") for one in comparison.variants]
    found = [Compared(one, None, read_rows(path)) for one, path in paths if path.exists()]
    return to_markdown(comparison_table(comparison, found))


def file_of(label: str) -> str:
    """What the file of a variant's rows is called."""
    return label.removesuffix(" %").replace(" ", "-")


def with_table(page: str, name: str, table: str) -> str:
    """A page with the table between the marks of that name; the page as it is without such marks."""
    begin, end = f"<!-- {name} -->\n", f"<!-- /{name} -->"
    before, found, rest = page.partition(begin)
    return page if not found else before + begin + table + end + rest.partition(end)[2]


def pages() -> dict[Path, str]:
    """The pages as they ought to be."""
    results = RESULTS.read_text()
    for folder in sorted(path.parent for path in (ROOT / "runs").glob("*/evaluate")):
        results = with_table(results, f"runs/{folder.name}", of_run(folder))
    starts, sitting, lying, hands = (
        ROOT / "runs" / name / "rows"
        for name in ("real-starts", "real-people", "real-people-lying", "real-people-hands")
    )
    results = with_table(results, "real-starts", recorded({f"`{task}`": starts / f"{task}.parquet" for task in TASKS}))
    followed = {
        f"`{task}`, {words}": folder / f"{task}-{split}.parquet"
        for folder, tasks in (
            (sitting, ("sit-chair", "sit-sofa")),
            (lying, ("lie-bed", "lie-sofa")),
            (hands, ("touch-points", "lift-box")),
        )
        for task in tasks
        for split, words in zip(("learn", "judge"), PEOPLE, strict=True)
    }
    results = with_table(results, "real-people", recorded(followed, PEOPLE))
    results = with_table(results, "training-objects", trained(ROOT / "runs" / "training-objects"))
    orderings = ORDERINGS.read_text()
    for name, folder in COMPARED.items():
        orderings = with_table(orderings, name, compared(name, ROOT / "runs" / folder))
    tracked = TRACKED.read_text()
    for task in ("sit-chair", "touch-points"):
        tracked = with_table(tracked, task, compared("retargeting", TRACKED.parent, f"{task}-"))
    readme = with_table(README.read_text(), "results", best())
    of_rows = {README: readme, RESULTS: results, ORDERINGS: orderings, TRACKED: tracked}
    return {**of_rows, SHIPPED / BEST: best_policies(), **from_code()}


def from_code() -> dict[Path, str]:
    """Pages with tables that follow from the code, as they ought to be."""
    robot = ROBOTS.get(DEFAULT_ROBOT)
    tables = {
        "senses": {"terms": terms_table(robot)},
        "robot": {"joints": joints_table(robot), "gains": gains_table(robot)},
        "tracker": {
            "inputs": inputs_table(robot),
            **{f"reward-{name}": own_settings("track", "tracker", name) for name in ("residual", "hst")},
            "tracking": settings_table(TrackingConfig, "track.tracking", set()),
            "ppo": settings_table(PPOConfig, "track.ppo", set()),
            "distill": settings_table(DistillConfig, "track.distill", set()),
        },
    }
    found = {}
    for name, written in tables.items():
        path = ROOT / "docs" / f"{name}.md"
        found[path] = path.read_text()
        for mark, table in written.items():
            found[path] = with_table(found[path], mark, f"\n{table}\n\n")
    return found


def main() -> None:
    """Write them."""
    for path, text in pages().items():
        path.write_text(text)


if __name__ == "__main__":
    main()
