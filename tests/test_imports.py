"""Who may import whom, and what the command line must not import at all."""

import ast
import json
import subprocess
import sys
from pathlib import Path

import pytest

from mimicbench.cli import COMMANDS
from mimicbench.imitate.registry import LEARNERS
from mimicbench.track.registry import TRACKERS

SOURCE = Path(__file__).parents[1] / "src" / "mimicbench"
LEVELS = (
    {"core"},
    {"robots", "objects"},
    {"references", "sim"},
    {"tasks", "drawing"},
    {"sensors", "retarget"},
    {"envs"},
    {"track"},
    {"imitate"},
    {"policies"},
    {"evaluate"},
    {"benchmark"},
    {"comparisons"},
    {"report"},
    {"viewer"},
    {"bench", "doctor"},
    {"commands"},
    {"cli"},
    {"__main__"},
)
"""Each may import what stands before it, and itself; never its neighbors on the same level."""
LEVEL = {name: level for level, names in enumerate(LEVELS) for name in names}
MODULES = sorted(SOURCE.rglob("*.py"))
HEAVY = ("torch", "mujoco", "scipy", "matplotlib", "pyarrow", "rsl_rl")


def imports(path):
    """Every module that a file imports, anywhere in it."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute"
            yield from (
                (f"{node.module}.{alias.name}" for alias in node.names)
                if node.module == "mimicbench"
                else [node.module]
            )


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(SOURCE)))
def test_imports_point_down(path):
    place = path.relative_to(SOURCE).parts[0].removesuffix(".py")
    if place == "__init__":
        assert not any(name.startswith("mimicbench") for name in imports(path)), (
            "importing mimicbench imports nothing of it"
        )
        return
    for name in imports(path):
        top, _, rest = name.partition(".")
        other = rest.partition(".")[0]
        if top == "mimicbench" and other in LEVEL and other != place:
            assert LEVEL[other] < LEVEL[place], f"{place} must not import {name}"


def test_every_package_has_its_level():
    assert {path.relative_to(SOURCE).parts[0].removesuffix(".py") for path in MODULES} - {
        "__init__",
        "__main__",
    } <= set(LEVEL)


def test_only_one_file_knows_rsl_rl():
    assert [
        path.relative_to(SOURCE).as_posix()
        for path in MODULES
        if any(name.split(".")[0] == "rsl_rl" for name in imports(path))
    ] == ["track/learning/ppo.py"]


ASK = """
import io, json, sys
from contextlib import redirect_stderr, redirect_stdout
from mimicbench.cli import main
for arguments in json.loads(sys.argv[1]):
    said, status = io.StringIO(), 0
    try:
        with redirect_stdout(said), redirect_stderr(said):
            main(arguments)
    except SystemExit as end:
        status = end.code or 0
    assert status == int(sys.argv[2]) and said.getvalue(), f"{arguments} ends with {status}: {said.getvalue()}"
    found = {*sys.argv[3:]} & {*sys.modules}
    assert not found, f"{arguments} imports {sorted(found)}"
"""
"""Calls commands one after the other, none of which may import anything of a list."""
SETTINGS = (
    *(["imitate", "--learner", name] for name in LEARNERS),
    *(["track", "--tracker", name] for name in TRACKERS),
    ["run", "--preset", "paper"],
    ["run", "--preset", "omnih2o"],
    ["run", "--train", "--profile", "smoke"],
    ["compare", "clone-switches"],
)
"""What settings there are follows from these."""


def ask(lines, status, without):
    """Call commands in a process of their own, which all end with a status and import none of these."""
    done = subprocess.run(
        [sys.executable, "-c", ASK, json.dumps(lines), str(status), *without], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize(
    ("arguments", "heavy"),
    [
        (["--help"], ["tyro", "numpy", "torch", "mujoco", "scipy", "matplotlib", "pyarrow", "rsl_rl"]),
        (["--version"], ["tyro", "numpy", "torch"]),
        (["table", "--help"], ["numpy", "matplotlib", "pyarrow"]),
        (["view", "--help"], ["numpy", "viser", "trimesh", "pyarrow"]),
        (["doctor", "--help"], ["numpy", "matplotlib"]),
    ],
)
def test_help_is_free(arguments, heavy):
    ask([arguments], 0, heavy)


@pytest.mark.parametrize("lines", [[name.split() for name in COMMANDS], SETTINGS], ids=["commands", "settings"])
def test_help_needs_nothing_that_learns_or_simulates(lines):
    """Completion asks for it, too. What takes a second to import would make it slow: settings stand in modules of their
    own.
    """
    ask([[*line, "--help"] for line in lines], 0, HEAVY)


def test_complaints_need_nothing_that_learns_or_simulates():
    misspelt = ["--sampels", "3"]
    ask([[*line, *misspelt] for line in (["track"], ["imitate", "--learner", "act"], ["run", "--train"])], 2, HEAVY)
