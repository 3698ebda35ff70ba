"""`mimicbench objects draw`, `objects import`: look at objects, and make them of your own meshes."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from mimicbench.commands.options import WORK, Axis, Json, Seed, SetName, Task, Workdir, Workers, check_png
from mimicbench.commands.telling import stage_line, stage_summary, tell
from mimicbench.core.run import RunContext, to_stderr
from mimicbench.core.settings import Count
from mimicbench.tasks.registry import DEFAULT_TASK


def draw(
    out: Annotated[Path, tyro.conf.arg(help="the picture, a PNG file")],
    task: Task = DEFAULT_TASK,
    count: Annotated[Count, tyro.conf.arg(help="how many objects, the first ones")] = 24,
    source: Annotated[str, tyro.conf.arg(help="`made`, or the name of an imported set")] = "made",
    workdir: Workdir = WORK,
    seed: Seed = 0,
    workers: Workers = 0,
) -> None:
    """Draw objects of a task on one sheet, all to the same scale; makes them if they are not there."""
    from mimicbench.benchmark import Recipe, run_stage
    from mimicbench.objects.make import ObjectsConfig, object_ids, read_objects
    from mimicbench.report.pictures.sheet import contact_sheet
    from mimicbench.report.video import write_png

    check_png("--out", out)
    config = ObjectsConfig(source, max(count, ObjectsConfig().count))
    stage = run_stage("objects", Recipe(task, seed=seed, objects=config), workdir, RunContext(workers))
    shown = read_objects(stage.folder, object_ids(stage.folder)[:count])
    write_png(out, contact_sheet(list(shown.values()), workers=workers, quiet=False))
    print(f"picture: {out}")


@dataclass(frozen=True)
class Known:
    """What is known of meshes beforehand."""

    unit: Annotated[
        Literal["m", "cm", "mm", "in", "normalized"] | None,
        tyro.conf.arg(help="unit of the files' numbers; guessed if not given"),
    ] = None
    height: Annotated[float | None, tyro.conf.arg(help="height of the objects [m], instead of a unit")] = None
    scale: Annotated[float | None, tyro.conf.arg(help="meters per unit of the files, instead of a unit")] = None
    up: Annotated[Axis | None, tyro.conf.arg(help="the files' axis that points up; guessed if not given")] = None
    front: Annotated[
        Axis | None, tyro.conf.arg(help="the files' axis that points to the objects' front; guessed if not given")
    ] = None


def import_(
    files: tyro.conf.Positional[tuple[Path, ...]],
    task: Task = DEFAULT_TASK,
    known: Annotated[Known, tyro.conf.arg(name="")] = Known(),
    pieces: Annotated[
        Literal["convex", "boxes"],
        tyro.conf.arg(help="what the objects collide with: convex pieces, or the boxes around them"),
    ] = "convex",
    mass: Annotated[float | None, tyro.conf.arg(help="of an object to be lifted [kg]; 2 if not given")] = None,
    to: SetName = "own",
    workdir: Workdir = WORK,
    as_json: Json = False,
) -> None:
    """Make a set of objects of your own meshes (OBJ, PLY, STL, GLB); `--objects.source` names it to later stages."""
    from mimicbench.objects.importing.own import ImportConfig, import_objects
    from mimicbench.objects.importing.placing import Wishes
    from mimicbench.tasks.registry import TASKS

    family = TASKS.get(task).family
    config = ImportConfig(Wishes(**asdict(known)), pieces, mass)
    stage, evidence = import_objects(workdir / task / "objects" / to, task, family, files, config, to_stderr)
    found = {**stage_summary(stage), "imported": [asdict(one) for one in evidence]}
    tell([found], as_json, stage_line(stage))
