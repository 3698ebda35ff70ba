"""What the documents say: the README's results follow from the rows kept in the repository, and the scripts beside
the pages can run.
"""

import importlib
from pathlib import Path

import pytest

from mimicbench.evaluate.rows import read_rows
from mimicbench.report.compare import beside_paper_table, summaries
from mimicbench.report.tables import to_markdown
from mimicbench.tasks.registry import TASKS

ROOT = Path(__file__).parents[1]


def test_results_in_the_readme_follow_from_the_rows():
    readme = (ROOT / "README.md").read_text()
    shown = readme.split("<!-- results -->")[1].split("<!-- /results -->")[0]
    for folder in sorted((ROOT / "runs").glob("*/evaluate")):
        rows = [row for path in sorted(folder.glob("*.parquet")) for row in read_rows(path)]
        assert rows, f"{folder} holds no episode rows"
        tasks = [task for task in TASKS if task in {row.task for row in rows}]
        if len(tasks) > 1:  # one tracker, a column for each task
            of_tasks = [[row for row in rows if row.task == task] for task in tasks]
            k = [(sum(row.success for row in some), len(some)) for some in of_tasks]
            assert "| K | " + " | ".join(f"{hits} ({100 * hits / n:.0f} %)" for hits, n in k) + " |" in readme
            stays = [sum(row.stays for row in some) for some in of_tasks]
            assert "| stays | " + " | ".join(map(str, stays)) + " |" in readme
            continue
        assert to_markdown(beside_paper_table(folder.parent.name, summaries(rows))) in shown


def test_rows_are_of_unseen_objects():
    for path in (ROOT / "runs").glob("*/evaluate/*.parquet"):
        assert {row.split for row in read_rows(path)} == {"test"}, path


@pytest.mark.parametrize("script", sorted(path.stem for path in (ROOT / "scripts").glob("*.py")))
def test_scripts_of_the_docs_find_what_they_import(script, monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    assert importlib.import_module(script).main
