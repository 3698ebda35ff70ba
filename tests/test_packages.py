"""Packages of other people: a task, a robot, a tracker, a learner with its policy, a format of recordings and a table,
each of a single file, are installed and run through the whole command without a change to ours.
"""

import csv
import json
import os
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from mimicbench.core.motion import HumanMotion
from mimicbench.evaluate.rows import read_rows
from mimicbench.objects.registry import make_object
from mimicbench.references.synthesis.registry import synthesize

PACKAGES = Path(__file__).with_name("packages")
ROWS = Path(__file__).parents[1] / "runs" / "sit-chair" / "evaluate"
OURS = "sys, mimicbench.{}.registry as r; print(*r.{}.names()); assert not {{'numpy', {!r}}} & set(sys.modules)"


SMALL = ("--objects.count", "4", "--references.count", "4", "--workers", "1", "--json")
TRACKED = ("--track.samples", "256", "--track.num-envs", "16", "--track.ppo.steps", "8", "--track.evaluate-clips", "1")
ALONE = {
    "standing": ("retarget", "--task", "stand-by", *SMALL),
    "scout": ("retarget", "--task", "touch-points", "--robot", "scout", *SMALL),
    "follow": ("track", "--task", "touch-points", "--track.tracker", "follow", *SMALL, *TRACKED),
    "still": (
        "imitate",
        "--task",
        "touch-points",
        "--imitate.learner",
        "still",
        "--imitate.last",
        "5",
        *SMALL,
        *TRACKED,
    ),
}
"""Commands that need one package and are ours otherwise."""


def environment(site, folders):
    """Environment variables of a process in which packages are installed as pip would do it."""
    for folder in folders:
        project = tomllib.loads((folder / "pyproject.toml").read_text())["project"]
        name, version = project["name"], project["version"]
        (site / f"{name}.py").write_bytes((folder / f"{name}.py").read_bytes())
        info = site / f"{name}-{version}.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n")
        groups = project["entry-points"].items()
        lines = [f"[{group}]\n" + "".join(f"{n} = {where}\n" for n, where in of.items()) for group, of in groups]
        (info / "entry_points.txt").write_text("".join(lines))
    paths = os.pathsep.join([str(site), *filter(None, [os.environ.get("PYTHONPATH")])])
    return {**os.environ, "PYTHONPATH": paths, "MUJOCO_GL": "disabled"}  # drawing would take most of the time


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    return environment(tmp_path_factory.mktemp("site"), PACKAGES.iterdir())


def call(environment, *arguments):
    done = subprocess.run([sys.executable, *arguments], env=environment, capture_output=True, text=True, timeout=900)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize(
    ("package", "registry", "module", "name"),
    [
        ("tasks", "TASKS", "standing", "stand-by"),
        ("objects", "FAMILIES", "standing", "pillar"),
        ("robots", "ROBOTS", "scout", "scout"),
        ("track", "TRACKERS", "follow", "follow"),
        ("imitate", "LEARNERS", "still", "still"),
        ("policies", "LOADERS", "still", "still"),
        ("references.importers", "FORMATS", "lines", "lines"),
        ("report.tables", "TABLES", "prompt", "time-to-success"),
        ("comparisons", "COMPARISONS", "prompt", "focus"),
    ],
)
def test_names_are_known_without_an_import(installed, package, registry, module, name):
    assert name in call(installed, "-c", "import " + OURS.format(package, registry, module)).split()


def test_their_tasks_are_environments(installed):
    script = (
        "import gymnasium, mimicbench; env = gymnasium.make('mimicbench/StandBy-v0', split='all'); env.reset(seed=0)"
    )
    assert call(installed, "-c", script + "; print(env.unwrapped.spec.kwargs['task'])").strip() == "stand-by"


@pytest.mark.parametrize("name", ALONE)
def test_each_of_them_needs_no_other(name, tmp_path):
    alone = environment(tmp_path, [PACKAGES / name])
    told = json.loads(call(alone, "-m", "mimicbench.cli", *ALONE[name], "--workdir", str(tmp_path / "work")))
    header = json.loads((Path(told["folder"]) / "header.json").read_text())
    assert header["stage"] == ALONE[name][0] and {"standing": "stand-by"}.get(name, name) in json.dumps(header)


def test_recordings_in_their_format_become_clips(tmp_path):
    alone, obj = environment(tmp_path, [PACKAGES / "lines"]), make_object("chair-0-00003")
    person = synthesize("sit-chair", 0, obj, 0)
    times = np.arange(person.frames) / person.fps
    table = np.column_stack([times, person.root_pos_w, person.local_quat.reshape(person.frames, -1)])
    np.savetxt(tmp_path / "take.lines", table, "%.6f")
    (tmp_path / "torn.lines").write_text("1 2 3\n4 5\n")
    words = ("import", str(tmp_path / "take.lines"), str(tmp_path / "torn.lines"), "--workdir", str(tmp_path / "work"))
    script = "import sys; from mimicbench.cli import main; sys.exit(main())"
    done = subprocess.run(
        [sys.executable, "-c", script, *words], env=alone, capture_output=True, text=True, timeout=600
    )
    told = done.stdout + done.stderr
    assert "as its times say" in told and "lines of different lengths; write it again" in told, told
    (clip,) = (tmp_path / "work").rglob("real-take-0.npz")
    found = HumanMotion.load(clip)
    assert found.fps == pytest.approx(person.fps) and found.frames > 0.5 * person.frames


def test_their_tables_are_printed_beside_ours(tmp_path):
    alone = environment(tmp_path, [PACKAGES / "prompt"])
    assert "how long each method takes" in call(alone, "-m", "mimicbench.cli", "table", "list")
    files = sorted(map(str, ROWS.glob("*.parquet")))
    words = ("table", *files, "--show", "time-to-success", "results", "--format", "csv")
    theirs, ours, _ = call(alone, "-m", "mimicbench.cli", *words).split("\n\n")
    assert ours.startswith("Stage,Policy,K rate")
    for line in csv.DictReader(theirs.splitlines()):
        rows = read_rows(ROWS / f"{line['Policy'].split()[0]}.parquet")
        times = sorted(row.first_success_time for row in rows if row.success)
        assert int(line["K successes"]) == len(times)
        assert float(line["half by [s]"]) == pytest.approx((times[(len(times) - 1) // 2] + times[len(times) // 2]) / 2)


def test_all_of_them_run_through_everything(installed, tmp_path):
    small = {
        "objects.count": 8,
        "references.count": 6,
        "track.samples": 512,
        "track.num-envs": 32,
        "track.ppo.steps": 8,
        "track.evaluate-clips": 2,
        "imitate.last": 5,
        "imitate.perception.maps": 64,
        "imitate.perception.steps": 4,
        "evaluate.episodes": 2,
        "evaluate.tracked": 2,
    }
    words = ["run", "--train", "--profile", "smoke", "--task", "stand-by", "--robot", "scout", "--json"]
    words += ["--track.tracker", "follow", "--imitate.learner", "still", "--evaluate.policy", "tracker", "still"]
    words += [word for name, value in small.items() for word in (f"--{name}", str(value))]
    words += ["--workers", "1", "--workdir", str(tmp_path)]
    told = json.loads(call(installed, "-m", "mimicbench.cli", *words))
    page = Path(told["report"])
    assert told["task"] == "stand-by" and "Stand by a pillar" in page.read_text()
    assert "Time to success" in page.read_text() and (page.parent / "tables" / "time-to-success.csv").is_file()
    assert {one["policy"] for one in told["results"]} == {"follow", "still"}
    headers = [json.loads(path.read_text()) for path in (tmp_path / "stand-by").glob("*/*/header.json")]
    assert {"objects", "references", "retarget", "track", "perception", "imitate"} <= {one["stage"] for one in headers}
    policy = next((tmp_path / "stand-by" / "imitate").glob("still-*/policy/config.json"))
    assert json.loads(policy.read_text())["robot"] == "scout"
