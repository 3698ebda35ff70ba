"""What the documents say: the README's results follow from the rows kept in the repository, and the scripts beside
the pages can run.
"""

import importlib
import re
from pathlib import Path

import pytest

from mimicbench.evaluate.rows import read_rows
from mimicbench.report.table import to_markdown

ROOT = Path(__file__).parents[1]


def test_results_follow_from_the_rows(monkeypatch):
    """Every run has its table in docs/results.md, the best of every task theirs in the README, and none is typed in."""
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    results = importlib.import_module("write_results")
    for path, text in results.pages().items():
        assert path.read_text() == text, f"{path.name} is not what the rows say: python scripts/write_results.py"
    for folder in (ROOT / "runs").glob("*/evaluate"):
        assert results.rows_of(folder.parent), f"{folder} holds no episode rows"
        assert f"<!-- runs/{folder.parent.name} -->\n**" in results.RESULTS.read_text()
    assert "<!-- results -->\n**" in results.README.read_text()


def test_the_table_of_the_full_set_follows_from_its_summaries(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    full_set = importlib.import_module("full_set")
    assert to_markdown(full_set.table()) in (ROOT / "docs" / "retargeting.md").read_text(), "python scripts/full_set.py"


def test_the_readme_begins_with_the_worst_and_best_of_its_table():
    text = (ROOT / "README.md").read_text()
    rates = [float(rate) for rate in re.findall(r"^\| \w+ +\| [\w-]+ +\| +([\d.]+) %", text, re.MULTILINE)]
    told = re.search(r"\[K ([\d.]+) to ([\d.]+) %\]\(#results\)", text)
    assert len(rates) == 6 and told and (float(told[1]), float(told[2])) == (min(rates), max(rates))


def test_rows_are_of_unseen_objects():
    for path in (ROOT / "runs").glob("*/evaluate/*.parquet"):
        assert {row.split for row in read_rows(path)} == {"test"}, path


@pytest.mark.parametrize("script", sorted(path.stem for path in (ROOT / "scripts").glob("*.py")))
def test_scripts_of_the_docs_find_what_they_import(script, monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "scripts"))
    assert importlib.import_module(script).main
