"""`mimicbench bench`: how fast this machine is, and whether the world holds out."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import tyro

from mimicbench.commands.options import Device, Json, Seed, Task, Workdir, Workers
from mimicbench.commands.telling import one_line
from mimicbench.core.errors import MimicbenchError
from mimicbench.core.run import to_stderr as say
from mimicbench.core.settings import Amount, Count, Within
from mimicbench.robots.registry import DEFAULT_ROBOT
from mimicbench.tasks.registry import DEFAULT_TASK


def stages(
    task: Task = DEFAULT_TASK,
    seconds: Annotated[float, Within(0.01, 3600), tyro.conf.arg(help="how long each part is measured")] = 10.0,
    num_envs: Annotated[Count, tyro.conf.arg(help="robots side by side; a GPU wants thousands")] = 512,
    workers: Workers = 0,
    device: Device = "cpu",
    as_json: Json = False,
) -> None:
    """Measure how fast this machine makes clips, retargets, simulates and learns."""
    from mimicbench.bench.stages import bench as measure
    from mimicbench.robots.registry import DEFAULT_ROBOT, ROBOTS
    from mimicbench.tasks.registry import TASKS

    _measured(measure(ROBOTS.get(DEFAULT_ROBOT), TASKS.get(task), workers, seconds, say, device, num_envs), as_json)


def retarget(
    tasks: Annotated[tuple[str, ...], tyro.conf.arg(help="whose clips; by default all six")] = (),
    clips: Annotated[Count, tyro.conf.arg(help="clips of each task")] = 2,
    frames: Annotated[Count, tyro.conf.arg(help="frames that Adam and mink get")] = 120,
    epochs: Annotated[Count, tyro.conf.arg(help="of Adam; the paper has 3000")] = 3000,
    as_json: Json = False,
) -> None:
    """Measure every way to retarget on one core, beside the paper's Adam and a per-frame inverse kinematics with
    mink.
    """
    from mimicbench.bench.retargeting import ClipsConfig, bench, speed_table
    from mimicbench.report.table import to_terminal
    from mimicbench.retarget.baselines.speed import RetargetBenchConfig
    from mimicbench.tasks.registry import TASKS

    chosen = tuple(TASKS.get(task).name for task in tasks or TASKS)
    found = bench(ClipsConfig(chosen, clips), RetargetBenchConfig(epochs, frames), say)
    _measured(found, as_json)
    if not as_json:
        print(to_terminal(speed_table(found, chosen)))


def world(
    tasks: Annotated[tuple[str, ...], tyro.conf.arg(help="whose environments; by default all six")] = (),
    sizes: Annotated[tuple[int, ...], Within(1, 1_000_000), tyro.conf.arg(help="environments at once")] = (
        64,
        512,
        4096,
    ),
    seconds: Annotated[float, Within(0.01, 3600), tyro.conf.arg(help="how long each figure is measured")] = 4.0,
    maps: Annotated[bool, tyro.conf.arg(help="measure with the elevation map too")] = True,
    memory: Annotated[bool, tyro.conf.arg(help="measure memory too, in processes of their own")] = True,
    workers: Workers = 0,
    device: Device = "cpu",
    as_json: Json = False,
) -> None:
    """Measure the environments of all tasks beside bare physics, their memory, and the senses."""
    from mimicbench.bench.world import WorldBenchConfig, bench_world
    from mimicbench.tasks.registry import TASKS

    chosen = tuple(TASKS.get(task).name for task in tasks or TASKS)
    _measured(
        bench_world(WorldBenchConfig(chosen, sizes, seconds, maps, memory, workers=workers, device=device), say),
        as_json,
    )


def maps(
    tasks: Annotated[tuple[str, ...], tyro.conf.arg(help="whose objects and cameras; by default all six")] = (),
    sizes: Annotated[tuple[int, ...], Within(1, 1_000_000), tyro.conf.arg(help="robots at once")] = (64, 512, 4096),
    seconds: Annotated[float, Within(0.01, 3600), tyro.conf.arg(help="how long each figure is measured")] = 2.0,
    workers: Workers = 0,
    device: Device = "cpu",
    as_json: Json = False,
) -> None:
    """Measure elevation maps, both kinds, beside bare physics."""
    from mimicbench.bench.maps import MapBenchConfig, bench_maps
    from mimicbench.tasks.registry import TASKS

    chosen = tuple(TASKS.get(task).name for task in tasks or TASKS)
    _measured(bench_maps(MapBenchConfig(chosen, sizes, seconds, workers=workers, device=device), say), as_json)


def imitate(
    learners: Annotated[tuple[str, ...], tyro.conf.arg(help="whom to measure; by default all")] = (),
    task: Task = DEFAULT_TASK,
    robot: Annotated[str, tyro.conf.arg(help="which robot")] = DEFAULT_ROBOT,
    seconds: Annotated[float, Within(0.01, 3600), tyro.conf.arg(help="how long each figure is measured")] = 10.0,
    as_json: Json = False,
) -> None:
    """Measure how fast learners learn, for how much of that they wait for data, and how long a decision takes."""
    from mimicbench.bench.imitation import bench_imitation
    from mimicbench.robots.registry import ROBOTS
    from mimicbench.tasks.registry import TASKS

    _measured(bench_imitation(ROBOTS.get(robot), TASKS.get(task), learners, seconds, say), as_json)


def robust(
    tasks: Annotated[tuple[str, ...], tyro.conf.arg(help="whose clips; by default all six")] = (),
    tracker: Annotated[str, tyro.conf.arg(help="folder of a tracker's checkpoint; by default the shipped one")] = "",
    clips: Annotated[Count, tyro.conf.arg(help="clips of each task, on unseen objects")] = 64,
    workdir: Workdir = Path("work"),
    seed: Seed = 0,
    workers: Workers = 0,
    device: Device = "cpu",
    as_json: Json = False,
) -> None:
    """Let a tracker follow clips under pushes, on other floors, with another mass, late targets and erring sensors."""
    from mimicbench.bench.robustness import bench_robustness, robustness_table
    from mimicbench.benchmark.graph import env_config, start
    from mimicbench.benchmark.judging import episodes_of
    from mimicbench.benchmark.recipe import Recipe
    from mimicbench.benchmark.who import who_of
    from mimicbench.core.run import RunContext
    from mimicbench.report.table import to_terminal
    from mimicbench.tasks.registry import TASKS
    from mimicbench.track.checkpoint import load_tracker

    context = RunContext(workers=workers, device=device)
    runs = [start(Recipe(task=task, seed=seed), workdir, context) for task in tasks or TASKS]
    # who there is, before any work
    who = [who_of(run, tracker or "tracker") for run in runs]
    if other := next((one for one in who if not one.is_tracker), None):
        raise MimicbenchError(f"{other.name!r} is a policy, and follows no clips; give the folder of a tracker")
    found = {}
    for run, one in zip(runs, who, strict=True):
        set_of = episodes_of(run, clips).set
        found[run.task.name] = bench_robustness(load_tracker(one.folder, run.robot), set_of, env_config(run), say)
    _measured(found, as_json)
    if not as_json:
        print(to_terminal(robustness_table(found)))


def soak(
    steps: Annotated[int, Amount(), tyro.conf.arg(help="control steps, all tasks together")] = 10_000_000,
    objects: Annotated[
        int | None,
        Within(1, 10_000_000),
        tyro.conf.arg(help="objects of each family; by default as many as the paper has, 10.6 thousand"),
    ] = None,
    threads: Annotated[
        tuple[int, ...],
        Within(1, 4096),
        tyro.conf.arg(help="do it once with each of these numbers of threads; the results must be the same"),
    ] = (1, 2),
    seed: Seed = 0,
    as_json: Json = False,
) -> None:
    """Compile every object, and step all tasks at random: nothing may break unreported, and threads may not matter."""
    from mimicbench.bench.soak import SoakConfig
    from mimicbench.bench.soak import soak as run_soak

    found = run_soak(SoakConfig(steps, threads=threads, objects=objects, seed=seed), say)
    _measured(found, as_json)
    if not found["sound"]:
        sys.exit(1)


def _measured(found: Mapping[str, object], as_json: bool) -> None:
    """Print figures together with the machine they are of."""
    from mimicbench.report.provenance import this_machine

    if as_json:
        print(one_line({**found, "machine": this_machine()}))
