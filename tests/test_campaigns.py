"""The campaigns of scripts/ that take hours: that they would still run, and notice."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).parents[1] / "scripts"
sys.path.append(str(SCRIPTS))

import mutate  # noqa: E402


@pytest.mark.parametrize("guard", mutate.GUARDS, ids=lambda guard: f"{guard.module} {guard.after}")
def test_every_guarantee_is_where_the_list_says(guard):
    """Once in its module, and tests of the names that are to notice are there."""
    assert (mutate.ROOT / mutate.PACKAGE / guard.module).read_text().count(guard.before) == 1
    file, _, chosen = guard.tests.partition(" -k ")
    names = [line for line in (mutate.ROOT / file).read_text().splitlines() if line.startswith("def test")]
    assert any(chosen in name for name in names), guard.tests


def test_operators_are_changed_one_at_a_time():
    for module, tests in mutate.DECISIVE.items():
        lines = (mutate.ROOT / mutate.PACKAGE / module).read_text().splitlines()
        changes = list(mutate.operators(module, tests))
        assert len(changes) > 10 and all(change.before == lines[change.line - 1] for change in changes)
        assert all(change.after != change.before for change in changes)
        for change in changes[:: len(changes) // 5]:
            compile("\n".join([*lines[: change.line - 1], change.after, *lines[change.line :]]), module, "exec")


def test_tests_of_several_changes_are_asked_at_once():
    several = ["tests/a.py -k one", "tests/b.py tests/a.py -k two or three", "tests/a.py -k one"]
    assert mutate.together(several) == "tests/a.py tests/b.py -k one or two or three"
    assert mutate.together([*several, "tests/c.py"]) == "tests/a.py tests/b.py tests/c.py"


KILLED = """
import sys
from pathlib import Path
import kill_stages

folder, stage = Path(sys.argv[1]), kill_stages.STAGES["objects"]
made = kill_stages.prepare("objects", stage, folder)
kills = list(kill_stages.campaign("objects", made, folder, 2))
assert [kill.differs for kill in kills] == ["", ""] and kills[0].number < kills[1].number
assert not list(kill_stages.campaign("objects", made, folder, 2, kills))
more = list(kill_stages.campaign("objects", made, folder, 3, kills))
assert len(more) == 1 and more[0].number > kills[1].number
assert kill_stages.killed(stage, made, folder, 1e-6) == (True, "")
assert kill_stages.killed(stage, made, folder, 1000.0) == (False, "")
first = next(path for path in sorted(made) if "chair-" in path.name)
(folder / first).write_text((folder / first).read_text() + " ")
assert kill_stages.killed(stage, made, folder, 1e-6)[1] == str(first)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes cannot be forked here")
def test_a_killed_stage_is_killed_and_compared(tmp_path):
    """The quickest one: killed at once it is at work, and what is left is compared by content.

    In a program of its own: what forks must not be a worker of the tests, whose threads and pipes it would share.
    """
    program = [sys.executable, "-c", KILLED, str(tmp_path)]
    done = subprocess.run(program, cwd=SCRIPTS, capture_output=True, text=True, timeout=240, stdin=subprocess.DEVNULL)
    assert done.returncode == 0, done.stderr
