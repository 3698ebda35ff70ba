"""The wheel: it has what the package needs and nothing else, is small, and works where it is installed alone."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

pytest.importorskip("hatchling", reason="hatchling is not installed: pip install hatchling")
ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "mimicbench"
MOST_BYTES = 40 << 20
USE = """
import sys

class WithoutExtras:  # as where only what everybody needs is installed
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("rsl_rl", "tensordict", "tensorboard", "viser", "onnx", "mink", "ray", "warp"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, WithoutExtras())
import gymnasium, mimicbench
from pathlib import Path
from mimicbench.policies.loading import load_policy
from mimicbench.robots.registry import ROBOTS
from mimicbench.tasks.registry import TASKS
print(Path(mimicbench.__file__).parent)
env = gymnasium.make("mimicbench/SitChair-v0", split="test")
seen, info = env.reset(seed=0)
env.step(env.action_space.sample())
print(seen["proprio"].shape)
shipped = Path(mimicbench.__file__).parent / "checkpoints" / "sit-chair" / "planner"
print(len(load_policy(shipped, ROBOTS.get("h1"), TASKS.get("sit-chair")).observations) > 0)
from mimicbench.benchmark import Recipe, run_stage
from mimicbench.benchmark.judging import judge  # who only judges trains nothing
try:
    run_stage("track", Recipe("sit-chair"), Path("never-made"))
except mimicbench.core.errors.MimicbenchError as error:
    print(error)
"""


def python(*arguments, **options):
    """Run Python, and say what it said if it failed."""
    done = subprocess.run([sys.executable, *map(str, arguments)], capture_output=True, text=True, **options)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    out = tmp_path_factory.mktemp("wheel")
    options = ("--no-deps", "--no-build-isolation", "--no-index", "--quiet", "--wheel-dir", out)
    python("-m", "pip", "wheel", *options, ROOT)
    (path,) = out.glob("*.whl")
    return path


def test_it_has_the_whole_package_and_nothing_else(wheel):
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if ".dist-info/" not in name}
    there = {
        f"mimicbench/{path.relative_to(PACKAGE).as_posix()}"
        for path in PACKAGE.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }
    assert names == there
    for needed in ("py.typed", "report/page.html.jinja", "checkpoints/tracker/model.safetensors"):
        assert f"mimicbench/{needed}" in names


def test_it_is_small(wheel):
    assert wheel.stat().st_size < MOST_BYTES, f"{wheel.stat().st_size / 2**20:.1f} MiB"


def test_it_works_where_it_is_installed_alone(wheel, tmp_path):
    target = tmp_path / "installed"
    options = ("--no-deps", "--no-index", "--no-compile", "--quiet", "--target", target)
    python("-m", "pip", "install", *options, wheel)
    # nothing of the repository: another folder to stand in, and the installed package first on the path
    outside = {"cwd": tmp_path, "env": {**os.environ, "PYTHONPATH": str(target), "PYTHONDONTWRITEBYTECODE": "1"}}
    assert "evaluate" in python("-m", "mimicbench", "--help", **outside)
    where, shape, observes, trains = python("-c", USE, **outside).split("\n")[:4]
    assert Path(where) == target / "mimicbench"
    assert (shape, observes) == ("(48,)", "True")
    assert "pip install 'mimicbench[train]'" in trains and not (tmp_path / "never-made").exists()
