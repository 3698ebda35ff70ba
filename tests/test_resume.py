"""Killed at any moment (SIGKILL), every stage goes on where it stopped, and ends with the files of a run that was
never killed.
"""

import hashlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

BEFORE = {"objects": (), "references": ("objects",), "retarget": ("objects", "references")}
SIZES = {
    "objects": ("--objects.count", "120"),
    "references": ("--references.count", "12"),
    "retarget": ("--retarget.method", "copy-rotation"),
}
ITEM = {"objects": "chair-*.json", "references": "*.npz", "retarget": "*.npz"}


def arguments(stage: str, workdir: Path) -> list[str]:
    return [
        sys.executable,
        "-m",
        "mimicbench.cli",
        stage,
        *(word for part in (*BEFORE[stage], stage) for word in SIZES[part]),
        "--workdir",
        str(workdir),
        "--workers",
        "2",
        "--json",
    ]


def files(folder: Path) -> dict[str, str]:
    """Contents of everything in a folder, by name."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """A workdir in which no stage was killed."""
    workdir = tmp_path_factory.mktemp("whole")
    for stage in BEFORE:
        subprocess.run(arguments(stage, workdir), check=True, capture_output=True)
    return workdir / "sit-chair"


def only(folder: Path) -> Path:
    """The one folder in it."""
    (found,) = folder.glob("*")
    return found


@pytest.mark.parametrize(("stage", "items"), [("objects", 9), ("references", 1), ("retarget", 5)])
def test_a_killed_stage_goes_on(stage, items, whole, tmp_path):
    for earlier in BEFORE[stage]:
        target = tmp_path / "sit-chair" / earlier
        target.parent.mkdir(exist_ok=True)
        target.symlink_to(whole / earlier)
    folder = tmp_path / "sit-chair" / stage / only(whole / stage).name
    process = subprocess.Popen(
        arguments(stage, tmp_path), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True
    )
    deadline = time.monotonic() + 60
    while len(list(folder.glob(ITEM[stage]))) < items and process.poll() is None and time.monotonic() < deadline:
        time.sleep(0.002)
    os.killpg(process.pid, signal.SIGKILL)  # the workers too
    process.wait()
    (folder / ".half.json.1.tmp").write_bytes(b"{")  # as if it had been killed in the middle of a write
    early = {path.name: path.stat().st_mtime_ns for path in folder.glob(ITEM[stage])}
    assert len(early) >= items
    subprocess.run(arguments(stage, tmp_path), check=True, capture_output=True)
    assert files(folder) == files(only(whole / stage)), "the same files, and nothing half written beside them"
    if stage != "objects":  # whose items are made in no time, all together
        kept = [name for name, stamp in early.items() if (folder / name).stat().st_mtime_ns == stamp]
        assert len(kept) == len(early), "what was there is not made again"
