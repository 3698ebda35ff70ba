"""`mimicbench retarget draw`, `retarget compare`: look at robot clips, and at the ways to make them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from mimicbench.commands.options import AS_USUAL, WORK, How, Source, Task, Tasks, Workdir, Workers, check_png, recipes
from mimicbench.commands.telling import tell
from mimicbench.core.settings import Count
from mimicbench.tasks.registry import DEFAULT_TASK

if TYPE_CHECKING:
    from mimicbench.core.stage import Stage
    from mimicbench.report.retargeting import SideBySide

BETWEEN_CLIPS = 24
"""[pixels] Enough to see where one clip ends and the next begins."""


def draw(
    out: Annotated[Path, tyro.conf.arg(help="the picture, a PNG file")],
    clip: Annotated[tuple[str, ...], tyro.conf.arg(help="which clips; by default the first ones")] = (),
    count: Annotated[Count, tyro.conf.arg(help="how many clips, if none are named")] = 3,
    task: Task = DEFAULT_TASK,
    stage: Annotated[
        Path | None, tyro.conf.arg(help="folder of the clips; needed where a workdir has several of the task")
    ] = None,
    workdir: Workdir = WORK,
    workers: Workers = 0,
) -> None:
    """Draw robot clips of a workdir on one sheet, each below the person that it was made of, and say which are kept."""
    from mimicbench.benchmark.finding import stage_with
    from mimicbench.core.errors import BadMotion
    from mimicbench.core.stage import HEADER
    from mimicbench.drawing.opengl import draw_apart
    from mimicbench.report.retargeting import draw_side_by_side
    from mimicbench.report.video import stacked, write_png
    from mimicbench.tasks.registry import TASKS

    check_png("--out", out)
    TASKS.get(task)
    named = [name.removesuffix(".npz") for name in clip]  # as a folder lists them, or as tables do
    found = stage_with(workdir, task, "retarget", f"{named[0]}.npz" if named else HEADER, stage)
    names = named or sorted(path.stem for path in found.folder.glob("*.npz"))[:count]
    if not names:
        raise BadMotion(f"{found.folder} holds no clips; run `mimicbench retarget --task {task}` again")
    sides = [_beside_its_person(found, name) for name in names]
    write_png(out, stacked(draw_apart(draw_side_by_side, sides, workers, "drawing"), BETWEEN_CLIPS))
    for one in sides:
        print(one.caption())
    print(f"picture: {out}")


def _beside_its_person(stage: Stage, name: str) -> SideBySide:
    """A robot clip of a stage with the person that it was made of. Raises BadMotion, BadFile or BadObject."""
    from mimicbench.benchmark.finding import read_by
    from mimicbench.core.motion import HumanMotion, RobotMotion
    from mimicbench.objects.shape import load_object
    from mimicbench.report.retargeting import SideBySide

    motion = RobotMotion.load(stage.folder / f"{name}.npz")
    human = HumanMotion.load(read_by(stage, "references") / f"{motion.reference_id}.npz")
    obj = load_object(read_by(stage, "objects"), motion.object_id)
    return SideBySide(obj, human, {f"{motion.robot}, {'kept' if motion.success else 'kept out'}": motion})


def compare(
    task: Tasks = "all",
    clips: Annotated[
        Count, tyro.conf.arg(help="the first so many clips of each task, made if not there; of a named set, all")
    ] = 16,
    variant: Annotated[Literal["improved", "paper"], tyro.conf.arg(help="of the methods that have both")] = "paper",
    source: Source = "made",
    pictures: Annotated[
        bool, tyro.conf.arg(help="draw the methods side by side on the first clip of each task")
    ] = True,
    to: Annotated[
        Path | None, tyro.conf.arg(help="folder for page, tables and pictures; by default <workdir>/retarget-<variant>")
    ] = None,
    how: How = AS_USUAL,
) -> None:
    """Retarget the same clips by every method and write a page: measures, K and pictures side by side."""
    from mimicbench.report.methods import compare_methods
    from mimicbench.report.table import to_terminal

    folder = to or how.workdir / f"retarget-{variant}"
    wanted = recipes(task, how.seed, source, clips, how.workdir)
    found = compare_methods(wanted, variant, how.workdir, folder, pictures, how.context())
    words = "\n".join([*(to_terminal(table) for table in found.tables()), f"page: {folder / 'index.html'}"])
    tell([found.to_dict()], how.as_json, words)
