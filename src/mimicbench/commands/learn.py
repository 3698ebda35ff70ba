"""`mimicbench track`, `demos`, `imitate`: everything that learns."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import tyro

from mimicbench.commands.options import WORK, Device, Json, Seed, Task, Workdir, Workers, done, say, summary


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
        rows = workspace.evaluate_tracker(
            ws, checkpoint or workspace.tracker_folder(ws), episodes, None if split == "all" else split
        )
        summary(rows, as_json)
        return
    from mimicbench.track.train import TrackConfig

    done(
        workspace.track_stage(
            ws, TrackConfig(tracker="hst" if preset == "paper" else "residual", samples=samples), say
        ).header,
        as_json,
    )


def demos(
    task: Task = "sit-chair",
    workdir: Workdir = WORK,
    seed: Seed = 0,
    workers: Workers = 0,
    device: Device = "cpu",
    as_json: Json = False,
) -> None:
    """Let the tracker turn the training clips into demonstrations (a LeRobotDataset v3)."""
    from mimicbench import workspace
    from mimicbench.imitate.demos import DemosConfig

    ws = workspace.Workspace(workdir, task, seed, workers, as_json, device=device)
    done(workspace.demos_stage(ws, DemosConfig()).header, as_json)


def imitate(
    task: Task = "sit-chair",
    policy: Annotated[
        Literal["planner", "act", "bc", "act-clock", "bc-clock"], tyro.conf.arg(help="what to learn")
    ] = "planner",
    batches: Annotated[int, tyro.conf.arg(help="batches that act and bc learn from")] = 3000,
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
    config = ImitateConfig(
        planner=PlannerConfig(samples=samples),
        clone=CloneConfig(TrainConfig(steps=batches, seed=seed, device=tensor_device(device))),
    )
    done(workspace.imitate_stage(ws, policy, config, say).header, as_json)
