"""Run one function over many items on several processes, telling how far it is. Results come back in order."""

import faulthandler
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import InvalidStateError, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.connection import wait
from pathlib import Path
from typing import TypeVar

from mimicbench.core.errors import MimicbenchError, WorkerDied
from mimicbench.core.progress import progress

Item = TypeVar("Item")
Result = TypeVar("Result")


def cpu_count() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)


def end_if_imported_by_worker() -> None:
    """End a worker process that has come to a script's work while it imports the script that started it."""
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        path = getattr(sys.modules.get("__mp_main__"), "__file__", None)
        print(f"mimicbench: {_unguarded(path)}", file=sys.stderr, flush=True)
        os._exit(1)


def refuse_without_guard() -> None:
    """Raise MimicbenchError if the program is a script whose work would be done again by each of its workers."""
    end_if_imported_by_worker()
    main = sys.modules["__main__"]
    path = getattr(main, "__file__", None)
    if path is None or getattr(main, "__spec__", None) is not None:
        return
    try:
        guarded = "__name__" in Path(path).read_text(errors="replace")
    except OSError:
        return
    if not guarded:
        raise MimicbenchError(_unguarded(path))


def _unguarded(path: str | None) -> str:
    """Workers are fresh processes, which import the script that started them."""
    return (
        f"{path or 'the script'} does its work when it is imported, and worker processes import it; put that under `if "
        '__name__ == "__main__":`, or give workers=1'
    )


def map_items(
    function: Callable[[Item], Result],
    items: Sequence[Item],
    workers: int,
    label: str,
    quiet: bool = False,
    isolated: bool = False,
) -> list[Result]:
    """[function(item) for item in items] on `workers` processes (0: all processors).

    `function` must be importable by name (or a functools.partial of such), for it is sent to fresh processes: forking a
    process that has already started threads is unsafe. A single worker is this very process, unless the work must be
    `isolated` from it. A program that is interrupted ends its workers at once, in the midst of their items. Raises
    WorkerDied when the system or native code ends a worker.
    """
    workers = min(workers or cpu_count(), max(1, len(items)))
    if workers == 1 and not isolated:
        return list(progress(map(function, items), len(items), label, quiet))
    refuse_without_guard()
    context, others = multiprocessing.get_context("spawn"), set(multiprocessing.active_children())
    chunk = max(1, min(8, len(items) // (4 * workers)))
    try:
        with _deaf_children():
            pool = ProcessPoolExecutor(workers, mp_context=context, initializer=start_worker)
            results = pool.map(function, items, chunksize=chunk)
        with _called_off_in_silence(), pool:
            try:
                return list(progress(results, len(items), label, quiet))
            except KeyboardInterrupt:
                for worker in set(multiprocessing.active_children()) - others:
                    worker.kill()
                raise
    except BrokenProcessPool:
        raise WorkerDied(
            f"{label}: a worker process was killed, most likely for want of memory; the same command "
            "goes on from here, and fewer --workers need less"
        ) from None


@contextmanager
def _called_off_in_silence() -> Iterator[None]:
    """Python's own thread beside the workers hears that they have ended, and stumbles over items that were called off
    a moment before: nobody is to read of that.
    """
    told = threading.excepthook

    def hook(args: threading.ExceptHookArgs) -> None:
        if not isinstance(args.exc_value, InvalidStateError):
            told(args)

    threading.excepthook = hook
    try:
        yield
    finally:
        threading.excepthook = told


@contextmanager
def _deaf_children() -> Iterator[None]:
    """Processes that are started in here, Python's own helper included, never hear what interrupts this one.

    A terminal, and whoever ends a job, tells all of them at once; what is to become of workers is for this process to
    decide, and what they would say of it is nothing but tracebacks.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def start_worker() -> None:
    """Each worker process uses one thread: the processes already fill the processors.

    A crash of native code tells where it was.

    A worker that is waiting for work hears nothing of its parent being killed, and would wait for ever.
    """
    faulthandler.enable()
    threading.Thread(target=_end_with_parent, daemon=True).start()
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ[name] = "1"


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)
