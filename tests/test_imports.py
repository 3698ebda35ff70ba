"""Who may import whom, and what the command line must not import at all."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

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
    ] == ["track/ppo.py"]


@pytest.mark.parametrize(
    ("arguments", "heavy"),
    [
        (["--help"], ["tyro", "numpy", "torch", "mujoco", "scipy", "matplotlib", "pyarrow", "rsl_rl"]),
        (["--version"], ["tyro", "numpy", "torch"]),
        (["table", "--help"], ["torch", "mujoco", "matplotlib", "pyarrow", "rsl_rl"]),
        (["retarget", "--help"], ["torch", "mujoco", "matplotlib", "pyarrow", "rsl_rl"]),
        (["view", "--help"], ["torch", "mujoco", "viser", "trimesh", "pyarrow"]),
        (["doctor", "--help"], ["torch", "mujoco", "matplotlib"]),
    ],
)
def test_help_is_free(arguments, heavy):
    """Help of what learns needs the settings of trackers and learners, and with them torch."""
    script = f"""
import sys
from mimicbench.cli import main
sys.argv = ["mimicbench", *{arguments!r}]
try:
    main()
except SystemExit as end:
    assert not end.code, end.code
found = set({heavy!r}) & set(sys.modules)
assert not found, f"help imports {{sorted(found)}}"
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "mimicbench" in done.stdout
