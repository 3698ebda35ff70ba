"""Kill every stage at random moments, run it again, and compare what it left with what one that was left alone made.

python scripts/kill_stages.py --count 100                    # each stage so often
python scripts/kill_stages.py --count 3 --stages track clone

Each command runs in a process forked from one that has imported everything: quicker, and what is killed is the work
and not the imports, most of what a small stage spends its time with.
"""

import argparse
import contextlib
import hashlib
import os
import random
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from mimicbench import cli

OWN = """
objects = { count = 8 }
references = { count = 6 }

[track]
samples = 4096
num_envs = 32
evaluate_every = 2048
evaluate_clips = 2
save_every = 0.0
ppo = { hidden = [32], steps = 8 }

[imitate]
learner = "planner"
perception = { maps = 64, steps = 60, batch = 8, save_every = 0.0 }
planner = { samples = 2048, num_envs = 16, steps = 8, batches = 4, batch = 32, memory = 512, save_every = 0.0 }
"""
"""A recipe that trains a tracker, which nobody can learn from: it is as small as can be."""
SHIPPED = """
objects = { count = 8 }
references = { count = 6 }
demos = { clips = 3, batch = 1 }
evaluate = { episodes = 3, split = "train", policy = ["bc-clock"] }

[imitate]
learner = "bc-clock"
perception = { maps = 64, steps = 60, batch = 8, save_every = 0.0 }
train = { steps = 40, batch = 8, save_every = 0.0 }
"""
"""One with the shipped tracker, whose demonstrations can be cloned."""


@dataclass(frozen=True)
class Stage:
    """What is killed."""

    recipe: str
    command: str
    made: tuple[str, ...]
    """The folders that it makes: they are removed before, and compared after."""
    trained: bool = False
    """Whether files say how many seconds it took."""


STAGES: Mapping[str, Stage] = {
    "objects": Stage(OWN, "objects", ("objects",)),
    "references": Stage(OWN, "references", ("references",)),
    "retarget": Stage(OWN, "retarget", ("retarget",)),
    "track": Stage(OWN, "track", ("track",), trained=True),
    "imitate": Stage(OWN, "imitate", ("perception", "imitate"), trained=True),
    "demos": Stage(SHIPPED, "demos", ("demos",)),
    "clone": Stage(SHIPPED, "imitate", ("perception", "imitate"), trained=True),
    "evaluate": Stage(SHIPPED, "evaluate", ("evaluate",)),
}
IMPORTED = (
    "torch",
    "mujoco",
    "pyarrow.parquet",
    "tensordict",
    "rsl_rl",
    "mimicbench.benchmark.graph",
    "mimicbench.benchmark.judging",
)
CLOCKS = ("metrics.jsonl", "training.safetensors", "header.json", "config.json")
"""Files of trainings that say how many seconds they took, which a kill makes more; networks are compared."""


def begun(stage: Stage, workdir: Path) -> int:
    """The process that makes a stage; what it says goes into the file `said`."""
    process = os.fork()
    if process:
        with contextlib.suppress(PermissionError, ProcessLookupError):  # the child may have done it, and be over
            os.setpgid(process, process)
        return process
    # of a group of its own, whoever of the two gets there first: it may be killed at once
    os.setpgid(0, 0)
    said = os.open(workdir / "said", os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(said, 1)
    os.dup2(said, 2)
    words = ["--config", str(workdir / "recipe.toml"), "--workdir", str(workdir), "--workers", "1", "--json"]
    status = 1
    try:
        cli.main([stage.command, *words])
        status = 0
    except SystemExit as error:
        status = error.code if isinstance(error.code, int) else int(error.code is not None)
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(status)


def finished(process: int, workdir: Path) -> str:
    """Wait for a process; the last line of what it said if it failed."""
    _, status = os.waitpid(process, 0)
    said = (workdir / "said").read_text(errors="replace").strip().splitlines()
    return "" if status == 0 else said[-1] if said else f"status {status}"


def contents(workdir: Path, stage: Stage) -> dict[str, str]:
    """Digests of the files of a stage."""
    return {
        str(path.relative_to(workdir)): hashlib.blake2b(path.read_bytes()).hexdigest()
        for made in stage.made
        for path in sorted((workdir / "sit-chair" / made).rglob("*"))
        if path.is_file() and not (stage.trained and (path.name in CLOCKS or path.parent.name == "tensorboard"))
    }


def killed(stage: Stage, whole: Path, after: float) -> tuple[bool, str]:
    """Whether a stage was still at work after so many seconds and could be killed, and what differs once it has been
    run again; empty if nothing does.
    """
    with tempfile.TemporaryDirectory() as name:
        workdir = Path(name)
        shutil.copy(whole / "recipe.toml", workdir)
        shutil.copytree(whole / "sit-chair", workdir / "sit-chair")
        for made in stage.made:
            shutil.rmtree(workdir / "sit-chair" / made)
        process = begun(stage, workdir)
        time.sleep(after)
        working = os.waitpid(process, os.WNOHANG) == (0, 0)
        if working:
            os.killpg(process, signal.SIGKILL)
            os.waitpid(process, 0)
        if trouble := finished(begun(stage, workdir), workdir):
            return working, trouble
        wanted, found = contents(whole, stage), contents(workdir, stage)
        return working, ", ".join(sorted(path for path in {*wanted, *found} if wanted.get(path) != found.get(path)))


def campaign(name: str, stage: Stage, whole: Path, count: int, moments: random.Random) -> int:
    """Kill a stage so often, and say what came of it; how many ended otherwise. `whole` gets the stage."""
    started = time.monotonic()
    if trouble := finished(begun(stage, whole), whole):
        raise SystemExit(f"{name}: {trouble}")
    seconds = time.monotonic() - started
    if not count:
        return 0
    found = [killed(stage, whole, moments.uniform(0, seconds)) for _ in range(count)]
    differ = [one for _, one in found if one]
    alive, took = sum(working for working, _ in found), time.monotonic() - started
    told = f"{name}: {count} kills within {seconds:.1f} s, {alive} of them at work"
    print(f"{told}, {len(differ)} ended otherwise ({took:.0f} s in all)", flush=True)
    for one in differ[:5]:
        print(f"    {one}", flush=True)
    return len(differ)


def main() -> int:
    """0 if every killed stage ended in the same bytes."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--count", type=int, default=100, help="kills of each stage")
    parser.add_argument("--stages", nargs="+", choices=STAGES, default=list(STAGES))
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    for module in IMPORTED:
        import_module(module)
    moments, bad = random.Random(chosen.seed), 0
    for recipe in (OWN, SHIPPED):
        wanted = [name for name in chosen.stages if STAGES[name].recipe == recipe]
        with tempfile.TemporaryDirectory() as folder:
            whole = Path(folder)
            (whole / "recipe.toml").write_text(recipe)
            names = [name for name, stage in STAGES.items() if stage.recipe == recipe]
            for name in names[: 1 + max((names.index(one) for one in wanted), default=-1)]:
                bad += campaign(name, STAGES[name], whole, chosen.count if name in wanted else 0, moments)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
