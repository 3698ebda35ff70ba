"""`mimicbench compare`, `compare list`: recipes side by side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from mimicbench.commands.options import Form, Format
from mimicbench.commands.parsing import Options, read_compared
from mimicbench.commands.telling import tell
from mimicbench.comparisons.registry import COMPARISONS
from mimicbench.core.errors import MimicbenchError


@dataclass(frozen=True)
class CompareOptions(Options):
    """How and where to run, and which of the variants."""

    only: tuple[str, ...] = ()
    """Labels of the variants to learn and judge; all if none is named."""
    format: Format = "terminal"
    """How to print the table."""


def compare(argv: Sequence[str]) -> None:
    """Learn the variants of a comparison, judge them on the same episodes, and print them beside the paper's."""
    name = next(iter(argv), "-")
    if name.startswith("-"):
        if "--help" not in argv and "-h" not in argv:
            raise MimicbenchError(f"name a comparison: mimicbench compare {next(iter(COMPARISONS))}; {_known()}")
        print(f"usage: mimicbench compare NAME [OPTIONS]\n\n{_known()}\n`mimicbench compare NAME --help` has settings.")
        return
    comparison = COMPARISONS.get(name)
    call = read_compared(comparison, argv[1:], CompareOptions)
    from mimicbench.comparisons.comparing import compare as carry_out
    from mimicbench.comparisons.comparing import on_shared_clips
    from mimicbench.evaluate.rows import summarize
    from mimicbench.report.table import WRITERS
    from mimicbench.report.tables.comparison import comparison_table

    told = []
    for recipes in call.recipes:
        found = carry_out(call.comparison, recipes, call.options.workdir, call.options.context())
        told += [
            {
                "comparison": name,
                "variant": one.variant.label,
                **(
                    {"folder": str(one.folder), **summarize(one.rows).to_dict()} if one.rows else {"error": one.problem}
                ),
                **({"shared_clips": summarize(same.rows).to_dict()} if same is not one and same.rows else {}),
            }
            for one, same in zip(found, on_shared_clips(found) or found, strict=True)
        ]
        if not call.options.json:
            print(WRITERS[call.options.format](comparison_table(call.comparison, found)))
    if call.options.json:
        tell(told, True, "")


def list_(form: Form = "terminal") -> None:
    """Print which comparisons there are, ours and those of installed packages, and their variants."""
    from mimicbench.report.table import WRITERS, Table

    rows = tuple(
        (one.name, one.what, ", ".join(variant.label for variant in one.variants)) for one in COMPARISONS.all()
    )
    columns = ("Name", "What it finds out", "Variants")
    print(WRITERS[form](Table("comparisons", "Comparisons: mimicbench compare NAME", columns, rows)))


def _known() -> str:
    return f"there are: {', '.join(COMPARISONS)} (`mimicbench compare list`)"
