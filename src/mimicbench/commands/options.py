"""Options that commands share, and how they tell what they did."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from mimicbench.tasks.registry import TASKS

if TYPE_CHECKING:
    from mimicbench.evaluate.rows import EpisodeRow

Task = Annotated[str, tyro.conf.arg(help=f"which task: {', '.join(TASKS)}")]
Tasks = Annotated[str, tyro.conf.arg(name="task", help=f"which task: {', '.join(TASKS)}, or all")]
Count = Annotated[int | Literal["paper"], tyro.conf.arg(help="how many, or `paper` for as many as the paper has")]
Workdir = Annotated[Path, tyro.conf.arg(help="where all artefacts go, in <workdir>/<task>/<stage>")]
Seed = Annotated[int, tyro.conf.arg(help="same seed, same results, whatever the number of workers")]
Workers = Annotated[int, tyro.conf.arg(help="threads or processes; 0 for all processors")]
Device = Annotated[
    str,
    tyro.conf.arg(
        help="what computes the physics: cpu, cuda, cuda:1 (MuJoCo Warp on a GPU), or warp-cpu (slow, for tests)"
    ),
]
Json = Annotated[
    bool, tyro.conf.arg(name="json", help="print the summary as one line of JSON and nothing else on stdout")
]
Axis = Literal["x+", "x-", "y+", "y-", "z+", "z-"]
WORK = Path("work")


def slugs(task: str) -> list[str]:
    """The tasks that the user means, `all` for all six."""
    return list(TASKS) if task == "all" else [task]


def say(line: str) -> None:
    """Progress goes to stderr, so that stdout holds results alone."""
    from mimicbench.core.names import printable

    print(printable(line, lines=True), file=sys.stderr, flush=True)


def done(header: object, as_json: bool) -> None:
    """Print what a stage came to."""
    if not isinstance(header, dict):
        return
    if as_json:
        print(json.dumps({"stage": header["stage"], "task": header["task"], **header["summary"]}))
    else:
        print(
            f"{header['stage']}: "
            + ", ".join(
                f"{key} {value:.3g}" if isinstance(value, float) else f"{key} {value}"
                for key, value in header["summary"].items()
            )
        )


def summary(rows: list[EpisodeRow], as_json: bool) -> None:
    """Print the rates of one policy's episodes."""
    from mimicbench.evaluate.rows import summarize

    if as_json:
        print(json.dumps(summarize(rows).to_dict()))
    else:
        from rich.console import Console

        from mimicbench.report.compare import results_table
        from mimicbench.report.tables import to_rich

        Console().print(to_rich(results_table([summarize(rows)])))
