"""`mimicbench evaluate`, `run`, `table`: what the policies can do."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from mimicbench.commands.options import WORK, Device, Json, Seed, Task, Workdir, Workers, say, summary

if TYPE_CHECKING:
    from mimicbench.evaluate.rows import EpisodeRow


def evaluate(
    task: Task = "sit-chair",
    policy: Annotated[
        str, tyro.conf.arg(help="best, planner, act, bc, act-clock, bc-clock, or the path of a checkpoint")
    ] = "best",
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
    summary(rows, as_json)


def run(
    task: Task = "sit-chair",
    train: Annotated[
        bool,
        tyro.conf.arg(help="learn everything from nothing (hours) instead of using the shipped checkpoints (minutes)"),
    ] = False,
    profile: Annotated[
        Literal["smoke", "default", "full"] | None,
        tyro.conf.arg(help="how much; by default `default`, with --train `full`"),
    ] = None,
    workdir: Workdir = WORK,
    seed: Annotated[
        int | None,
        tyro.conf.arg(help="by default 0 with --train and 1 without, so that the shipped policies meet new objects"),
    ] = None,
    workers: Workers = 0,
    device: Device = "cpu",
    as_json: Json = False,
) -> None:
    """Do the whole task: new objects and human clips, retargeted, tracked, done by the policies, judged, reported."""
    from mimicbench import pipelines, workspace

    size = pipelines.PROFILES[profile or ("full" if train else "default")]
    ws = workspace.Workspace(
        workdir, task, (0 if train else 1) if seed is None else seed, workers, as_json, device=device
    )
    if train:
        from dataclasses import replace

        from mimicbench.imitate.make import CloneConfig, ImitateConfig
        from mimicbench.sim.devices import tensor_device
        from mimicbench.track.train import TrackConfig

        clone = CloneConfig(replace(CloneConfig().train, device=tensor_device(device)))

        page, rows = pipelines.run_training(ws, size, TrackConfig(), ImitateConfig(clone=clone), say)
    else:
        page, rows = pipelines.run_shipped(ws, size, say)
    if as_json:
        from mimicbench.report.compare import summaries

        print(
            json.dumps({"task": task, "report": str(page), "results": [found.to_dict() for found in summaries(rows)]})
        )
    else:
        _tables(task, rows)
        print(f"report: {page}")


def table(
    files: tyro.conf.Positional[tuple[Path, ...]],
    form: Annotated[
        Literal["terminal", "markdown", "latex", "csv"], tyro.conf.arg(name="format", help="how to print it")
    ] = "terminal",
) -> None:
    """Print the results in files of episode rows (`<workdir>/<task>/evaluate/*.parquet`) beside the paper's, one
    table per task.
    """
    from mimicbench.evaluate.rows import read_rows
    from mimicbench.report import tables
    from mimicbench.report.compare import beside_paper_table, summaries

    write = {
        "terminal": tables.to_terminal,
        "markdown": tables.to_markdown,
        "latex": tables.to_latex,
        "csv": tables.to_csv,
    }[form]
    rows = [row for path in files for row in read_rows(path)]
    for task in dict.fromkeys(row.task for row in rows):
        print(write(beside_paper_table(task, summaries([row for row in rows if row.task == task]))))


def _tables(task: str, rows: list[EpisodeRow]) -> None:
    """Print the headline tables."""
    from rich.console import Console

    from mimicbench.report.compare import summaries
    from mimicbench.report.tables import to_rich
    from mimicbench.report.write import headline_tables

    for table in headline_tables(task, summaries(rows))[:2]:
        Console().print(to_rich(table))
