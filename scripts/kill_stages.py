"""Kill every stage at random moments, run it again, and compare what it left with what one that was left alone made.

python scripts/kill_stages.py --count 100                    # each stage so often
python scripts/kill_stages.py --count 3 --stages track
"""

import argparse
import hashlib
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

RECIPE = """
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
STAGES = ("objects", "references", "retarget", "track", "imitate")
CLOCKS = ("metrics.jsonl", "training.safetensors", "header.json", "config.json")
"""Files of trainings that say how many seconds they took, which a kill makes more; networks are compared."""


def command(stage: str, workdir: Path) -> list[str]:
    """What makes a stage."""
    words = ["--config", str(workdir / "recipe.toml"), "--workdir", str(workdir), "--workers", "1", "--json"]
    return [sys.executable, "-m", "mimicbench.cli", stage, *words]


def contents(folder: Path, trained: bool) -> dict[str, str]:
    """Digests of the files of a stage."""
    return {
        str(path.relative_to(folder)): hashlib.blake2b(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and not (trained and (path.name in CLOCKS or path.parent.name == "tensorboard"))
    }


def killed(stage: str, whole: Path, seconds: float, after: float) -> str:
    """Kill a stage after so many seconds, run it again, and say what differs; empty if nothing does."""
    with tempfile.TemporaryDirectory() as name:
        workdir = Path(name)
        shutil.copy(whole / "recipe.toml", workdir)
        shutil.copytree(whole / "sit-chair", workdir / "sit-chair")
        for made in (stage, *(["perception"] if stage == "imitate" else [])):
            shutil.rmtree(workdir / "sit-chair" / made)
        process = subprocess.Popen(
            command(stage, workdir), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
        )
        time.sleep(after)
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        again = subprocess.run(command(stage, workdir), capture_output=True, text=True, timeout=20 * seconds + 600)
        if again.returncode:
            return again.stderr.strip().splitlines()[-1]
        trained = stage in ("track", "imitate")
        wanted, found = (contents(root / "sit-chair" / stage, trained) for root in (whole, workdir))
        return ", ".join(sorted(path for path in {*wanted, *found} if wanted.get(path) != found.get(path)))


def main() -> int:
    """0 if every killed stage ended in the same bytes."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--count", type=int, default=100, help="kills of each stage")
    parser.add_argument("--stages", nargs="+", choices=STAGES, default=STAGES)
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    moments, bad = random.Random(chosen.seed), 0
    with tempfile.TemporaryDirectory() as name:
        whole = Path(name)
        (whole / "recipe.toml").write_text(RECIPE)
        for stage in STAGES[: 1 + max(STAGES.index(one) for one in chosen.stages)]:
            begun = time.monotonic()
            subprocess.run(command(stage, whole), check=True, capture_output=True)
            seconds = time.monotonic() - begun
            if stage not in chosen.stages:
                continue
            wrong = [killed(stage, whole, seconds, moments.uniform(0, seconds)) for _ in range(chosen.count)]
            differ = [one for one in wrong if one]
            bad += len(differ)
            print(f"{stage}: {chosen.count} kills within {seconds:.1f} s, {len(differ)} ended otherwise", flush=True)
            for one in differ[:5]:
                print(f"    {one}")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
