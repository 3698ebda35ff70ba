"""The benches measure what they say, and the soak finds what is not sound."""

import json
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

from mimicbench import cli
from mimicbench.bench import soak as soaking
from mimicbench.bench import world
from mimicbench.bench.imitation import bench_imitation
from mimicbench.bench.maps import MapBenchConfig, bench_maps
from mimicbench.bench.soak import SoakConfig, compile_family, soak, soak_task
from mimicbench.bench.world import WorldBenchConfig, bench_task
from mimicbench.core.errors import BadObject
from mimicbench.objects.families import chair
from mimicbench.objects.families.chair import make_chair
from mimicbench.objects.family import Family
from mimicbench.objects.registry import FAMILIES
from mimicbench.tasks.registry import TASKS
from stool import H1

QUICK = WorldBenchConfig(seconds=0.01, pool=4, workers=1)


def test_maps_beside_bare_physics():
    lines, say = heard()
    found = bench_maps(MapBenchConfig(("sit-chair", "lift-box"), (3,), seconds=0.01, pool=2, workers=1), say)
    assert [(row["task"], row["eyes"], row["robots"]) for row in found["rows"]] == [
        (task, eyes, 3) for task in ("sit-chair", "lift-box") for eyes in ("cameras", "rays")
    ]
    assert len(lines) == 4 and all(
        row[name] > 0 for row in found["rows"] for name in ("maps_per_second", "core_ms", "physics_steps")
    )


@pytest.mark.parametrize("robot", ["h1", "short"])
def test_learners_are_measured_on_any_robot(robot):
    """Also on one with fewer joints, for which nothing is shipped."""
    short = replace(H1, name="short", joints=H1.joints[:-1], rest_pose=H1.rest_pose[:-1])
    lines, say = heard()
    names = ("hit", "diffusion", "bc") if robot == "short" else ("hit", "planner")
    found = bench_imitation(H1 if robot == "h1" else short, TASKS.get("sit-chair"), names, 0.01, say)
    assert tuple(found) == names and len(lines) == len(names)
    for name, figures in found.items():
        assert ("waiting" in figures) == (name != "planner") and ("decision_ms" in figures) == (robot == "h1")
        assert all(value > 0 for key, value in figures.items() if key != "waiting")
        assert 0 <= figures.get("waiting", 0) <= 1


def heard():
    lines = []
    return lines, lines.append


@pytest.fixture(autouse=True)
def short_turns(monkeypatch):
    monkeypatch.setattr(world, "_TURN", 0.01)


@pytest.mark.parametrize("task", ["sit-chair", "touch-points"])
def test_environments_beside_bare_physics(task):
    lines, say = heard()
    row = bench_task(task, 4, QUICK, say)
    assert row.task == task and row.envs == 4 and len(lines) == 2
    assert min(row.env, row.bare, row.ratio) > 0
    assert row.env_map is not None and row.env_map > 0  # how much less depends on who else is at work


def test_memory_of_an_environment_is_small():
    # in a process of its own: one that has grown before fills what it has
    script = (
        "from mimicbench.bench.world import *; print(memory_per_env('sit-chair', 512, "
        "WITHOUT_MAP, WorldBenchConfig(pool=4, workers=1)))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert 1e3 < float(done.stdout) < 0.5e6


def test_bench_world_on_the_command_line(monkeypatch, capsys):
    words = "bench world --tasks lift-box --sizes 3 --seconds 0.01 --no-maps --no-memory --workers 1 --json"
    monkeypatch.setattr(sys, "argv", ["mimicbench", *words.split()])
    cli.main()
    found = json.loads(capsys.readouterr().out)
    assert [(row["task"], row["envs"], row["env_map"]) for row in found["rows"]] == [("lift-box", 3, None)]
    assert found["senses"]["map_cameras_ms"] > 0 and "processor" in found["machine"]


def test_families_are_as_many_as_the_tasks_need():
    assert set(soaking.PAPER_COUNTS) == set(FAMILIES) == {TASKS.get(task).family for task in TASKS}
    assert sum(soaking.PAPER_COUNTS.values()) == 10_580


def test_a_short_soak_is_sound():
    lines, say = heard()
    found = soak(SoakConfig(steps=2400, envs=8, episode=0.2, objects=3), say)
    json.dumps(found)
    assert found["sound"] and len(set(found["hashes"].values())) == 1 and set(found["hashes"]) == {"1", "2"}
    parts = found["parts"]["2"]
    assert {(part["task"], part["control"]) for part in parts} == {
        (task, control) for task in TASKS for control in ("position", "torque")
    }
    assert sum(part["steps"] for part in parts) >= 2400 and all(
        part["episodes"] > 8 and part["objects"] > 1 for part in parts
    )
    assert lines[-1].endswith(": sound")


def test_soaks_of_other_seeds_end_otherwise():
    _, say = heard()
    hashes = [
        soak_task("sit-chair", "position", 40, 1, SoakConfig(envs=4, objects=2, seed=seed), say).hash
        for seed in (0, 0, 1)
    ]
    assert hashes[0] == hashes[1] != hashes[2]


def test_a_family_that_does_not_compile_is_named(monkeypatch):
    def make(index, seed=0):
        if index == 2:
            raise BadObject("a chair without legs")
        return make_chair(index, seed)

    monkeypatch.setattr(chair, "FAMILY", Family("chair", make))
    lines, say = heard()
    found = compile_family(H1, "chair", 4, 0, say)
    assert found.failed == ("chair-0-00002",) and found.count == 4
    assert "a chair without legs" in lines[0] and lines[1].startswith("3 of 4")


def test_resident_memory_is_told():
    held = np.ones(4_000_000)
    assert world.resident_bytes() > held.nbytes
