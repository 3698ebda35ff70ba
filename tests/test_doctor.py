"""`mimicbench doctor`: what it finds is true, and it says what to do."""

import json
import os
import subprocess
import sys
import tomllib
from importlib import metadata
from pathlib import Path

import pytest

from mimicbench import doctor


def by_name(findings):
    return {one.name: one for one in findings}


def test_versions_are_those_that_are_installed():
    found = by_name(doctor.packages())
    assert found["numpy"].found == metadata.version("numpy")
    assert all(one.state == "ok" for one in found.values())


def test_what_is_missing_has_the_command_that_installs_it(monkeypatch):
    monkeypatch.setattr(doctor, "EXTRAS", {"gpu": (("no-such-package",), "physics"), "dev": (("pytest",), "tests")})
    missing, there = doctor.extras()
    assert (missing.state, missing.found) == ("note", "not installed")
    assert "pip install 'mimicbench[gpu]'" in missing.advice
    assert (there.state, there.advice) == ("ok", "")


def test_every_extra_is_one_of_the_package():
    project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"]
    assert set(doctor.EXTRAS) == set(project["optional-dependencies"]) - {"docs", "dev"}


def test_a_driver_that_fails_is_a_fault_with_advice(monkeypatch):
    monkeypatch.setenv("MUJOCO_GL", "disabled")
    (found,) = doctor.pictures()
    assert found.state == "fault"
    assert "libegl1" in found.advice


def test_the_disk_is_that_of_the_folder(tmp_path):
    (found,) = doctor.disk(tmp_path / "not" / "yet" / "there")
    free = float(found.found.split()[0])
    there = os.statvfs(tmp_path)
    assert free == pytest.approx(there.f_bavail * there.f_frsize / 2**30, rel=0.05, abs=0.2)
    assert found.state == ("ok" if free >= 5 else "note")


@pytest.mark.parametrize("place", ["file", "file/work"])
def test_a_file_is_no_place_for_artefacts(place, tmp_path):
    (tmp_path / "file").touch()
    (found,) = doctor.disk(tmp_path / place)
    assert (found.state, found.found) == ("fault", f"{tmp_path / 'file'} is no folder")
    assert found.advice == "give a folder with --workdir"


def test_memory_is_not_more_than_the_machine_has():
    (found,) = doctor.memory()
    assert 0 < float(found.found.split()[0]) <= os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 2**30


def test_the_command_tells_it_in_json(tmp_path):
    command = [sys.executable, "-m", "mimicbench.cli", "doctor", "--workdir", str(tmp_path), "--json"]
    environment = {**os.environ, "MUJOCO_GL": "disabled"}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    findings = json.loads(done.stdout)["findings"]
    states = {one["name"]: one["state"] for one in findings}
    assert states["pictures"] == "fault"
    assert done.returncode == 1, "something does not work"
    assert {"python", "mujoco", "torch", "[train]", "threads", "memory", "disk", "gpu"} <= set(states)
    assert all(one["advice"] for one in findings if one["state"] != "ok")
    assert not list(Path(tmp_path).iterdir()), "it leaves nothing behind"
