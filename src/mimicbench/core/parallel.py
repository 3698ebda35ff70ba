"""Run one function over many items on several processes, with a progress bar. Results come back in order."""

import faulthandler
import multiprocessing
import os
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing.connection import wait
from typing import TypeVar

from mimicbench.core.errors import WorkerDied

Item = TypeVar("Item")
Result = TypeVar("Result")


def cpu_count() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1)


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
    `isolated` from it. Raises WorkerDied when the system or native code ends a worker.
    """
    workers = min(workers or cpu_count(), max(1, len(items)))
    if workers == 1 and not isolated:
        return list(progress(map(function, items), len(items), label, quiet))
    context = multiprocessing.get_context("spawn")
    try:
        with ProcessPoolExecutor(workers, mp_context=context, initializer=_start_worker) as pool:
            return list(
                progress(
                    pool.map(function, items, chunksize=max(1, min(8, len(items) // (4 * workers)))),
                    len(items),
                    label,
                    quiet,
                )
            )
    except BrokenProcessPool:
        raise WorkerDied(
            f"{label}: a worker process was killed, most likely for want of memory; the same command "
            "goes on from here, and fewer --workers need less"
        ) from None


def progress(items: Iterable[Item], total: int, label: str, quiet: bool = False) -> Iterator[Item]:
    """Pass items through with a progress bar and the time left, on stderr."""
    with counter(total, label, quiet) as tick:
        for item in items:
            yield item
            tick(1)


@contextmanager
def counter(total: int, label: str, quiet: bool = False) -> Iterator[Callable[[int], None]]:
    """A progress bar with the time left, on stderr; call what it gives with how many more are done."""
    if quiet:
        yield lambda count: None
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = [
        TextColumn("{task.description:<24}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    ]
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task(label, total=total)
        yield lambda count: bar.advance(task, count)


def _start_worker() -> None:
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
