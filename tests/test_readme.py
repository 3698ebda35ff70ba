"""What the documents say: the README's results follow from the rows kept in the repository, and the scripts beside
the pages can run.
"""

import importlib
from pathlib import Path

import pytest

from mimicbench.evaluate.rows import read_rows
from mimicbench.report.compare import beside_paper_table, summaries
from mimicbench.report.tables import to_markdown

ROOT = Path(__file__).parents[1]


def test_results_in_the_readme_follow_from_the_rows():
    shown = (ROOT / "README.md").read_text().split("<!-- results -->")[1].split("<!-- /results -->")[0]
    for folder in sorted((ROOT / "runs").glob("*/evaluate")):
        rows = [row for path in sorted(folder.glob("*.parquet")) for row in read_rows(path)]
        assert rows, f"{folder} holds no episode rows"
        assert to_markdown(beside_paper_table(folder.parent.name, summaries(rows))) in shown


def test_rows_are_of_unseen_objects():
    for path in (ROOT / "runs").glob("*/evaluate/*.parquet"):
        assert {row.split for row in read_rows(path)} == {"test"}, path


@pytest.mark.parametrize("script", sorted(path.stem for path in (ROOT / "scripts").glob("*.py")))
def test_scripts_of_the_docs_find_what_they_import(script, monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    assert importlib.import_module(script).main
