"""The command line: bad input gets one clear sentence, exit status 2, and nothing is written."""

import json
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from mimicbench.core.files import write_json
from mimicbench.workspace import Workspace, policy_folder, prepare_episodes


def command(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "mimicbench.cli", *arguments],
        capture_output=True,
        text=True,
        cwd=cwd,
        timeout=120,
        check=False,
    )


def refused(result: subprocess.CompletedProcess[str], cwd: Path, *words: str) -> None:
    assert result.returncode == 2, result.stderr
    message = result.stderr.strip().splitlines()[-1]
    assert message.startswith("mimicbench: ") and "Traceback" not in result.stderr
    for word in words:
        assert word in message
    assert not list(cwd.rglob("*.npz")) and not list(cwd.rglob("*.parquet"))


def test_unknown_task_lists_the_known_ones(tmp_path):
    refused(command("objects", "--task", "sit-lamp", cwd=tmp_path), tmp_path, "sit-lamp", "sit-chair")


def test_missing_stage_names_the_command_that_makes_it(tmp_path):
    refused(command("retarget", cwd=tmp_path), tmp_path, "mimicbench references")


def test_missing_recording(tmp_path):
    refused(command("import", "nowhere.npy", cwd=tmp_path), tmp_path, "nowhere.npy")


def test_hostile_pickle_is_refused_and_not_executed(tmp_path):
    class Hostile:
        def __reduce__(self):
            return (Path.touch, (tmp_path / "executed",))

    with open(tmp_path / "evil.npy", "wb") as stream:
        pickle.dump(np.array([Hostile()], dtype=object).item(), stream)
    refused(command("import", "evil.npy", cwd=tmp_path), tmp_path, "evil.npy")
    assert not (tmp_path / "executed").exists()


def test_cut_off_recording(tmp_path):
    (tmp_path / "cut.npy").write_bytes(b"\x93NUMPY\x01\x00v\x00{'descr'")
    refused(command("import", "cut.npy", cwd=tmp_path), tmp_path, "cut.npy")


def test_checkpoint_of_another_robot(tmp_path):
    folder = tmp_path / "policy"
    write_json(folder / "config.json", {"format": 1, "kind": "act", "robot": "g1", "config": {}, "notes": {}})
    (folder / "model.safetensors").write_bytes(b"")
    prepare_episodes(Workspace(tmp_path / "work", "sit-chair", 0, 1, True), 1)
    result = command("evaluate", "--policy", str(folder), "--episodes", "1", "--workers", "1", cwd=tmp_path)
    assert result.returncode == 2 and "another robot" in result.stderr


def test_unknown_policy_lists_the_known_ones(tmp_path):
    with pytest.raises(Exception, match="unknown policy 'nobody'"):
        policy_folder(Workspace(tmp_path, "sit-chair"), "nobody")


def test_stages_print_json_and_repeat_for_free(tmp_path):
    arguments = ("--count", "8", "--workdir", "w", "--seed", "5", "--json")
    first = command("objects", *arguments, cwd=tmp_path)
    found = json.loads(first.stdout)
    assert found["stage"] == "objects" and found["count"] == 8
    stamps = {path: path.stat().st_mtime_ns for path in (tmp_path / "w").rglob("*.json")}
    assert command("objects", *arguments, cwd=tmp_path).stdout == first.stdout
    assert stamps == {path: path.stat().st_mtime_ns for path in (tmp_path / "w").rglob("*.json")}
    refused(
        command("objects", "--count", "9", "--workdir", "w", "--seed", "5", cwd=tmp_path), tmp_path, "another config"
    )
