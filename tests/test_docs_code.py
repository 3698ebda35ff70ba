"""Code in the documents that says of itself that it runs: every page's blocks, one after the other, as one program.

A block runs if `<!-- runnable -->` stands above it; `<!-- runnable: module -->` if that module is installed.
"""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
BLOCK = re.compile(r"^<!-- runnable(?:: (\w+))? -->\n```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)
PAGES = [page for page in sorted((ROOT / "docs").glob("*.md")) if BLOCK.search(page.read_text(encoding="utf8"))]
SHOWN = {"own-policy": "root heights after 0.4 s: [", "numbers": "online     K 99.2 % [97.8–99.7] (397/400)"}
"""What pages print."""


def test_guides_have_code_that_runs():
    assert {"index", "own-policy", "numbers", "stable-baselines3"} <= {page.stem for page in PAGES}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_code_of_a_page_runs(page, monkeypatch, capsys):
    monkeypatch.chdir(ROOT)
    monkeypatch.syspath_prepend(str(ROOT / "examples"))
    text, names = page.read_text(encoding="utf8"), {"__name__": "page"}
    for found in BLOCK.finditer(text):
        module, code = found.groups()
        if module is not None:
            pytest.importorskip(module, reason=f"{module} is not installed")
        line = text[: found.start(2)].count("\n")  # so that errors name the line of the page
        exec(compile("\n" * line + code, str(page), "exec"), names)
    said = capsys.readouterr().out
    assert SHOWN.get(page.stem, "") in said
    if page.stem == "numbers":
        assert "of split test" in said
    if page.stem == "own-policy":
        heights = names["seen"]["proprio"][:, 3]
        assert (heights > 0.8).all() and heights.shape == (2,)
