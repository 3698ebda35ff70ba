"""Work in other processes: results in order, errors as they were raised, and a death among the workers told in one
sentence.
"""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from mimicbench.core.errors import UnknownName, WorkerDied
from mimicbench.core.parallel import map_items
from mimicbench.drawing.opengl import NoPictures, draw_apart


def crash(_item: int) -> None:
    os.kill(os.getpid(), signal.SIGSEGV)


def crash_once(folder, item: int) -> int:
    mark = folder / f"{item}"
    if not mark.exists():
        mark.touch()
        crash(item)
    return item


def refuse(item: int) -> None:
    raise UnknownName("number", str(item), ["two", "one"])


@pytest.mark.parametrize("workers", [1, 2])
def test_results_come_in_order(workers):
    assert map_items(abs, [-3, -1, -2], workers, "numbers", quiet=True) == [3, 1, 2]


@pytest.mark.parametrize("workers", [1, 2])
def test_errors_come_as_they_were_raised(workers):
    with pytest.raises(UnknownName, match="unknown number '7'; known are: one, two"):
        map_items(refuse, [7, 7], workers, "numbers", quiet=True)


def test_isolated_work_is_elsewhere():
    assert map_items(_process, [0], 1, "processes", quiet=True) == [os.getpid()]
    assert map_items(_process, [0], 1, "processes", quiet=True, isolated=True) != [os.getpid()]


def _process(_item: int) -> int:
    return os.getpid()


def test_a_crash_of_native_code_is_one_sentence():
    with pytest.raises(WorkerDied, match="crashes: a worker process was killed"):
        map_items(crash, [1, 2], 2, "crashes", quiet=True)


def test_what_draws_may_crash_once(tmp_path):
    assert draw_apart(partial(crash_once, tmp_path), [4], 1, "drawing", quiet=True) == [4]
    with pytest.raises(NoPictures, match="crashed twice"):
        draw_apart(crash, [4], 1, "drawing", quiet=True)


def test_workers_end_with_their_parent(tmp_path):
    script = "import sys; from test_parallel import wait_long; from mimicbench.core.parallel import map_items\n"
    script += "if __name__ == '__main__': map_items(wait_long, [sys.argv[1]] * 2, 2, 'waiting', quiet=True)"
    (tmp_path / "parent.py").write_text(script)
    parent = subprocess.Popen(
        [sys.executable, tmp_path / "parent.py", tmp_path], env={**os.environ, "PYTHONPATH": str(Path(__file__).parent)}
    )
    try:
        _until(lambda: len(list(tmp_path.glob("*.pid"))) == 2, "two workers are at work")
        parent.kill()
        parent.wait()
        workers = [int(path.stem) for path in tmp_path.glob("*.pid")]
        _until(lambda: not any(_runs(pid) for pid in workers), "the workers have ended")
    finally:
        parent.kill()


INTERRUPTED = """
import signal, sys
from mimicbench.core.parallel import map_items
from test_parallel import wait_long

def interrupt(*_):
    raise KeyboardInterrupt

if __name__ == "__main__":
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, interrupt)
    try:
        map_items(wait_long, [sys.argv[1]] * 40, 2, "waiting", quiet=True)
    except KeyboardInterrupt:
        print("stopped")
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize("tell", [os.kill, os.killpg])
def test_an_interrupted_program_ends_its_workers_at_once_and_without_a_word(tmp_path, number, tell):
    """Whether it alone is told, or all of its processes, as by a terminal: in the midst of items that take minutes."""
    (tmp_path / "parent.py").write_text(INTERRUPTED)
    parent = subprocess.Popen(
        [sys.executable, tmp_path / "parent.py", tmp_path],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(Path(__file__).parent), *sys.path])},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        _until(lambda: len(list(tmp_path.glob("*.pid"))) == 2, "two workers are at work")
        tell(parent.pid, number)
        assert parent.communicate(timeout=60) == ("stopped\n", "") and parent.returncode == 0
        workers = [int(path.stem) for path in tmp_path.glob("*.pid")]
        _until(lambda: not any(_runs(pid) for pid in workers), "the workers have ended")
    finally:
        parent.kill()


def wait_long(folder: str) -> None:
    (Path(folder) / f"{os.getpid()}.pid").touch()
    time.sleep(600)


def _runs(pid: int) -> bool:
    try:
        os.kill(pid, 0)
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (ProcessLookupError, FileNotFoundError):
        return False


def _until(holds: Callable[[], bool], what: str, seconds: float = 60.0) -> None:
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end, what
        time.sleep(0.1)
