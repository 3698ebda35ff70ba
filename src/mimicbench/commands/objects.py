"""`mimicbench objects`: make objects, or import meshes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Literal

import tyro

from mimicbench.commands.options import WORK, Axis, Count, Json, Seed, Task, Tasks, Workdir, Workers, done, say, slugs

app = tyro.extras.SubcommandApp()


@app.command(name="make", is_default=True)
def objects(
    task: Tasks = "sit-chair",
    count: Count = 400,
    workdir: Workdir = WORK,
    seed: Seed = 0,
    workers: Workers = 0,
    as_json: Json = False,
) -> None:
    """Make the objects of a task, or of all tasks."""
    from mimicbench import workspace
    from mimicbench.objects.make import ObjectsConfig
    from mimicbench.references.paper import PAPER_SETS

    for slug in slugs(task):
        ws = workspace.Workspace(workdir, slug, seed, workers, as_json)
        config = ObjectsConfig(PAPER_SETS[ws.task.name].objects if count == "paper" else count)
        done(workspace.objects_stage(ws, config).header, as_json)


@app.command(name="draw")
def draw_objects(
    out: Annotated[Path, tyro.conf.arg(help="the picture, a PNG file")],
    task: Task = "sit-chair",
    count: Annotated[int, tyro.conf.arg(help="how many objects, the first ones")] = 24,
    workdir: Workdir = WORK,
    workers: Workers = 0,
) -> None:
    """Draw objects of a task on one sheet, all to the same scale."""
    from mimicbench import workspace
    from mimicbench.report.sheet import contact_sheet
    from mimicbench.report.video import write_png

    ws = workspace.Workspace(workdir, task, workers=workers)
    ws.finished("objects")
    write_png(out, contact_sheet(list(ws.objects().values())[:count], workers=workers, quiet=False))
    print(f"picture: {out}")


@app.command(name="import")
def import_objects_(
    files: tyro.conf.Positional[tuple[Path, ...]],
    task: Task = "sit-chair",
    unit: Annotated[
        Literal["m", "cm", "mm", "in", "normalized"] | None,
        tyro.conf.arg(help="unit of the files' numbers; guessed if not given"),
    ] = None,
    height: Annotated[
        float | None, tyro.conf.arg(help="height that the objects shall have [m], instead of a unit")
    ] = None,
    scale: Annotated[float | None, tyro.conf.arg(help="meters per unit of the files, instead of a unit")] = None,
    up: Annotated[Axis | None, tyro.conf.arg(help="the files' axis that points up; guessed if not given")] = None,
    front: Annotated[
        Axis | None, tyro.conf.arg(help="the files' axis that points to the objects' front; guessed if not given")
    ] = None,
    pieces: Annotated[
        Literal["convex", "boxes"],
        tyro.conf.arg(help="what the objects collide with: convex pieces, or the boxes around them"),
    ] = "convex",
    mass: Annotated[float | None, tyro.conf.arg(help="of an object to be lifted [kg]; 2 if not given")] = None,
    workdir: Annotated[
        Path, tyro.conf.arg(help="a workdir of its own for these objects; the other commands go on from there")
    ] = Path("work/own"),
    as_json: Json = False,
) -> None:
    """Make objects of your own meshes (OBJ, PLY, STL, GLB)."""
    from dataclasses import asdict

    from mimicbench import workspace
    from mimicbench.objects.importing.own import ImportConfig, import_objects
    from mimicbench.objects.importing.placing import Wishes

    ws = workspace.Workspace(workdir, task, quiet=as_json)
    config = ImportConfig(Wishes(unit, up, front, height, scale), pieces, mass)
    stage, evidence = import_objects(ws.folder("objects"), ws.slug, ws.task.family, files, config, say)
    if as_json:
        print(
            json.dumps(
                {
                    "stage": "objects",
                    "task": ws.slug,
                    **stage.header["summary"],
                    "imported": [asdict(found) for found in evidence],
                }
            )
        )
    else:
        done(stage.header, as_json)
