"""`mimicbench retarget compare`: the ways to retarget, beside each other."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import tyro

from mimicbench.commands.options import WORK, Json, Seed, Source, Tasks, Workdir, Workers, recipes
from mimicbench.commands.telling import tell
from mimicbench.core.run import RunContext
from mimicbench.core.settings import Count


def compare(
    task: Tasks = "all",
    clips: Annotated[Count, tyro.conf.arg(help="the first so many clips of each task; made if not there")] = 16,
    variant: Annotated[Literal["improved", "paper"], tyro.conf.arg(help="of the methods that have both")] = "paper",
    source: Source = "made",
    pictures: Annotated[
        bool, tyro.conf.arg(help="draw the methods side by side on the first clip of each task")
    ] = True,
    to: Annotated[
        Path | None, tyro.conf.arg(help="folder for page, tables and pictures; by default <workdir>/retarget-<variant>")
    ] = None,
    workdir: Workdir = WORK,
    seed: Seed = 0,
    workers: Workers = 0,
    as_json: Json = False,
) -> None:
    """Retarget the same clips by every method and write a page: measures, K and pictures side by side."""
    from mimicbench.report.methods import compare_methods
    from mimicbench.report.tables import to_terminal

    folder = to or workdir / f"retarget-{variant}"
    context = RunContext(workers, quiet=as_json)
    found = compare_methods(recipes(task, seed, source, clips), variant, workdir, folder, pictures, context)
    words = "\n".join([*(to_terminal(table) for table in found.tables()), f"page: {folder / 'index.html'}"])
    tell([found.to_dict()], as_json, words)
