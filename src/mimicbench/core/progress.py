"""Telling how far work has come: a bar on a terminal, a line every ten seconds elsewhere, such as in a log."""

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Protocol, TypeVar

from mimicbench.core.run import to_stderr

Item = TypeVar("Item")
EVERY = 10.0
"""[s] No training and no stage is silent for longer, unless one single item of it takes longer."""


class Tick(Protocol):
    """Hears that more is done."""

    def __call__(self, count: int, remark: str = "") -> None:
        """So many more, and something to tell of them."""
        ...


class Pulse:
    """Says something every ten seconds, however often it is asked to."""

    def __init__(self, say: Callable[[str], None], every: float = EVERY) -> None:
        self._say, self._every, self._last = say, every, time.monotonic()

    def __call__(self, line: Callable[[], str]) -> None:
        """Say the line if the last one was long enough ago; it is not worked out otherwise."""
        now = time.monotonic()
        if now - self._last >= self._every:
            self._last = now
            self._say(line())


def progress(items: Iterable[Item], total: int, label: str, quiet: bool = False) -> Iterator[Item]:
    """Pass items through, telling how many there have been and how much time is left, on stderr."""
    with counter(total, label, quiet) as tick:
        for item in items:
            yield item
            tick(1)


@contextmanager
def counter(total: int, label: str, quiet: bool = False) -> Iterator[Tick]:
    """Tells how much of `total` is done and how much time is left, on stderr; call what it gives for what is done."""
    if quiet:
        yield lambda count, remark="": None
        return
    from rich.console import Console

    console = Console(stderr=True)
    if not console.is_terminal:
        lines = _Lines(total, label)
        yield lines
        lines.end()
        return
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
    from rich.progress import TimeRemainingColumn as Left

    columns = [TextColumn("{task.description:<24}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn()]
    with Progress(*columns, TextColumn("left"), Left(), console=console) as bar:
        task = bar.add_task(label, total=total)

        def tick(count: int, remark: str = "") -> None:
            bar.update(task, advance=count, description=f"{label}, {remark}" if remark else label)

        yield tick


class _Lines:
    """Where there is no terminal to draw a bar on."""

    def __init__(self, total: int, label: str) -> None:
        self._total, self._label, self._done, self._remark = total, label, 0, ""
        self._pulse, self._begun = Pulse(to_stderr), time.monotonic()
        # the first item pays for what is made once, and what an earlier run did comes in no time
        self._first: tuple[float, int] | None = None

    def __call__(self, count: int, remark: str = "") -> None:
        self._done, self._remark = self._done + count, remark or self._remark
        self._first = self._first or (time.monotonic(), self._done)
        if self._done < self._total:  # `end` tells of the last one
            self._pulse(self._line)

    def end(self) -> None:
        """All is done."""
        to_stderr(f"{self._label}: {self._done}/{self._total} in {_words(time.monotonic() - self._begun)}{self._said}")

    @property
    def _said(self) -> str:
        return f", {self._remark}" if self._remark else ""

    def _line(self) -> str:
        assert self._first is not None, "something was told"
        since, before = self._first
        done = self._done - before
        left = (time.monotonic() - since) * (self._total - self._done) / done if done else None
        told = "" if left is None else f", {_words(left)} left"
        return f"{self._label}: {self._done}/{self._total}{told}{self._said}"


def _words(seconds: float) -> str:
    hours, rest = divmod(round(seconds), 3600)
    return f"{hours}:{rest // 60:02d}:{rest % 60:02d}" if hours else f"{rest // 60}:{rest % 60:02d}"
