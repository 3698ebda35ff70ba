"""`mimicbench retarget`: robot clips, and the ways to get them compared."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Literal

import tyro

from mimicbench.commands.options import WORK, Json, Seed, Tasks, Workdir, Workers, say, slugs
from mimicbench.retarget.registry import METHODS

app = tyro.extras.SubcommandApp()


@app.command(name="make", is_default=True)
def retarget(
    task: Tasks = "sit-chair",
    method: Annotated[str, tyro.conf.arg(help=", ".join(METHODS))] = "optimization",
    preset: Annotated[
        Literal["improved", "paper"] | None, tyro.conf.arg(help="what we find to be better, or the paper to the letter")
    ] = None,
    beside: Annotated[
        bool, tyro.conf.arg(help="into a folder of the method's own, that later stages do not go on from")
    ] = False,
    workdir: Workdir = WORK,
    seed: Seed = 0,
    workers: Workers = 0,
    as_json: Json = False,
) -> None:
    """Turn the human clips into robot clips, and keep those that are solved and fulfil the task's metric."""
    from mimicbench import workspace
    from mimicbench.retarget.make import RetargetConfig

    for slug in slugs(task):
        ws = workspace.Workspace(workdir, slug, seed, workers, as_json)
        header = workspace.retarget_stage(ws, RetargetConfig(method=method, preset=preset), beside).header
        told = header["summary"]
        if as_json:
            print(
                json.dumps(
                    {
                        "stage": "retarget",
                        "task": slug,
                        **{name: header["config"][name] for name in ("robot", "method", "preset")},
                        **told,
                    }
                )
            )
            continue
        wrong = ", ".join(f"{name} {count}" for name, count in told.get("rejected_for", {}).items())
        print(
            f"retarget: {told['clips']} clips, {told['fulfilled']} fulfil K, {100 * told['rate']:.1f} "
            f"% kept{'; kept out for ' + wrong if wrong else ''}"
        )
        if "measures" in told:
            from mimicbench.report.retargeting import measures_table
            from mimicbench.report.tables import to_terminal

            print(to_terminal(measures_table(slug, told["measures"])))


@app.command(name="compare")
def retarget_compare(
    task: Tasks = "all",
    clips: Annotated[int, tyro.conf.arg(help="the first so many clips of each task")] = 16,
    preset: Annotated[Literal["improved", "paper"], tyro.conf.arg(help="of the methods that have both")] = "paper",
    pictures: Annotated[
        bool, tyro.conf.arg(help="draw the methods side by side on the first clip of each task")
    ] = True,
    to: Annotated[
        Path | None, tyro.conf.arg(help="folder for page, tables and pictures; by default <workdir>/retarget-<preset>")
    ] = None,
    workdir: Workdir = WORK,
    seed: Seed = 0,
    workers: Workers = 0,
    as_json: Json = False,
) -> None:
    """Retarget the same clips by every method and write a page: measures, K and pictures side by side."""
    from mimicbench import pipelines
    from mimicbench.report.tables import to_terminal

    folder = to or workdir / f"retarget-{preset}"
    found = pipelines.compare_retargeting(
        workdir, slugs(task), clips, preset, folder, pictures, seed, workers, as_json, say
    )
    if as_json:
        print(json.dumps(found.to_dict()))
        return
    for table in found.tables():
        print(to_terminal(table))
    print(f"page: {folder / 'index.html'}")
