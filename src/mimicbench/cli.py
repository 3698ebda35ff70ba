"""The command `mimicbench`. Everything heavy is imported inside the commands, so that help is quick."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from mimicbench.core.errors import MimicbenchError

if TYPE_CHECKING:
    from mimicbench.evaluate.rows import EpisodeRow

app = tyro.extras.SubcommandApp()
_objects_app = tyro.extras.SubcommandApp()
_references_app = tyro.extras.SubcommandApp()
_retarget_app = tyro.extras.SubcommandApp()
_bench_app = tyro.extras.SubcommandApp()

Task = Annotated[str, tyro.conf.arg(help="which task, such as `sit-chair`")]
Tasks = Annotated[str, tyro.conf.arg(name="task", help="which task, such as `sit-chair`, or `all`")]
Count = Annotated[int | Literal["paper"], tyro.conf.arg(help="how many, or `paper` for as many as the paper has")]
Workdir = Annotated[Path, tyro.conf.arg(help="where all artefacts go, in <workdir>/<task>/<stage>")]
Seed = Annotated[int, tyro.conf.arg(help="same seed, same results, whatever the number of workers")]
Workers = Annotated[int, tyro.conf.arg(help="threads or processes; 0 for all processors")]
Device = Annotated[str, tyro.conf.arg(help="what computes the physics: cpu, cuda, cuda:1 (MuJoCo Warp on a GPU), or warp-cpu (slow, for tests)")]
Json = Annotated[bool, tyro.conf.arg(name="json", help="print the summary as one line of JSON and nothing else on stdout")]
Axis = Literal["x+", "x-", "y+", "y-", "z+", "z-"]
WORK = Path("work")


@_objects_app.command(name="make", is_default=True)
def objects(task: Tasks = "sit-chair", count: Count = 400, workdir: Workdir = WORK, seed: Seed = 0, workers: Workers = 0, as_json: Json = False) -> None:
    """Make the objects of a task, or of all tasks."""
    from mimicbench import workspace
    from mimicbench.objects.make import ObjectsConfig
    from mimicbench.references.paper import PAPER_SETS

    for slug in _slugs(task):
        ws = workspace.Workspace(workdir, slug, seed, workers, as_json)
        config = ObjectsConfig(PAPER_SETS[ws.task.slug].objects if count == "paper" else count)
        _done(workspace.objects_stage(ws, config).header, as_json)


@_objects_app.command(name="import")
def import_objects_(
    files: tyro.conf.Positional[tuple[Path, ...]],
    task: Task = "sit-chair",
    unit: Annotated[Literal["m", "cm", "mm", "in", "normalized"] | None, tyro.conf.arg(help="unit of the files' numbers; guessed if not given")] = None,
    height: Annotated[float | None, tyro.conf.arg(help="height that the objects shall have [m], instead of a unit")] = None,
    scale: Annotated[float | None, tyro.conf.arg(help="meters per unit of the files, instead of a unit")] = None,
    up: Annotated[Axis | None, tyro.conf.arg(help="the files' axis that points up; guessed if not given")] = None,
    front: Annotated[Axis | None, tyro.conf.arg(help="the files' axis that points to the objects' front; guessed if not given")] = None,
    pieces: Annotated[Literal["convex", "boxes"], tyro.conf.arg(help="what the objects collide with: convex pieces, or the boxes around them")] = "convex",
    mass: Annotated[float, tyro.conf.arg(help="of an object to be lifted [kg]")] = 2.0,
    workdir: Annotated[Path, tyro.conf.arg(help="a workdir of its own for these objects; the other commands go on from there")] = Path("work/own"),
    as_json: Json = False,
) -> None:
    """Make objects of your own meshes (OBJ, PLY, STL, GLB)."""
    from dataclasses import asdict

    from mimicbench import workspace
    from mimicbench.objects.own import ImportConfig, import_objects
    from mimicbench.objects.placing import Wishes

    ws = workspace.Workspace(workdir, task, quiet=as_json)
    config = ImportConfig(Wishes(unit, up, front, height, scale), pieces, mass)
    stage, evidence = import_objects(ws.folder("objects"), ws.slug, ws.task.family, files, config, _say)
    if as_json:
        print(json.dumps({"stage": "objects", "task": ws.slug, **stage.header["summary"], "imported": [asdict(found) for found in evidence]}))
    else:
        _done(stage.header, as_json)


app.command(_objects_app, name="objects", help="Make the task's objects, or import your own meshes.")


@_references_app.command(name="make", is_default=True)
def references(task: Tasks = "sit-chair", count: Count = 2000, workdir: Workdir = WORK, seed: Seed = 0, workers: Workers = 0, as_json: Json = False) -> None:
    """Make good human clips on the objects of a task, or of all tasks."""
    from mimicbench import workspace
    from mimicbench.references.make import ReferencesConfig
    from mimicbench.references.paper import PAPER_SETS

    for slug in _slugs(task):
        ws = workspace.Workspace(workdir, slug, seed, workers, as_json)
        config = ReferencesConfig(PAPER_SETS[ws.task.slug].clips if count == "paper" else count)
        _done(workspace.references_stage(ws, config).header, as_json)


@_references_app.command(name="remake")
def remake_(
    clip: tyro.conf.Positional[str],
    task: Annotated[str | None, tyro.conf.arg(help="the task; by default what the clip's id says")] = None,
    workdir: Workdir = WORK,
    to: Annotated[Path | None, tyro.conf.arg(help="file to write; by default <clip>.npz here")] = None,
    as_json: Json = False,
) -> None:
    """Make one clip of a workdir again from its id alone, such as sit-chair-0-00042, and say what the quality gate finds."""
    from mimicbench import workspace

    ws = workspace.Workspace(workdir, task or clip.rsplit("-", 2)[0], quiet=as_json)
    motion, wrong = workspace.remake_clip(ws, clip)
    path = to or Path(f"{clip}.npz")
    motion.save(path)
    if as_json:
        print(json.dumps({"clip": clip, "object": motion.object_id, "seconds": motion.duration, "rejected_for": wrong, "file": str(path)}))
    else:
        print(f"{path}: {motion.duration:.1f} s on {motion.object_id}, {'rejected for ' + ', '.join(wrong) if wrong else 'passes the gate'}")


@_references_app.command(name="augment")
def augment(
    to: Annotated[Path, tyro.conf.arg(help="a workdir of its own for the clips and their variants; the other commands go on from there")],
    task: Tasks = "sit-chair",
    kinds: Annotated[
        tuple[Literal["mirror", "speed", "start", "size"], ...],
        tyro.conf.arg(help="left and right exchanged; faster or slower; the way begins elsewhere; a larger or smaller object"),
    ] = ("mirror", "speed", "start", "size"),
    workdir: Workdir = WORK,
    seed: Seed = 0,
    workers: Workers = 0,
    as_json: Json = False,
) -> None:
    """Add variants of a workdir's human clips: mirrored, at other speeds, from other starts, on objects of other sizes."""
    from mimicbench import workspace
    from mimicbench.references.augment import AugmentConfig

    for slug in _slugs(task):
        ws = workspace.Workspace(workdir, slug, seed, workers, as_json)
        _done(workspace.augment_stage(ws, to, AugmentConfig(kinds)).header, as_json)


@_references_app.command(name="stats")
def references_stats(
    task: Tasks = "all",
    picture: Annotated[Path | None, tyro.conf.arg(help="PNG with the plots; by default <workdir>/references.png")] = None,
    styles: Annotated[bool, tyro.conf.arg(help="print every choice that clips make, too")] = False,
    workdir: Workdir = WORK,
    as_json: Json = False,
) -> None:
    """Print the paper's table of statistics for the clips of a workdir beside the paper's figures, and how the clips vary."""
    from mimicbench import workspace
    from mimicbench.report import dataset
    from mimicbench.report.tables import to_terminal

    sets = workspace.reference_statistics(workdir, _slugs(task))
    path = picture or workdir / "references.png"
    dataset.dataset_picture(sets, path)
    if as_json:
        print(json.dumps({found.task: found.to_dict() for found in sets}))
        return
    for table in (dataset.statistics_table(sets), dataset.variety_table(sets), *([dataset.style_table(sets)] if styles else [])):
        print(to_terminal(table))
    print(f"plots: {path}")


app.command(_references_app, name="references", help="Make human clips on the objects, and what can be done with them.")


def _slugs(task: str) -> list[str]:
    """The tasks that the user means, `all` for all six."""
    from mimicbench.tasks.registry import TASKS

    return list(TASKS) if task == "all" else [task]


@app.command(name="import")
def import_(
    files: tyro.conf.Positional[tuple[Path, ...]],
    task: Task = "sit-chair",
    form: Annotated[
        Literal["auto", "unihsi", "unihsi-states", "roam", "core4d", "amass", "bvh", "intermimic"],
        tyro.conf.arg(name="format", help="the files' format; by default found out"),
    ] = "auto",
    fps: Annotated[float | None, tyro.conf.arg(help="the files' frames per second; by default as they say, or as is usual in the format")] = None,
    up: Annotated[Axis | None, tyro.conf.arg(help="the files' axis that points up; by default as is usual in the format, or guessed")] = None,
    unit: Annotated[
        Literal["m", "cm", "mm", "in", "cmu"] | None, tyro.conf.arg(help="the files' unit of length (bvh, roam); by default guessed by the legs' length")
    ] = None,
    floor: Annotated[float | None, tyro.conf.arg(help="height of the files' floor [m]; by default where the soles usually are")] = None,
    object_mesh: Annotated[Path | None, tyro.conf.arg(help="mesh of the object that the files track (core4d, intermimic), in meters")] = None,
    workdir: Annotated[Path, tyro.conf.arg(help="a workdir of its own for these clips; the other commands go on from there")] = Path("work/real"),
    as_json: Json = False,
) -> None:
    """Import recordings of real people, each beside its object, or one fitted to the person."""
    from mimicbench import workspace
    from mimicbench.references.recording import Wishes

    wishes = Wishes(fps, up, unit, floor, object_mesh)
    _done(workspace.import_stage(workspace.Workspace(workdir, task, quiet=as_json), files, _say, form, wishes).header, as_json)


@_retarget_app.command(name="make", is_default=True)
def retarget(
    task: Tasks = "sit-chair",
    method: Annotated[str, tyro.conf.arg(help="copy-rotation, optimization, omnih2o or interaction")] = "optimization",
    preset: Annotated[Literal["improved", "paper"] | None, tyro.conf.arg(help="what we find to be better, or the paper to the letter")] = None,
    beside: Annotated[bool, tyro.conf.arg(help="into a folder of the method's own, that later stages do not go on from")] = False,
    workdir: Workdir = WORK,
    seed: Seed = 0,
    workers: Workers = 0,
    as_json: Json = False,
) -> None:
    """Turn the human clips into robot clips, and keep those that are solved and fulfil the task's metric."""
    from mimicbench import workspace
    from mimicbench.retarget.make import RetargetConfig

    for slug in _slugs(task):
        ws = workspace.Workspace(workdir, slug, seed, workers, as_json)
        header = workspace.retarget_stage(ws, RetargetConfig(method=method, preset=preset), beside).header
        told = header["summary"]
        if as_json:
            print(json.dumps({"stage": "retarget", "task": slug, **{name: header["config"][name] for name in ("robot", "method", "preset")}, **told}))
            continue
        wrong = ", ".join(f"{name} {count}" for name, count in told.get("rejected_for", {}).items())
        print(f"retarget: {told['clips']} clips, {told['fulfilled']} fulfil K, {100 * told['rate']:.1f} % kept{'; kept out for ' + wrong if wrong else ''}")
        if "measures" in told:
            from mimicbench.report.retargeting import measures_table
            from mimicbench.report.tables import to_terminal

            print(to_terminal(measures_table(slug, told["measures"])))


@_retarget_app.command(name="compare")
def retarget_compare(
    task: Tasks = "all",
    clips: Annotated[int, tyro.conf.arg(help="the first so many clips of each task")] = 16,
    preset: Annotated[Literal["improved", "paper"], tyro.conf.arg(help="of the methods that have both")] = "paper",
    pictures: Annotated[bool, tyro.conf.arg(help="draw the methods side by side on the first clip of each task")] = True,
    to: Annotated[Path | None, tyro.conf.arg(help="folder for page, tables and pictures; by default <workdir>/retarget-<preset>")] = None,
    workdir: Workdir = WORK,
    seed: Seed = 0,
    workers: Workers = 0,
    as_json: Json = False,
) -> None:
    """Retarget the same clips by every method and write a page: measures, K and pictures side by side."""
    from mimicbench import pipelines
    from mimicbench.report.tables import to_terminal

    folder = to or workdir / f"retarget-{preset}"
    found = pipelines.compare_retargeting(workdir, _slugs(task), clips, preset, folder, pictures, seed, workers, as_json, _say)
    if as_json:
        print(json.dumps(found.to_dict()))
        return
    for table in found.tables():
        print(to_terminal(table))
    print(f"page: {folder / 'index.html'}")


app.command(_retarget_app, name="retarget", help="Turn the human clips into robot clips, and compare the ways to do it.")


@app.command(name="track")
def track(
    task: Task = "sit-chair",
    evaluate: Annotated[bool, tyro.conf.arg(help="judge a trained tracker instead of training one")] = False,
    checkpoint: Annotated[Path | None, tyro.conf.arg(help="the tracker to evaluate; by default this workdir's")] = None,
    split: Annotated[Literal["train", "test", "all"], tyro.conf.arg(help="whose clips to evaluate on")] = "test",
    episodes: Annotated[int, tyro.conf.arg(help="clips to evaluate on")] = 256,
    preset: Annotated[Literal["paper", "improved"], tyro.conf.arg(help="the paper's HST, or ours")] = "improved",
    samples: Annotated[int, tyro.conf.arg(help="control steps to learn from")] = 30_000_000,
    workdir: Workdir = WORK,
    seed: Seed = 0,
    workers: Workers = 0,
    device: Device = "cpu",
    as_json: Json = False,
) -> None:
    """Train a tracker on the retargeted clips, or evaluate one."""
    from mimicbench import workspace

    ws = workspace.Workspace(workdir, task, seed, workers, as_json, device=device)
    if evaluate:
        rows = workspace.evaluate_tracker(ws, checkpoint or workspace.tracker_folder(ws), episodes, None if split == "all" else split)
        _summary(rows, as_json)
        return
    from mimicbench.track.train import TrackConfig

    _done(workspace.track_stage(ws, TrackConfig(preset=preset, samples=samples), _say).header, as_json)


@app.command(name="demos")
def demos(task: Task = "sit-chair", workdir: Workdir = WORK, seed: Seed = 0, workers: Workers = 0, device: Device = "cpu", as_json: Json = False) -> None:
    """Let the tracker turn the training clips into demonstrations (a LeRobotDataset v3)."""
    from mimicbench import workspace
    from mimicbench.imitate.demos import DemosConfig

    ws = workspace.Workspace(workdir, task, seed, workers, as_json, device=device)
    _done(workspace.demos_stage(ws, DemosConfig()).header, as_json)


@app.command(name="imitate")
def imitate(
    task: Task = "sit-chair",
    policy: Annotated[Literal["planner", "act", "bc", "act-clock", "bc-clock"], tyro.conf.arg(help="what to learn")] = "planner",
    minutes: Annotated[float, tyro.conf.arg(help="how long act and bc learn")] = 7.0,
    samples: Annotated[int, tyro.conf.arg(help="control steps that the planner learns from")] = 3_200_000,
    workdir: Workdir = WORK,
    seed: Seed = 0,
    workers: Workers = 0,
    device: Device = "cpu",
    as_json: Json = False,
) -> None:
    """Learn a policy that sees: a planner over the tracker by DAgger, or a clone of demonstrations."""
    from mimicbench import workspace
    from mimicbench.imitate.make import CloneConfig, ImitateConfig
    from mimicbench.imitate.planner import PlannerConfig
    from mimicbench.imitate.train import TrainConfig
    from mimicbench.sim.devices import tensor_device

    ws = workspace.Workspace(workdir, task, seed, workers, as_json, device=device)
    config = ImitateConfig(planner=PlannerConfig(samples=samples), clone=CloneConfig(TrainConfig(minutes=minutes, seed=seed, device=tensor_device(device))))
    _done(workspace.imitate_stage(ws, policy, config, _say).header, as_json)


@app.command(name="evaluate")
def evaluate(
    task: Task = "sit-chair",
    policy: Annotated[str, tyro.conf.arg(help="best, planner, act, bc, act-clock, bc-clock, or the path of a checkpoint")] = "best",
    episodes: Annotated[int, tyro.conf.arg(help="episodes on unseen objects from unseen starts")] = 400,
    workdir: Workdir = WORK,
    seed: Seed = 0,
    workers: Workers = 0,
    device: Device = "cpu",
    as_json: Json = False,
) -> None:
    """Judge a policy by K and P on objects and starts that it has never seen; makes them if the workdir has none."""
    from mimicbench import workspace
    from mimicbench.evaluate.rows import write_rows

    ws = workspace.Workspace(workdir, task, seed, workers, as_json, device=device)
    workspace.prepare_episodes(ws, episodes)
    rows, _ = workspace.evaluate_policy(ws, policy, episodes)
    write_rows(ws.folder("evaluate") / f"{rows[0].policy}.parquet", rows)
    _summary(rows, as_json)


@app.command(name="run")
def run(
    task: Task = "sit-chair",
    train: Annotated[bool, tyro.conf.arg(help="learn everything from nothing (hours) instead of using the shipped checkpoints (minutes)")] = False,
    profile: Annotated[Literal["smoke", "default", "full"] | None, tyro.conf.arg(help="how much; by default `default`, with --train `full`")] = None,
    workdir: Workdir = WORK,
    seed: Annotated[int | None, tyro.conf.arg(help="by default 0 with --train and 1 without, so that the shipped policies meet new objects")] = None,
    workers: Workers = 0,
    device: Device = "cpu",
    as_json: Json = False,
) -> None:
    """Do the whole task: new objects and human clips, retargeted, tracked, done by the policies, judged, reported."""
    from mimicbench import pipelines, workspace

    size = pipelines.PROFILES[profile or ("full" if train else "default")]
    ws = workspace.Workspace(workdir, task, (0 if train else 1) if seed is None else seed, workers, as_json, device=device)
    if train:
        from dataclasses import replace

        from mimicbench.imitate.make import CloneConfig, ImitateConfig
        from mimicbench.sim.devices import tensor_device
        from mimicbench.track.train import TrackConfig

        clone = CloneConfig(replace(CloneConfig().train, device=tensor_device(device)))

        page, rows = pipelines.run_training(ws, size, TrackConfig(), ImitateConfig(clone=clone), _say)
    else:
        page, rows = pipelines.run_shipped(ws, size, _say)
    if as_json:
        from mimicbench.report.compare import summaries

        print(json.dumps({"task": task, "report": str(page), "results": [found.to_dict() for found in summaries(rows)]}))
    else:
        _tables(task, rows)
        print(f"report: {page}")


@app.command(name="table")
def table(
    files: tyro.conf.Positional[tuple[Path, ...]],
    form: Annotated[Literal["terminal", "markdown", "latex", "csv"], tyro.conf.arg(name="format", help="how to print it")] = "terminal",
) -> None:
    """Print the results in files of episode rows (`<workdir>/<task>/evaluate/*.parquet`) beside the paper's, one table per task."""
    from mimicbench.evaluate.rows import read_rows
    from mimicbench.report import tables
    from mimicbench.report.compare import beside_paper_table, summaries

    write = {"terminal": tables.to_terminal, "markdown": tables.to_markdown, "latex": tables.to_latex, "csv": tables.to_csv}[form]
    rows = [row for path in files for row in read_rows(path)]
    for task in dict.fromkeys(row.task for row in rows):
        print(write(beside_paper_table(task, summaries([row for row in rows if row.task == task]))))


@_bench_app.command(name="stages", is_default=True)
def bench(
    task: Task = "sit-chair",
    seconds: Annotated[float, tyro.conf.arg(help="how long each part is measured")] = 10.0,
    workers: Workers = 0,
    device: Device = "cpu",
    as_json: Json = False,
) -> None:
    """Measure how fast this machine makes clips, retargets, simulates and learns."""
    from mimicbench.bench.stages import bench as measure
    from mimicbench.robot.description import load_robot
    from mimicbench.tasks.registry import get_task

    _measured(measure(load_robot("h1"), get_task(task), workers, seconds, _say, device), as_json)


@_bench_app.command(name="retarget")
def bench_retarget(
    tasks: Annotated[tuple[str, ...], tyro.conf.arg(help="whose clips; by default all six")] = (),
    clips: Annotated[int, tyro.conf.arg(help="clips of each task")] = 2,
    frames: Annotated[int, tyro.conf.arg(help="frames that Adam and mink get")] = 120,
    epochs: Annotated[int, tyro.conf.arg(help="of Adam; the paper has 3000")] = 3000,
    as_json: Json = False,
) -> None:
    """Measure every way to retarget on one core, beside the paper's Adam and a per-frame inverse kinematics with mink."""
    from mimicbench.bench.retargeting import ClipsConfig, bench, speed_table
    from mimicbench.report.tables import to_terminal
    from mimicbench.retarget.bench import RetargetBenchConfig
    from mimicbench.tasks.registry import TASKS, get_task

    chosen = tuple(get_task(task).slug for task in tasks or TASKS)
    found = bench(ClipsConfig(chosen, clips), RetargetBenchConfig(epochs, frames), _say)
    _measured(found, as_json)
    if not as_json:
        print(to_terminal(speed_table(found, chosen)))


@_bench_app.command(name="world")
def bench_world_(
    tasks: Annotated[tuple[str, ...], tyro.conf.arg(help="whose environments; by default all six")] = (),
    sizes: Annotated[tuple[int, ...], tyro.conf.arg(help="environments at once")] = (64, 512, 4096),
    seconds: Annotated[float, tyro.conf.arg(help="how long each figure is measured")] = 4.0,
    maps: Annotated[bool, tyro.conf.arg(help="measure with the elevation map too")] = True,
    memory: Annotated[bool, tyro.conf.arg(help="measure memory too, in processes of their own")] = True,
    workers: Workers = 0,
    device: Device = "cpu",
    as_json: Json = False,
) -> None:
    """Measure the environments of all tasks beside bare physics, their memory, and the senses."""
    from mimicbench.bench.world import WorldBenchConfig, bench_world
    from mimicbench.tasks.registry import TASKS, get_task

    chosen = tuple(get_task(task).slug for task in tasks or TASKS)
    _measured(bench_world(WorldBenchConfig(chosen, sizes, seconds, maps, memory, workers=workers, device=device), _say), as_json)


@_bench_app.command(name="soak")
def bench_soak(
    steps: Annotated[int, tyro.conf.arg(help="control steps, all tasks together")] = 10_000_000,
    objects: Annotated[int | None, tyro.conf.arg(help="objects of each family; by default as many as the paper has, 10.6 thousand")] = None,
    threads: Annotated[tuple[int, ...], tyro.conf.arg(help="do it once with each of these numbers of threads; the results must be the same")] = (1, 2),
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Compile every object, and step all tasks at random: nothing may break unreported, and threads may not matter."""
    from mimicbench.bench.soak import SoakConfig, soak

    found = soak(SoakConfig(steps, threads=threads, objects=objects, seed=seed), _say)
    _measured(found, as_json)
    if not found["sound"]:
        sys.exit(1)


app.command(_bench_app, name="bench", help="Measure how fast this machine is, and whether the world holds out.")


def _measured(found: Mapping[str, object], as_json: bool) -> None:
    """Print figures together with the machine they are of."""
    from mimicbench.report.provenance import this_machine

    if as_json:
        print(json.dumps({**found, "machine": this_machine()}))


def _say(line: str) -> None:
    """Progress goes to stderr, so that stdout holds results alone."""
    print(line, file=sys.stderr, flush=True)


def _tables(task: str, rows: list[EpisodeRow]) -> None:
    """Print the headline tables."""
    from rich.console import Console

    from mimicbench.report.compare import summaries
    from mimicbench.report.tables import to_rich
    from mimicbench.report.write import headline_tables

    for table in headline_tables(task, summaries(rows))[:2]:
        Console().print(to_rich(table))


def _summary(rows: list[EpisodeRow], as_json: bool) -> None:
    """Print the rates of one policy's episodes."""
    from mimicbench.evaluate.rows import summarize

    if as_json:
        print(json.dumps(summarize(rows).to_dict()))
    else:
        from rich.console import Console

        from mimicbench.report.compare import results_table
        from mimicbench.report.tables import to_rich

        Console().print(to_rich(results_table([summarize(rows)])))


def _done(header: object, as_json: bool) -> None:
    """Print what a stage came to."""
    if not isinstance(header, dict):
        return
    if as_json:
        print(json.dumps({"stage": header["stage"], "task": header["task"], **header["summary"]}))
    else:
        print(
            f"{header['stage']}: "
            + ", ".join(f"{key} {value:.3g}" if isinstance(value, float) else f"{key} {value}" for key, value in header["summary"].items())
        )


def main() -> None:
    """Run the command line; errors that the user can mend are printed in one sentence."""
    try:
        app.cli(prog="mimicbench", description="Humanoid-scene interaction learned by mimicking humans.")
    except MimicbenchError as error:
        print(f"mimicbench: {error}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print("mimicbench: stopped; the same command goes on from here", file=sys.stderr)
        sys.exit(130)


if __name__ == "__main__":
    main()
