"""`mimicbench references remake`, `augment`, `stats`: what can be done with human clips; and `mimicbench import`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from mimicbench.commands.options import (
    AS_USUAL,
    WORK,
    Axis,
    How,
    Json,
    SetName,
    Source,
    Task,
    Tasks,
    Workdir,
    check_png,
    recipes,
)
from mimicbench.commands.telling import stage_line, stage_summary, tell
from mimicbench.core.errors import MimicbenchError
from mimicbench.core.run import to_stderr
from mimicbench.core.settings import Count
from mimicbench.references.importers.registry import AUTO, FORMATS
from mimicbench.tasks.registry import DEFAULT_TASK

if TYPE_CHECKING:
    from mimicbench.core.stage import Stage


def remake(
    clip: tyro.conf.Positional[str],
    task: Annotated[str | None, tyro.conf.arg(help="the task; by default what the clip's id says")] = None,
    stage: Annotated[
        Path | None,
        tyro.conf.arg(help="folder of the clip's stage; needed where several stages of a workdir have such a clip"),
    ] = None,
    workdir: Workdir = WORK,
    to: Annotated[Path | None, tyro.conf.arg(help="file to write; by default <clip>.npz here")] = None,
    as_json: Json = False,
) -> None:
    """Make one clip of a workdir again from its id alone, such as sit-chair-0-00042, and say what the quality gate
    finds.
    """
    from mimicbench.benchmark.finding import read_by, stage_with
    from mimicbench.references.make import remake as make_again
    from mimicbench.tasks.registry import TASKS

    slug = task or clip.rsplit("-", 2)[0]
    if slug not in TASKS:
        raise MimicbenchError(
            f"{clip!r} is no clip's id such as {next(iter(TASKS))}-0-00042, nor is {slug!r} a task; give both"
        )
    found = stage_with(workdir, slug, "references", f"{clip}.npz", stage, made_alone=True)
    motion, wrong = make_again(found, read_by(found, "objects"), clip, TASKS.get(slug).fulfilled_by_human)
    path = to or Path(f"{clip}.npz")
    motion.save(path)
    told = {
        "clip": clip,
        "object": motion.object_id,
        "seconds": motion.duration,
        "rejected_for": wrong,
        "file": str(path),
    }
    gate = "rejected for " + ", ".join(wrong) if wrong else "passes the gate"
    tell([told], as_json, f"{path}: {motion.duration:.1f} s on {motion.object_id}, {gate}")


def augment(
    task: Tasks = DEFAULT_TASK,
    kinds: Annotated[
        tuple[Literal["mirror", "speed", "start", "size"], ...],
        tyro.conf.arg(
            help="left and right exchanged; faster or slower; the way begins elsewhere; a larger or smaller object"
        ),
    ] = ("mirror", "speed", "start", "size"),
    copies: Annotated[Count, tyro.conf.arg(help="variants of each kind; more than one: of the mirror image, too")] = 1,
    count: Annotated[Count, tyro.conf.arg(help="made clips to make variants of; of a named set, all")] = 2000,
    source: Source = "made",
    to: SetName = "augmented",
    how: How = AS_USUAL,
) -> None:
    """Make a set of clips and variants of them: mirrored, at other speeds, from other starts, on objects of other
    sizes; `--references.source` names it to later stages.
    """
    from mimicbench.benchmark.graph import clips_of, make_object_stage, make_reference_stage, start
    from mimicbench.references.augment import AugmentConfig, ClipSource, make_augmented

    made = []
    config = AugmentConfig(tuple(dict.fromkeys(kinds)), copies)
    for recipe in recipes(task, how.seed, source, count, how.workdir):
        run = start(recipe, how.workdir, how.context())
        human = make_reference_stage(run)
        clips = ClipSource(make_object_stage(run), human, clips_of(human))
        fulfils = run.task.fulfilled_by_human
        made.append(make_augmented(how.workdir, to, clips, config, fulfils, run.context))
    tell([stage_summary(one) for one in made], how.as_json, "\n".join(stage_line(one) for one in made))


def stats(
    task: Tasks = "all",
    source: Source = "made",
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
    vary. Of each task, those of the largest stage that is made, or of the set `source`.
    """
    from mimicbench.benchmark.finding import largest
    from mimicbench.references.checks.stats import set_statistics
    from mimicbench.report import dataset
    from mimicbench.report.table import to_terminal

    path = picture or workdir / "references.png"
    check_png("--picture", path)
    tasks = [recipe.task for recipe in recipes(task, 0, source)]
    stages = largest(workdir, tasks, "references", None if source == "made" else source)
    if beside_real:
        _stats_beside_real(stages, beside_real, as_json)
        return
    sets = [set_statistics(slug, workdir / slug / s.header["reads"]["objects"], s.folder) for slug, s in stages.items()]
    dataset.dataset_picture(sets, path)
    more = [dataset.style_table(sets)] if styles else []
    tables = (dataset.statistics_table(sets), dataset.variety_table(sets), *more)
    words = "\n".join([*(to_terminal(table) for table in tables), f"plots: {path}"])
    tell([{found.task: found.to_dict() for found in sets}], as_json, words)


def _stats_beside_real(stages: Mapping[str, Stage], folders: tuple[Path, ...], as_json: bool) -> None:
    from mimicbench.core.motion import HumanMotion
    from mimicbench.references.checks.beside_real import judge, person_of, read_recordings
    from mimicbench.report.beside_real import features_table, judgement_table, measures_table
    from mimicbench.report.table import to_terminal

    real = [person_of(motion) for folder in folders for motion in read_recordings(folder, to_stderr)]
    people = {
        slug: [person_of(HumanMotion.load(path)) for path in sorted(stage.folder.glob("*.npz"))]
        for slug, stage in stages.items()
    }
    found = judge(real, [person for of_task in people.values() for person in of_task])
    tables = (measures_table(real, people), features_table(found), judgement_table(found))
    words = "\n".join(to_terminal(table) for table in tables)
    tell([{"phases": [asdict(row) for row in found]}], as_json, words)


@dataclass(frozen=True)
class Known:
    """What is known of recordings beforehand."""

    fps: Annotated[
        float | None,
        tyro.conf.arg(help="the files' frames per second; by default as they say, or as is usual in the format"),
    ] = None
    up: Annotated[
        Axis | None,
        tyro.conf.arg(help="the files' axis that points up; by default as is usual in the format, or guessed"),
    ] = None
    unit: Annotated[
        Literal["m", "cm", "mm", "in", "cmu"] | None,
        tyro.conf.arg(help="the files' unit of length (bvh, roam); by default guessed by the legs' length"),
    ] = None
    scale: Annotated[
        float | None, tyro.conf.arg(help="meters in the files' unit of length, instead of --unit (bvh, roam)")
    ] = None
    floor: Annotated[
        float | None, tyro.conf.arg(help="height of the files' floor [m]; by default where the soles usually are")
    ] = None
    mesh: Annotated[
        Path | None,
        tyro.conf.arg(
            name="object-mesh", help="mesh of the object that the files track (core4d, intermimic), in meters"
        ),
    ] = None


def import_(
    files: tyro.conf.Positional[tuple[Path, ...]],
    task: Task = DEFAULT_TASK,
    form: Annotated[
        str, tyro.conf.arg(name="format", help=f"the files' format, by default found out: {', '.join(FORMATS)}")
    ] = AUTO,
    known: Annotated[Known, tyro.conf.arg(name="")] = Known(),
    gate: Annotated[
        bool, tyro.conf.arg(help="leave out clips that the quality gate would not let pass from a synthetic person")
    ] = False,
    to: SetName = "recorded",
    workdir: Workdir = WORK,
    as_json: Json = False,
) -> None:
    """Import recordings of real people, each beside its object, or one fitted to the person; `--references.source`
    names the set to later stages.
    """
    from mimicbench.references.importers.recording import Wishes
    from mimicbench.references.make import Recordings, import_references
    from mimicbench.tasks.registry import TASKS

    recordings = Recordings(files, form, Wishes(**asdict(known)), gate)
    name, fulfils = TASKS.get(task).name, TASKS.get(task).fulfilled_by_human
    stage = import_references(workdir, to, name, recordings, fulfils, to_stderr)[1]
    tell([stage_summary(stage)], as_json, stage_line(stage))
