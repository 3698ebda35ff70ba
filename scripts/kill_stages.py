"""Kill every stage at random moments, run it again, and compare what it left with what one that was left alone made.

python scripts/kill_stages.py --count 100                     # each stage so often
python scripts/kill_stages.py --count 3 --stages track clone
python scripts/kill_stages.py --count 100 --into kills.jsonl  # a line per kill; stopped, it goes on after the last

Each stage runs in a process forked from one that has imported everything: quicker, and what is killed is the work and
not the imports, most of what a small stage spends its time with. The system ends it after a random share of the
processor time that the whole stage takes, however busy the machine is. One that was done before that is not counted.
"""

import argparse
import contextlib
import dataclasses
import hashlib
import json
import os
import random
import shutil
import signal
import sys
import tempfile
import time
import tomllib
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from mimicbench.benchmark import run_stage
from mimicbench.benchmark.graph import start
from mimicbench.benchmark.judging import judge
from mimicbench.benchmark.recipe import Recipe, read_recipe
from mimicbench.core.run import RunContext

OWN = read_recipe(
    tomllib.loads("""
task = "sit-chair"
objects = { count = 6 }
references = { count = 2 }
retarget = { method = "optimization" }

[track]
samples = 512
num_envs = 8
evaluate_every = 256
evaluate_clips = 1
save_every = 0.0
ppo = { hidden = [16], steps = 8 }

[imitate]
learner = "planner"
perception = { maps = 16, steps = 20, batch = 8, save_every = 0.0 }
planner = { samples = 256, num_envs = 8, steps = 8, batches = 2, batch = 16, memory = 256, save_every = 0.0 }
""")
)
"""It trains a tracker, which nobody can learn from: all is as small as can be."""
SHIPPED = read_recipe(
    tomllib.loads("""
task = "touch-points"
objects = { count = 6 }
references = { count = 2 }
demos = { clips = 2, batch = 1 }
evaluate = { episodes = 1, policy = ["bc-clock"] }

[imitate]
learner = "bc-clock"
train = { steps = 20, batch = 8, save_every = 0.0 }
""")
)
"""One with the shipped tracker, whose demonstrations can be cloned."""


@dataclass(frozen=True)
class Stage:
    """What is killed."""

    name: str
    recipe: Recipe
    trained: bool = False
    """Whether files say how many seconds it took."""


STAGES: Mapping[str, Stage] = {
    "objects": Stage("objects", OWN),
    "references": Stage("references", OWN),
    "retarget": Stage("retarget", OWN),
    "track": Stage("track", OWN, trained=True),
    "perception": Stage("perception", OWN, trained=True),
    "imitate": Stage("imitate", OWN, trained=True),
    "demos": Stage("demos", SHIPPED),
    "clone": Stage("imitate", SHIPPED, trained=True),
    "evaluate": Stage("evaluate", SHIPPED),
}
"""In an order in which each finds what it needs; what it does not find, like the clips of an evaluation, it makes."""
CLOCKS = ("metrics.jsonl", "training.safetensors", "header.json", "config.json")
"""Files of trainings that say how many seconds they took, which a kill makes more; networks are compared."""


@dataclass(frozen=True)
class Kill:
    """A kill that found its stage at work."""

    stage: str
    number: int
    """Which draw of the stage's it was."""
    share: float
    """After which part of the processor time that the stage takes."""
    differs: str
    """What was otherwise once the stage had been run again; empty if nothing was."""


def make(stage: Stage, workdir: Path) -> None:
    """Make a stage in this process."""
    quiet = RunContext(workers=1, quiet=True)
    if stage.name == "evaluate":
        judge(start(stage.recipe, workdir, quiet), *stage.recipe.evaluate.policy)
    else:
        run_stage(stage.name, stage.recipe, workdir, quiet)


def in_process(work: Callable[[], None], said: Path, kill_after: float = 0.0) -> tuple[int, float]:
    """Do some work in a process of its own, which ends at once when it has worked so long [s of the processor].

    Its wait status, and how long it worked. `said` gets what it says, and behind that the modules that it imported.
    """
    process = os.fork()
    if process:
        _, status, used = os.wait4(process, 0)
        return status, used.ru_utime + used.ru_stime
    status = 1
    try:
        file = os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(file, 1)
        os.dup2(file, 2)
        signal.setitimer(signal.ITIMER_PROF, kill_after)  # nobody handles SIGPROF: it ends a process as SIGKILL does
        work()
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        said.with_suffix(".imported").write_text("\n".join(list(sys.modules)))
        status = 0
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(status)


def finished(stage: Stage, workdir: Path) -> tuple[str, float]:
    """Run a stage to its end: the last line of what it said if it failed, and its processor time [s]."""
    said = workdir / "said"
    status, seconds = in_process(lambda: make(stage, workdir), said)
    lines = said.read_text(errors="replace").strip().splitlines()
    return "" if status == 0 else lines[-1] if lines else f"status {status}", seconds


def files(workdir: Path) -> set[Path]:
    """Whatever stages have left in a folder, relative to it."""
    return {path.relative_to(workdir) for path in workdir.glob("*/**/*") if path.is_file()}


def contents(stage: Stage, workdir: Path) -> dict[str, str]:
    """Digests of the files of all stages, without those that say how long a training took."""
    return {
        str(path): hashlib.blake2b((workdir / path).read_bytes()).hexdigest()
        for path in files(workdir)
        if not (stage.trained and (path.name in CLOCKS or path.parent.name == "tensorboard"))
    }


def differences(stage: Stage, whole: Path, workdir: Path) -> str:
    """Which files are others in one folder than in the other."""
    wanted, found = contents(stage, whole), contents(stage, workdir)
    return ", ".join(sorted(path for path in {*wanted, *found} if wanted.get(path) != found.get(path)))


@contextlib.contextmanager
def without(made: set[Path], whole: Path) -> Iterator[Path]:
    """A copy of a folder that lacks some files."""
    with tempfile.TemporaryDirectory() as name:
        workdir = Path(name)
        for path in files(whole) - made:
            (workdir / path).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(whole / path, workdir / path)
        yield workdir


def killed(stage: Stage, made: set[Path], whole: Path, after: float) -> tuple[bool, str]:
    """Whether a stage could be killed after so many seconds of the processor before it was done, and what differs once
    it has been run again; empty if nothing does.
    """
    with without(made, whole) as workdir:
        status, _ = in_process(lambda: make(stage, workdir), workdir / "said", after)
        if not os.WIFSIGNALED(status):
            return False, differences(stage, whole, workdir) if status == 0 else "failed"
        trouble, _ = finished(stage, workdir)
        return True, trouble or differences(stage, whole, workdir)


def prepare(name: str, stage: Stage, whole: Path) -> set[Path]:
    """Make a stage in `whole`, and import here what that imported; the files that it made."""
    before = files(whole)
    trouble, _ = finished(stage, whole)
    if trouble:
        raise SystemExit(f"{name}: {trouble}")
    for module in (whole / "said.imported").read_text().split():
        with contextlib.suppress(Exception):  # parts of packages that cannot be imported by their names
            import_module(module)
    return files(whole) - before


def campaign(
    name: str, made: set[Path], whole: Path, count: int, done: Sequence[Kill] = (), seed: int = 0
) -> Iterator[Kill]:
    """Kill a stage that made these files in `whole`, until that has been done so often, with those that are done."""
    stage = STAGES[name]
    with without(made, whole) as workdir:
        trouble, seconds = finished(stage, workdir)
        if trouble := trouble or differences(stage, whole, workdir):
            raise SystemExit(f"{name}: differs where nothing was killed: {trouble}")
    number = max((kill.number + 1 for kill in done), default=0)
    missing = count - len(done)
    while missing > 0:
        share = random.Random(f"{seed} {name} {number}").random()
        working, differs = killed(stage, made, whole, max(1e-6, share * seconds))
        if working or differs:
            yield Kill(name, number, round(share, 4), differs)
            missing -= 1
        number += 1


def earlier(file: Path | None) -> list[Kill]:
    """Kills that a file tells of."""
    if file is None or not file.exists():
        return []
    return [Kill(**json.loads(line)) for line in file.read_text().splitlines()]


def main() -> int:
    """0 if every killed stage ended in the same bytes."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--count", type=int, default=100, help="kills of each stage")
    parser.add_argument("--stages", nargs="+", choices=STAGES, default=list(STAGES))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--into", type=Path, help="append a line for every kill to this file, and go on after its last")
    chosen = parser.parse_args()
    kills = earlier(chosen.into)
    with tempfile.TemporaryDirectory() as folder:
        whole, before = Path(folder), list(STAGES)[: 1 + max(list(STAGES).index(name) for name in chosen.stages)]
        for name in before:
            stage, began = STAGES[name], time.monotonic()
            made = prepare(name, stage, whole)
            if name not in chosen.stages:
                continue
            done = [kill for kill in kills if kill.stage == name]
            for kill in campaign(name, made, whole, chosen.count, done, chosen.seed):
                done.append(kill)
                if chosen.into is not None:
                    with open(chosen.into, "a") as stream:
                        stream.write(json.dumps(dataclasses.asdict(kill)) + "\n")
            differ = [kill.differs for kill in done if kill.differs]
            seconds = time.monotonic() - began
            print(f"{name}: {len(done)} kills, {len(differ)} ended otherwise ({seconds:.0f} s)", *differ[:5],
                  sep="\n    ", flush=True)  # fmt: skip
            kills += [kill for kill in done if kill not in kills]
    return 1 if any(kill.differs for kill in kills) else 0


if __name__ == "__main__":
    sys.exit(main())
