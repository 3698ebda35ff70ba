"""The pieces of a page that needs nothing from outside: tables, plots, pictures and videos, all inside one file."""

import base64
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from html import escape
from pathlib import Path

from mimicbench.evaluate.intervals import Rate
from mimicbench.report.plots import inline
from mimicbench.report.tables import Cell, Reported, Table, text


@dataclass(frozen=True)
class Tile:
    """One number that a reader should take along."""

    what: str
    value: str
    unit: str
    details: tuple[str, ...]
    """Lines below the number."""


@dataclass(frozen=True)
class Section:
    """A heading and ready HTML."""

    title: str
    body: str


def page(title: str, eyebrow: str, lead: str, tiles: Iterable[Tile], sections: Iterable[Section], footer: str) -> str:
    """A whole page. Texts are escaped here; the bodies of sections are HTML already."""
    css = Path(__file__).with_name("page.css").read_text()
    parts = [f"<h2>{escape(section.title)}</h2>\n{section.body}" for section in sections]
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<meta name="viewport" '
        'content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)} · {escape(eyebrow)}</title>\n<style>\n{css}</style>\n</head>\n<body>\n<main>\n"
        f'<p class="eyebrow">{escape(eyebrow)}</p>\n<h1>{escape(title)}</h1>\n<p class="lead">{escape(lead)}</p>\n'
        f'<div class="tiles">{"".join(map(_tile, tiles))}</div>\n'
        + "\n".join(parts)
        + f"\n<footer>{escape(footer)}</footer>\n</main>\n</body>\n</html>\n"
    )


def _tile(tile: Tile) -> str:
    unit = f" <small>{escape(tile.unit)}</small>" if tile.unit else ""
    lines = "".join(tag("div", escape(line), "detail") for line in tile.details if line)
    return tag(
        "div", tag("div", escape(tile.what), "what") + tag("div", escape(tile.value) + unit, "value") + lines, "tile"
    )


def paragraph(words: str, note: bool = False) -> str:
    """A paragraph of plain text; a small, pale one for notes."""
    return tag("p", escape(words), "note" if note else "") + "\n"


def table(data: Table) -> str:
    """A table with its note. Rows whose only numbers are other people's are paler."""
    right = [data.numeric(i) for i in range(len(data.columns))]
    kinds = ["n" if r else "" for r in right]
    head = "".join(tag("th", escape(column), kind) for column, kind in zip(data.columns, kinds, strict=True))
    rows = []
    for row in data.rows:
        theirs = any(isinstance(cell, Reported) for cell in row) and not any(isinstance(cell, Rate) for cell in row)
        cells = "".join(tag("td", _cell(cell), kind) for cell, kind in zip(row, kinds, strict=True))
        rows.append(tag("tr", cells, "theirs" if theirs else "") + "\n")
    notes = "".join(
        paragraph(note, note=True) for note in (data.note, f"Source: {data.source}." if data.source else "") if note
    )
    body = f"<thead><tr>{head}</tr></thead><tbody>\n{''.join(rows)}</tbody>"
    return tag("div", tag("table", body), "scroll") + "\n" + notes


def tag(name: str, body: str, kind: str = "") -> str:
    """An element around HTML, with a class if one is given."""
    return f'<{name} class="{kind}">{body}</{name}>' if kind else f"<{name}>{body}</{name}>"


def _cell(cell: Cell) -> str:
    if isinstance(cell, Rate) and cell.episodes:
        return f'<b>{cell.percent()}</b><span class="ci">{cell.interval()} · {cell.counts()}</span>'
    return escape("–" if cell is None else text(cell))


def plot(svg: str, caption: str = "") -> str:
    """A plot in the page's colors."""
    return tag("figure", inline(svg) + (tag("figcaption", escape(caption)) if caption else "")) + "\n"


def data_uri(path: Path, kind: str) -> str:
    """A file's bytes, such as `image/jpeg`, inside an address."""
    return f"data:{kind};base64,{base64.b64encode(path.read_bytes()).decode()}"


def stage(title: str, note: str, strip: Path) -> str:
    """A strip of pictures beside its title."""
    picture = f'<img alt="{escape(title)}: moments from start to end" src="{data_uri(strip, "image/jpeg")}">'
    return f'<div class="stage"><div><h3>{escape(title)}</h3><p>{escape(note)}</p></div>{picture}</div>\n'


def videos(titled: Iterable[tuple[str, Path]]) -> str:
    """Videos two abreast; they start by themselves, without sound, over and over."""
    parts = [
        '<figure><video controls muted loop autoplay playsinline preload="auto" '
        f'src="{data_uri(path, "video/mp4")}"></video>'
        f"<figcaption>{escape(title)}</figcaption></figure>"
        for title, path in titled
    ]
    return f'<div class="videos">{"".join(parts)}</div>\n'


def facts(pairs: Mapping[str, str]) -> str:
    """Names and values below each other."""
    return (
        "<dl>"
        + "".join(f"<dt>{escape(name)}</dt><dd>{escape(value)}</dd>" for name, value in pairs.items())
        + "</dl>\n"
    )


def code(words: str) -> str:
    """Preformatted text."""
    return f"<pre>{escape(words)}</pre>\n"


def folded(summary: str, body: str) -> str:
    """HTML that opens on a click."""
    return f"<details><summary>{escape(summary)}</summary>\n{body}</details>\n"
