"""Links in the documents: every relative one leads to a file that is there, and to a heading that it has."""

import re
from itertools import count
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGES = sorted(
    path
    for folder in (ROOT, ROOT / "docs", ROOT / "runs", ROOT / "examples")
    for path in (folder.glob("*.md") if folder == ROOT else folder.rglob("*.md"))
)
MADE = {"results.md", "changelog.md", "contributing.md"}
"""Pages of the site that scripts/docs_pages.py makes, beside those in the folders that it makes."""
FENCE = re.compile(r"^(```|~~~).*?^\1", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\(([^)\s]+)\)")


def prose(text):
    """A page without its blocks of code and its code in lines, neither of which has links or headings."""
    return re.sub(r"`[^`\n]*`", lambda found: re.sub(r"[\[\]()]", "", found[0]), FENCE.sub("", text))


def anchors(text):
    """The anchors of a page's headings, as hosts of repositories and MkDocs make them."""
    found = set()
    for title in re.findall(r"^#+ +(.+)$", prose(text), re.MULTILINE):
        shown = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", title).strip().lower()
        slug = re.sub(r"[^\w\- ]", "", shown).replace(" ", "-")
        found.add(next(name for n in count() if (name := f"{slug}-{n}" if n else slug) not in found))
    return found


def broken(page, text):
    """Relative links of a page that lead nowhere."""
    for link in LINK.findall(prose(text)):
        if re.match(r"\w+:", link):
            continue
        name, _, anchor = link.partition("#")
        target = (page.parent / name).resolve() if name else page
        if page.parent == ROOT / "docs" and (name in MADE or name.split("/")[0] in ("tasks", "methods", "settings")):
            continue  # of the site alone, whose strict build looks at them
        if not target.exists():
            yield link
            continue
        whole = text if target == page else target.read_text(encoding="utf8") if anchor else ""
        if anchor and anchor not in anchors(whole):
            yield link


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_relative_links_lead_somewhere(page):
    assert not list(broken(page, page.read_text(encoding="utf8")))


def test_broken_links_are_found():
    page = ROOT / "docs" / "recipes.md"
    assert list(broken(page, "[a](nowhere.md) [b](senses.md#cameras) [c](senses.md#eyes) [d](#here)")) == [
        "nowhere.md",
        "senses.md#eyes",
        "#here",
    ]
    assert not list(broken(page, "# Here\n[d](#here) `[e](nowhere.md)`\n```\n[f](nowhere.md)\n```\n"))
    assert anchors("## `a b`: c!\n## a b c\n") == {"a-b-c", "a-b-c-1"}
