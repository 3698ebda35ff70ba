"""The pieces of a page that needs nothing from outside: tables, plots, pictures and videos, all inside one file.

They stand in `page.html.jinja`, whose values are escaped. A piece is Markup: put together with `joined` or `+` it stays
one, and a plain text that is put beside it, or in its place, is escaped.
"""

import base64
import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from markupsafe import Markup

from mimicbench.evaluate.intervals import Rate
from mimicbench.report.plots import inline
from mimicbench.report.table import Cell, Reported, Table, text

HERE = Path(__file__).parent


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
    """A heading and what stands below it."""

    title: str
    body: Markup
    """Pieces of this module; a plain text would be escaped."""


@dataclass(frozen=True)
class _Shown:
    """A cell as it is shown."""

    words: str
    interval: str = ""
    empty: bool = False


def page(title: str, eyebrow: str, lead: str, tiles: Iterable[Tile], sections: Iterable[Section], footer: str) -> str:
    """A whole page."""
    css, script = ((HERE / f"page.{kind}").read_text() for kind in ("css", "js"))
    # nothing else may run: whatever a name or an error holds, it cannot bring a script of its own
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return str(
        _piece("page", title, eyebrow, lead, list(tiles), list(sections), footer, Markup(css), Markup(script), digest)
    )


def joined(pieces: Iterable[Markup]) -> Markup:
    """Pieces one after the other."""
    return Markup("").join(pieces)


def heading(words: str) -> Markup:
    """A heading within a section."""
    return _piece("heading", words)


def paragraph(words: str, note: bool = False) -> Markup:
    """A paragraph of plain text; a small, pale one for notes."""
    return _piece("paragraph", words, note)


def table(data: Table) -> Markup:
    """A table with its note. Rows whose only numbers are other people's are paler."""
    columns = [{"name": column, "kind": "n" if data.numeric(i) else ""} for i, column in enumerate(data.columns)]
    rows = []
    for row in data.rows:
        theirs = any(isinstance(cell, Reported) for cell in row) and not any(isinstance(cell, Rate) for cell in row)
        rows.append({"kind": "theirs" if theirs else "", "cells": [_shown(cell) for cell in row]})
    notes = [note for note in (data.note, f"Source: {data.source}." if data.source else "") if note]
    return _piece("table", columns, rows, notes)


def _shown(cell: Cell) -> _Shown:
    if isinstance(cell, Rate) and cell.episodes:
        return _Shown(cell.percent(), f"{cell.interval()} · {cell.counts()}")
    return _Shown("–" if cell is None else text(cell), empty=cell is None)


def plot(svgs: Sequence[str], caption: str = "") -> Markup:
    """A plot of `plots` in the page's colors, for a wide page and for a phone; one alone is for both."""
    return _piece("plot", [Markup(inline(svg)) for svg in svgs], caption)


def data_uri(path: Path, kind: str) -> str:
    """A file's bytes, such as `image/jpeg`, inside an address."""
    return f"data:{kind};base64,{base64.b64encode(path.read_bytes()).decode()}"


def stage(title: str, note: str, strip: Path) -> Markup:
    """A strip of pictures beside its title."""
    return _piece("stage", title, note, data_uri(strip, "image/jpeg"))


def videos(titled: Iterable[tuple[str, Path]]) -> Markup:
    """Videos of one length, two abreast, without sound; they run together, and one slider moves through all."""
    return _piece("videos", [(title, data_uri(path, "video/mp4")) for title, path in titled])


def gallery(title: str, captioned: Iterable[tuple[str, Path]]) -> Markup:
    """Small videos below a title, each started by itself."""
    return _piece("gallery", title, [(caption, data_uri(path, "video/mp4")) for caption, path in captioned])


def objects(counted: Iterable[tuple[Path, str, str, int, int]]) -> Markup:
    """Pictures of objects (picture, name, kind, successes, episodes) with k/n."""
    return _piece("objects", [(data_uri(path, "image/jpeg"), *told) for path, *told in counted])


def judging(limit: float, hold: float) -> Markup:
    """A sketch of how an episode of `limit` seconds is judged, of which K's condition has to hold for `hold`."""
    return _piece("judging", f"{limit:g}", f"{hold:g}")


def facts(pairs: Mapping[str, str]) -> Markup:
    """Names and values below each other."""
    return _piece("facts", list(pairs.items()))


def code(words: str) -> Markup:
    """Preformatted text."""
    return _piece("code", words)


def folded(summary: str, body: Markup) -> Markup:
    """Pieces that open on a click."""
    return _piece("folded", summary, body)


def _piece(name: str, *values: Any) -> Markup:
    """What a macro of the template makes of values."""
    return Markup(getattr(_macros(), name)(*values))


@cache
def _macros() -> Any:
    environment = Environment(
        loader=FileSystemLoader(HERE), autoescape=True, undefined=StrictUndefined, keep_trailing_newline=True
    )
    return environment.get_template("page.html.jinja").module
