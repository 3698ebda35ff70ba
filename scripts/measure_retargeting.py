"""Measures the tables of docs/retargeting.md and docs/retargeting-compared.md.

Called by `python scripts/measure_retargeting.py [workdir [workdir of real clips]]`.

Objects and clips are made in the workdir unless they are there. Real clips are those that `mimicbench import` made;
without them their tables stay as they are in the file. Pictures need OpenGL.
"""

import re
import sys
from pathlib import Path

from mimicbench.bench.retargeting import ClipsConfig, bench, speed_table
from mimicbench.benchmark import Recipe
from mimicbench.benchmark.finding import stages_of
from mimicbench.core.run import RunContext
from mimicbench.objects.make import ObjectsConfig
from mimicbench.references.settings import ReferencesConfig
from mimicbench.report.methods import compare_methods
from mimicbench.report.provenance import this_machine
from mimicbench.report.table import Table, to_markdown
from mimicbench.retarget.baselines.speed import RetargetBenchConfig
from mimicbench.tasks.registry import TASKS

PAGES = [Path(__file__).parents[1] / "docs" / name for name in ("retargeting.md", "retargeting-compared.md")]
OBJECTS, CLIPS = 32, 16
"""Of each task."""
RECORDED = "recorded"
"""Name of the imported set."""


def main() -> None:
    """Measure, and write the tables into the page."""
    workdir = Path(sys.argv[1] if len(sys.argv) > 1 else "work/retargeting")
    objects, clips = ObjectsConfig(count=OBJECTS), ReferencesConfig(count=CLIPS)
    recipes = [Recipe(task, objects=objects, references=clips) for task in TASKS]
    context = RunContext()
    tables: list[Table] = []
    for variant in ("paper", "improved"):
        found = compare_methods(recipes, variant, workdir, workdir / f"retarget-{variant}", variant == "paper", context)
        # times are told once, by the bench; and the order is a claim about the paper's own
        tables += [
            renamed(without(table, "Frames/s of a core"), variant)
            for table in found.tables()[: 3 if variant == "paper" else 2]
        ]
    if len(sys.argv) > 2:
        real = Path(sys.argv[2])
        tasks = [task for task in TASKS if stages_of(real, task, "references")]
        recipes = [Recipe(task, references=ReferencesConfig(source=RECORDED)) for task in tasks]
        found = compare_methods(recipes, "paper", real, real / "retarget-paper", True, context)
        tables += [renamed(without(table, "Frames/s of a core"), "real") for table in found.tables()[:2]]
    measured = bench(ClipsConfig(tuple(TASKS)), RetargetBenchConfig(), say)
    tables.append(speed_table(measured, tuple(TASKS)))
    for table in tables:
        put(table.name, to_markdown(table))
    machine = this_machine()
    put(
        "machine",
        f"Measured on {machine['cores']} cores of {machine['processor']}; {CLIPS} clips of each task "
        f"on {OBJECTS} objects, seed 0.\n",
    )


def without(table: Table, column: str) -> Table:
    """The table without one of its columns."""
    if column not in table.columns:
        return table
    at = table.columns.index(column)
    rows = tuple((*row[:at], *row[at + 1 :]) for row in table.rows)
    return Table(
        table.name, table.title, (*table.columns[:at], *table.columns[at + 1 :]), rows, table.note, table.source
    )


def renamed(table: Table, variant: str) -> Table:
    """The table with the variant in its name and title."""
    return Table(
        f"{table.name}-{variant}", f"{table.title} ({variant})", table.columns, table.rows, table.note, table.source
    )


def put(name: str, words: str) -> None:
    """Write between the two marks of a name, on the page that has them."""
    pattern = re.compile(rf"(<!-- {re.escape(name)} -->\n).*?(<!-- end -->)", re.S)
    for page in PAGES:
        text = page.read_text()
        if pattern.search(text):
            page.write_text(pattern.sub(lambda match: match[1] + words + match[2], text, count=1))
            return
    raise SystemExit(f"no page has a place for {name}")


def say(line: str) -> None:
    """Progress."""
    print(line, file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
