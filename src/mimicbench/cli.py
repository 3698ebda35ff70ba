"""The command `mimicbench`. Everything heavy is imported inside the commands, so that help is quick."""

import json
import os
import sys
from pathlib import Path
from typing import Annotated, Literal

import tyro

from mimicbench.core.errors import MimicbenchError

app = tyro.extras.SubcommandApp()

Task = Annotated[str, tyro.conf.arg(help="which task; `sit-chair`")]
Workdir = Annotated[Path, tyro.conf.arg(help="where all artefacts go, in <workdir>/<task>/<stage>")]
Seed = Annotated[int, tyro.conf.arg(help="same seed, same results, whatever the number of workers")]
Workers = Annotated[int, tyro.conf.arg(help="threads or processes; 0 for all processors")]
Json = Annotated[bool, tyro.conf.arg(name="json", help="print the summary as one line of JSON and nothing else on stdout")]
WORK = Path("work")


@app.command(name="objects")
def objects(task: Task = "sit-chair", count: int = 400, workdir: Workdir = WORK, seed: Seed = 0, workers: Workers = 0, as_json: Json = False) -> None:
    """Make the task's objects."""
    from mimicbench import pipelines
    from mimicbench.objects.make import ObjectsConfig

    ws = pipelines.Workspace(workdir, task, seed, workers, as_json)
    _done(pipelines.objects_stage(ws, ObjectsConfig(count)).header, as_json)


@app.command(name="references")
def references(task: Task = "sit-chair", count: int = 2000, workdir: Workdir = WORK, seed: Seed = 0, workers: Workers = 0, as_json: Json = False) -> None:
    """Make human clips on the objects."""
    from mimicbench import pipelines
    from mimicbench.references.make import ReferencesConfig

    ws = pipelines.Workspace(workdir, task, seed, workers, as_json)
    _done(pipelines.references_stage(ws, ReferencesConfig(count)).header, as_json)


@app.command(name="retarget")
def retarget(task: Task = "sit-chair", workdir: Workdir = WORK, seed: Seed = 0, workers: Workers = 0, as_json: Json = False) -> None:
    """Turn the human clips into robot clips and keep those that fulfil the task's metric."""
    from mimicbench import pipelines
    from mimicbench.retarget.make import RetargetConfig

    ws = pipelines.Workspace(workdir, task, seed, workers, as_json)
    _done(pipelines.retarget_stage(ws, RetargetConfig()).header, as_json)


@app.command(name="track")
def track(
    task: Task = "sit-chair",
    evaluate: Annotated[bool, tyro.conf.arg(help="judge a trained tracker instead of training one")] = False,
    checkpoint: Annotated[Path | None, tyro.conf.arg(help="the tracker to evaluate; by default this workdir's")] = None,
    split: Annotated[Literal["train", "test"], tyro.conf.arg(help="whose clips to evaluate on")] = "test",
    episodes: Annotated[int, tyro.conf.arg(help="clips to evaluate on")] = 256,
    preset: Annotated[Literal["paper", "improved"], tyro.conf.arg(help="the paper's HST, or ours")] = "improved",
    samples: Annotated[int, tyro.conf.arg(help="control steps to learn from")] = 30_000_000,
    workdir: Workdir = WORK,
    seed: Seed = 0,
    workers: Workers = 0,
    as_json: Json = False,
) -> None:
    """Train a tracker on the retargeted clips, or evaluate one."""
    from mimicbench import pipelines

    ws = pipelines.Workspace(workdir, task, seed, workers, as_json)
    if evaluate:
        _summary(pipelines.evaluate_tracker(ws, checkpoint or ws.folder("track") / "checkpoint", episodes, split), as_json)
        return
    from mimicbench.track.train import TrackConfig

    _done(pipelines.track_stage(ws, TrackConfig(preset=preset, samples=samples), lambda line: print(line, file=sys.stderr, flush=True)).header, as_json)


def _summary(rows: object, as_json: bool) -> None:
    """Print the rates of one policy's episodes."""
    from mimicbench.evaluate.rows import summarize

    print(json.dumps(summarize(rows).to_dict()))  # pyright: ignore[reportArgumentType]


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
    # torch's and the physics' threads take turns on the same cores: waiting ones must not spin
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
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
