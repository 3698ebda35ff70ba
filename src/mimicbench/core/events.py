"""Metrics as TensorBoard reads them: every number of a line of metrics is a scalar of that name.

The file grows by whole records, as `metrics.jsonl` grows by lines, and is written anew from those lines where a
training goes on; so it is right after any kill, and one file however often a training was stopped.
"""

import time
from collections.abc import Iterator, Mapping, Sequence
from importlib.util import find_spec
from math import isfinite
from pathlib import Path
from typing import Any

from mimicbench.core.files import write_atomic

EVENTS = Path("tensorboard") / "events.out.tfevents.0.mimicbench"
STEPS = ("samples", "step")
"""What may count how far a training has come."""


def append_events(folder: Path, row: Mapping[str, Any]) -> None:
    """Append the numbers of a line of metrics to a training's events, if TensorBoard is installed."""
    if not _installed():
        return
    path = folder / EVENTS
    path.parent.mkdir(parents=True, exist_ok=True)
    begun = path.exists()
    with open(path, "ab") as stream:
        _write(stream, [row], begun)


def write_events(folder: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write a training's events anew, if TensorBoard is installed."""
    if not _installed():
        return
    write_atomic(folder / EVENTS, lambda stream: _write(stream, rows, False))


def _installed() -> bool:
    return find_spec("tensorboard") is not None


def _write(stream: Any, rows: Sequence[Mapping[str, Any]], begun: bool) -> None:
    from tensorboard.compat.proto.event_pb2 import Event  # pyright: ignore[reportAttributeAccessIssue]
    from tensorboard.compat.proto.summary_pb2 import Summary  # pyright: ignore[reportAttributeAccessIssue]
    from tensorboard.summary.writer.record_writer import RecordWriter

    writer, now = RecordWriter(stream), time.time()
    if not begun:
        writer.write(Event(wall_time=now, file_version="brain.Event:2").SerializeToString())
    last = rows[-1].get("seconds", 0.0) if rows else 0.0
    for row in rows:
        step = next((int(row[name]) for name in STEPS if name in row), 0)
        values = [Summary.Value(tag=name, simple_value=value) for name, value in _scalars(row)]
        at = now - (last - row.get("seconds", last))
        writer.write(Event(wall_time=at, step=step, summary=Summary(value=values)).SerializeToString())


def _scalars(row: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, float]]:
    for name, value in row.items():
        if isinstance(value, Mapping):
            yield from _scalars(value, f"{before}{name}/")
        elif isinstance(value, int | float) and isfinite(value) and name not in STEPS:
            yield f"{before}{name}", float(value)
