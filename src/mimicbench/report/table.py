"""One kind of table, and its writers: Markdown, LaTeX, CSV, terminal. The page has a fifth, in `page`.

A table is data; every writer shows the same cells, so the same rows of episodes give the same text everywhere.
"""

import csv
import io
import re
import shutil
from dataclasses import dataclass

from rich.cells import cell_len
from rich.console import Console
from rich.markup import escape
from rich.table import Table as RichTable

from mimicbench.core.errors import MimicbenchError
from mimicbench.core.names import printable
from mimicbench.evaluate.intervals import Rate, whole


@dataclass(frozen=True)
class Reported:
    """A rate that somebody else published in percent, without its counts."""

    percent: float


Cell = str | int | float | Rate | Reported | None


@dataclass(frozen=True)
class Table:
    """Rows of cells under named columns."""

    name: str
    """Short, for files: `results`."""
    title: str
    """One line, for readers."""
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    note: str = ""
    """What a reader must know to read the numbers."""
    source: str = ""
    """Where numbers that are not ours come from."""

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise MimicbenchError(f"table {self.name}: a row of {len(row)} cells under {len(self.columns)} columns")

    def numeric(self, column: int) -> bool:
        """Whether a column holds numbers, which stand to the right."""
        return any(row[column] is not None and not isinstance(row[column], str) for row in self.rows)


def text(cell: Cell) -> str:
    """A cell as readers see it."""
    if cell is None:
        return "-"
    if isinstance(cell, Reported):
        return f"{whole(cell.percent)} %"
    if isinstance(cell, Rate):
        return str(cell)
    return f"{cell:.4g}" if isinstance(cell, float) else str(cell)


def to_markdown(table: Table) -> str:
    """A GitHub-flavored Markdown table with its title and note."""

    def escaped(value: str) -> str:
        # names are other people's: no column of its own, no raw HTML, no line of its own
        return " ".join(value.replace("|", "\\|").replace("<", "&lt;").splitlines())

    columns = [escaped(column) for column in table.columns]
    cells = [[escaped(text(cell)) for cell in row] for row in table.rows]
    widths = [
        max(len(column), *(len(row[i]) for row in cells), 3) if cells else max(len(column), 3)
        for i, column in enumerate(columns)
    ]
    right = [table.numeric(i) for i in range(len(table.columns))]

    def line(values: list[str]) -> str:
        return (
            "| "
            + " | ".join(v.rjust(w) if r else v.ljust(w) for v, w, r in zip(values, widths, right, strict=True))
            + " |"
        )

    ruler = "|" + "|".join("-" * (w + 1) + (":" if r else "-") for w, r in zip(widths, right, strict=True)) + "|"
    body = [line(columns), ruler, *map(line, cells)]
    source = f"The paper's numbers are those of *{escaped(table.source)}*." if table.source else ""
    return "\n\n".join(part for part in (f"**{table.title}**", "\n".join(body), table.note, source) if part) + "\n"


_LATEX = {
    "\\": r"\textbackslash{}",
    "&": r"\&",
    "%": r"\%",
    "$": r"\$",
    "#": r"\#",
    "_": r"\_",
    "{": r"\{",
    "}": r"\}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": "$<$",
    ">": "$>$",
    "λ": r"$\lambda$",
    "±": r"$\pm$",
    "∧": r"$\wedge$",
    "–": "--",
    "τ": r"$\tau$",
    "²": r"$^2$",
}


def to_latex(table: Table) -> str:
    """A LaTeX `table` with booktabs rules."""

    def escaped(value: str) -> str:
        return "".join(_LATEX.get(character, character) for character in value)

    align = "".join("r" if table.numeric(i) else "l" for i in range(len(table.columns)))
    lines = [
        r"\begin{table}",
        r"\centering",
        rf"\begin{{tabular}}{{{align}}}",
        r"\toprule",
        " & ".join(map(escaped, table.columns)) + r" \\",
        r"\midrule",
        *(" & ".join(escaped(text(cell)) for cell in row) + r" \\" for row in table.rows),
        r"\bottomrule",
        r"\end{tabular}",
        rf"\caption{{{escaped(' '.join(part for part in (table.title + '.', table.note, table.source) if part))}}}",
        rf"\label{{tab:{table.name}}}",
        r"\end{table}",
    ]
    return "\n".join(lines) + "\n"


def to_csv(table: Table) -> str:
    """Comma-separated values for other programs: a rate takes five columns (rate, low, high, successes, episodes),
    all as fractions.
    """
    names: list[str] = []
    rates = [any(isinstance(row[i], Rate) for row in table.rows) for i in range(len(table.columns))]
    for column, is_rate in zip(table.columns, rates, strict=True):
        names += (
            [f"{column} {part}" for part in ("rate", "low", "high", "successes", "episodes")] if is_rate else [column]
        )
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(names)
    for row in table.rows:
        values: list[str | int | float] = []
        for cell, is_rate in zip(row, rates, strict=True):
            if isinstance(cell, Rate):
                values += [cell.rate, cell.low, cell.high, whole(cell.successes), cell.episodes]
            elif is_rate:
                values += [""] * 5 if cell is None else [text(cell), "", "", "", ""]
            elif isinstance(cell, Reported):
                values.append(cell.percent / 100)
            else:
                values.append("" if cell is None else cell)
        writer.writerow(values)
    return stream.getvalue()


_WORD = re.compile(r"\S+(?: %(?!\S))?")
"""What stays on one line: a word, or a number with its percent sign."""


def to_rich(table: Table, width: int = 160) -> RichTable:
    """For `rich.print` on a terminal of that many columns.

    Cells are broken between words, never inside of them. Narrow terminals get no space beside the cells' rulers; where
    the words do not fit even then, each row becomes a block of lines `column, value`.
    """
    columns = len(table.columns)
    widths = _widths(table, width - 3 * columns - 1)
    padding = 1 if widths is not None else 0
    widths = widths or _widths(table, width - columns - 1)
    shown = RichTable(
        title=escape(printable(table.title)),
        caption=escape(printable(table.note, lines=True)) or None,
        title_justify="left",
        caption_justify="left",
        title_style="bold",
        show_header=widths is not None,
        padding=(0, padding),
    )
    if widths is None:
        for style in ("bold", ""):
            shown.add_column(style=style, overflow="fold")
        for row in table.rows:
            for column, cell in zip(table.columns, row, strict=True):
                shown.add_row(escape(printable(column)), escape(printable(text(cell))))
            shown.add_section()
        return shown
    for i, column in enumerate(table.columns):
        shown.add_column(escape(printable(column)), justify="right" if table.numeric(i) else "left", width=widths[i])
    for row in table.rows:
        shown.add_row(*(escape(printable(text(cell))) for cell in row))
    return shown


def _widths(table: Table, room: int) -> list[int] | None:
    """Widths of all columns, `room` together at most: room for each word, then for more where most lines are.

    None if there is no room for the words.
    """
    columns = [
        [printable(name), *(printable(text(row[i])) for row in table.rows)] for i, name in enumerate(table.columns)
    ]
    widths = [max((cell_len(word) for cell in column for word in _WORD.findall(cell)), default=1) for column in columns]
    whole_cells = [max(map(cell_len, column)) for column in columns]
    if sum(widths) > room:
        return None
    for _ in range(room - sum(widths)):
        lines = [wanted / width for wanted, width in zip(whole_cells, widths, strict=True)]
        if max(lines) <= 1:
            break
        widths[lines.index(max(lines))] += 1
    return widths


def to_terminal(table: Table, width: int | None = None) -> str:
    """As a terminal of that many columns shows it, without colors; of this one's, if None."""
    columns = width or shutil.get_terminal_size((160, 24)).columns
    console = Console(width=columns, file=io.StringIO(), color_system=None)
    console.print(to_rich(table, columns))
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


WRITERS = {"terminal": to_terminal, "markdown": to_markdown, "latex": to_latex, "csv": to_csv}
"""By the form that they write."""
