"""Learning curves as the trainings write them: one JSON line per evaluation."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from pathlib import Path

from mimicbench.core.errors import BadFile

MAX_BYTES = 256 << 20


@dataclass(frozen=True)
class Curve:
    """What one training recorded."""

    name: str
    """Of the training, such as `tracker (improved)`."""
    series: Mapping[str, tuple[tuple[float, float], ...]]
    """Quantity -> its (x, value) pairs in order."""
    x: str
    """What x counts: `samples`, `step` or `seconds`."""


def read_curve(path: Path, name: str) -> Curve:
    """Read a `metrics.jsonl`. A last line that was cut off by a kill is left out; any other bad line raises BadFile.

    Every number of a line becomes a series, `{"step": 3, "samples": 9000, "reward": 0.4, "k": 0.1}` for instance.
    """
    if not path.is_file():
        raise BadFile(f"{path} does not exist; train first")
    if path.stat().st_size > MAX_BYTES:
        raise BadFile(f"{path} is larger than {MAX_BYTES >> 20} MiB; it is not a file of metrics")
    lines = path.read_bytes().split(b"\n")
    records = []
    for number, line in enumerate(lines, 1):
        if not line.strip():
            continue
        try:
            record = json.loads(line)
            if not isinstance(record, dict):
                raise ValueError("not an object")
        except ValueError as error:
            if number == len(lines):  # no newline after it
                continue
            raise BadFile(f"{path}, line {number}: {error}; it is not a file of metrics") from None
        records.append(record)
    x = next(
        (key for key in ("samples", "step", "seconds") if any(_number(record.get(key)) for record in records)), "step"
    )
    series: dict[str, list[tuple[float, float]]] = {}
    for i, record in enumerate(records):
        at = record.get(x) if _number(record.get(x)) else i
        for key, value in record.items():
            if key not in ("samples", "step", "seconds", "iterations", "round") and _number(value):
                points = series.setdefault(key, [])
                while points and points[-1][0] >= at:  # written by a run that was killed, and gone through again
                    points.pop()
                points.append((float(at), float(value)))
    return Curve(name, {key: tuple(points) for key, points in series.items()}, x)


def _number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)
