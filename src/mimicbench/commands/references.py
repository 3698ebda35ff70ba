"""`mimicbench references`: human clips, made and measured; and `mimicbench import`: recorded ones."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Literal

import tyro

from mimicbench.commands.options import WORK, Axis, Count, Json, Seed, Task, Tasks, Workdir, Workers, done, say, slugs
from mimicbench.references.importers.registry import AUTO, FORMATS

app = tyro.extras.SubcommandApp()


@app.command(name="make", is_default=True)
def references(
    task: Tasks = "sit-chair",
    count: Count = 2000,
    workdir: Workdir = WORK,
    seed: Seed = 0,
    workers: Workers = 0,
    as_json: Json = False,
) -> None:
    """Make good human clips on the objects of a task, or of all tasks."""
    from mimicbench import workspace
    from mimicbench.references.make import ReferencesConfig
    from mimicbench.references.paper import PAPER_SETS

    for slug in slugs(task):
        ws = workspace.Workspace(workdir, slug, seed, workers, as_json)
        config = ReferencesConfig(PAPER_SETS[ws.task.name].clips if count == "paper" else count)
        done(workspace.references_stage(ws, config).header, as_json)


@app.command(name="remake")
def remake_(
    clip: tyro.conf.Positional[str],
    task: Annotated[str | None, tyro.conf.arg(help="the task; by default what the clip's id says")] = None,
    workdir: Workdir = WORK,
    to: Annotated[Path | None, tyro.conf.arg(help="file to write; by default <clip>.npz here")] = None,
    as_json: Json = False,
) -> None:
    """Make one clip of a workdir again from its id alone, such as sit-chair-0-00042, and say what the quality gate
    finds.
    """
    from mimicbench import workspace

    ws = workspace.Workspace(workdir, task or clip.rsplit("-", 2)[0], quiet=as_json)
    motion, wrong = workspace.remake_clip(ws, clip)
    path = to or Path(f"{clip}.npz")
    motion.save(path)
    if as_json:
        print(
            json.dumps(
                {
                    "clip": clip,
                    "object": motion.object_id,
                    "seconds": motion.duration,
                    "rejected_for": wrong,
                    "file": str(path),
                }
            )
        )
    else:
        print(
            f"{path}: {motion.duration:.1f} s on {motion.object_id}, "
            f"{'rejected for ' + ', '.join(wrong) if wrong else 'passes the gate'}"
        )


@app.command(name="augment")
def augment(
    to: Annotated[
        Path,
        tyro.conf.arg(
            help="a workdir of its own for the clips and their variants; the other commands go on from there"
        ),
    ],
    task: Tasks = "sit-chair",
    kinds: Annotated[
        tuple[Literal["mirror", "speed", "start", "size"], ...],
        tyro.conf.arg(
            help="left and right exchanged; faster or slower; the way begins elsewhere; a larger or smaller object"
        ),
    ] = ("mirror", "speed", "start", "size"),
    workdir: Workdir = WORK,
    seed: Seed = 0,
    workers: Workers = 0,
    as_json: Json = False,
) -> None:
    """Add variants of a workdir's human clips: mirrored, at other speeds, from other starts, on objects of other
    sizes.
    """
    from mimicbench import workspace
    from mimicbench.references.augment import AugmentConfig

    for slug in slugs(task):
        ws = workspace.Workspace(workdir, slug, seed, workers, as_json)
        done(workspace.augment_stage(ws, to, AugmentConfig(kinds)).header, as_json)


@app.command(name="stats")
def references_stats(
    task: Tasks = "all",
    picture: Annotated[
        Path | None, tyro.conf.arg(help="PNG with the plots; by default <workdir>/references.png")
    ] = None,
    styles: Annotated[bool, tyro.conf.arg(help="print every choice that clips make, too")] = False,
    beside_real: Annotated[
        tuple[Path, ...],
        tyro.conf.arg(
            help="folders of recordings: print instead how surely the clips are told from them, phase by phase, by "
            "what, and the measures of both"
        ),
    ] = (),
    workdir: Workdir = WORK,
    as_json: Json = False,
) -> None:
    """Print the paper's table of statistics for the clips of a workdir beside the paper's figures, and how the clips
    vary.
    """
    from mimicbench import workspace
    from mimicbench.report import dataset
    from mimicbench.report.tables import to_terminal

    if beside_real:
        _stats_beside_real(workdir, slugs(task), beside_real, as_json)
        return
    sets = workspace.reference_statistics(workdir, slugs(task))
    path = picture or workdir / "references.png"
    dataset.dataset_picture(sets, path)
    if as_json:
        print(json.dumps({found.task: found.to_dict() for found in sets}))
        return
    for table in (
        dataset.statistics_table(sets),
        dataset.variety_table(sets),
        *([dataset.style_table(sets)] if styles else []),
    ):
        print(to_terminal(table))
    print(f"plots: {path}")


def _stats_beside_real(workdir: Path, tasks: list[str], folders: tuple[Path, ...], as_json: bool) -> None:
    from mimicbench import workspace
    from mimicbench.references.checks.beside_real import judge, person_of, read_recordings
    from mimicbench.report.beside_real import judgement_table, measures_table, tells_table
    from mimicbench.report.tables import to_terminal

    real = [person_of(motion) for folder in folders for motion in read_recordings(folder, say)]
    people = {
        slug: [person_of(motion) for motion in motions]
        for slug, motions in workspace.reference_motions(workdir, tasks).items()
    }
    found = judge(real, [person for of_task in people.values() for person in of_task])
    if as_json:
        print(json.dumps([asdict(row) for row in found]))
        return
    for table in (measures_table(real, people), tells_table(found), judgement_table(found)):
        print(to_terminal(table))


def import_(
    files: tyro.conf.Positional[tuple[Path, ...]],
    task: Task = "sit-chair",
    form: Annotated[
        str,
        tyro.conf.arg(name="format", help=f"the files' format, by default found out: {', '.join(FORMATS)}"),
    ] = AUTO,
    fps: Annotated[
        float | None,
        tyro.conf.arg(help="the files' frames per second; by default as they say, or as is usual in the format"),
    ] = None,
    up: Annotated[
        Axis | None,
        tyro.conf.arg(help="the files' axis that points up; by default as is usual in the format, or guessed"),
    ] = None,
    unit: Annotated[
        Literal["m", "cm", "mm", "in", "cmu"] | None,
        tyro.conf.arg(help="the files' unit of length (bvh, roam); by default guessed by the legs' length"),
    ] = None,
    scale: Annotated[
        float | None, tyro.conf.arg(help="meters in the files' unit of length, instead of --unit (bvh, roam)")
    ] = None,
    floor: Annotated[
        float | None, tyro.conf.arg(help="height of the files' floor [m]; by default where the soles usually are")
    ] = None,
    gate: Annotated[
        bool, tyro.conf.arg(help="leave out clips that the quality gate would not let pass from a synthetic person")
    ] = False,
    object_mesh: Annotated[
        Path | None, tyro.conf.arg(help="mesh of the object that the files track (core4d, intermimic), in meters")
    ] = None,
    workdir: Annotated[
        Path, tyro.conf.arg(help="a workdir of its own for these clips; the other commands go on from there")
    ] = Path("work/real"),
    as_json: Json = False,
) -> None:
    """Import recordings of real people, each beside its object, or one fitted to the person."""
    from mimicbench import workspace
    from mimicbench.references.importers.recording import Wishes
    from mimicbench.references.make import ImportConfig

    config = ImportConfig(form, Wishes(fps, up, unit, floor, object_mesh, scale), gate)
    done(workspace.import_stage(workspace.Workspace(workdir, task, quiet=as_json), files, say, config).header, as_json)
