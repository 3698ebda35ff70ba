"""The parquet tables of a LeRobotDataset v3: columns, statistics, the list of tasks; read with care, written whole."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import imageio.v3 as iio
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from mimicbench.core.errors import BadFile
from mimicbench.core.files import write_atomic
from mimicbench.core.foreign.columns import check_claims, read_checked

_ARROW = {"float32": pa.float32(), "float64": pa.float64(), "int64": pa.int64(), "bool": pa.bool_()}
PICTURES = pa.struct({"bytes": pa.binary(), "path": pa.string()})
"""As the library `datasets` has columns of pictures."""
QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
"""By which LeRobot's policies normalize."""
Stats = Mapping[str, Mapping[str, np.ndarray]]
"""column -> min, max, mean, std, count, and QUANTILES."""


def schema_names(path: Path) -> list[str]:
    """The columns of a parquet file. Raises BadFile."""
    try:
        return pq.read_schema(path).names
    except (pa.ArrowException, OSError) as error:
        raise _bad_table(path, error) from None


def read_table(path: Path, columns: list[str] | None = None) -> pa.Table:
    """Columns of a parquet file, all if None. Raises BadFile."""
    if not path.is_file():
        raise BadFile(f"{path} does not exist; run `mimicbench demos` again")
    try:
        metadata = pq.read_metadata(path)
        check_claims(path, metadata)
        table = read_checked(path, metadata.schema.to_arrow_schema(), columns)
    except (pa.ArrowException, OSError, KeyError, UnicodeDecodeError) as error:
        raise _bad_table(path, error) from None
    missing = sorted(set(columns or []) - set(table.column_names))
    if missing:
        raise BadFile(f"{path} has no column {missing[0]!r}; make the demonstrations again with `mimicbench demos`")
    return table


def _bad_table(path: Path, error: Exception) -> BadFile:
    first_line = str(error).splitlines()[0] if str(error) else type(error).__name__
    return BadFile(
        f"{path} cannot be read ({first_line}); it is cut off or no parquet file: delete it and what "
        "follows it, and run `mimicbench demos` again"
    )


def write_table(path: Path, table: pa.Table) -> None:
    """Write a parquet file atomically, with checksums.

    Of lists of floating-point numbers the first bytes of all numbers come first, then the second ones, and so on: that
    is 40 % smaller than what is usual.
    """
    numbers = [
        f"{field.name}.list.element"
        for field in table.schema
        if isinstance(field.type, pa.ListType | pa.FixedSizeListType) and pa.types.is_floating(field.type.value_type)
    ]
    others = [name for name in table.schema.names if f"{name}.list.element" not in numbers]
    how: dict[str, Any] = {"use_dictionary": others, "use_byte_stream_split": numbers} if numbers else {}
    write_atomic(
        path, lambda stream: pq.write_table(table, stream, compression="zstd", write_page_checksum=True, **how)
    )


def write_tasks(folder: Path, tasks: Sequence[str]) -> None:
    """The table of tasks; LeRobot reads it with pandas and wants the names as its index, which this metadata says."""
    column = {
        "metadata": None,
        "numpy_type": "int64",
        "pandas_type": "int64",
        "name": "task_index",
        "field_name": "task_index",
    }
    index = {"metadata": None, "numpy_type": "object", "pandas_type": "unicode", "name": "task", "field_name": "task"}
    header = {
        "metadata": {"encoding": "UTF-8"},
        "numpy_type": "object",
        "pandas_type": "unicode",
        "name": None,
        "field_name": None,
    }
    pandas = {
        "index_columns": ["task"],
        "column_indexes": [header],
        "columns": [column, index],
        "creator": {"library": "pyarrow", "version": pa.__version__},
        "pandas_version": "2.2.0",
    }
    table = pa.table({"task_index": pa.array(range(len(tasks)), pa.int64()), "task": pa.array(tasks, pa.string())})
    write_table(folder / "meta" / "tasks.parquet", table.replace_schema_metadata({"pandas": json.dumps(pandas)}))


def stats_of(array: np.ndarray) -> dict[str, np.ndarray]:
    """Statistics over the frames of one column (T, ...) of one episode; of pictures (T, H, W) over all their pixels,
    from 0 to 1, as (3, 1, 1).
    """
    if array.ndim == 3:
        whole = stats_of(array.reshape(-1, 1) / 255)
        channels = {key: np.broadcast_to(value, (3, 1, 1)) for key, value in whole.items() if key != "count"}
        return {**channels, "count": np.array([len(array)])}
    values = array.reshape(len(array), -1).astype(np.float64)
    return {
        "min": values.min(0),
        "max": values.max(0),
        "mean": values.mean(0),
        "std": values.std(0),
        "count": np.array([len(values)]),
        **dict(zip(QUANTILES, np.quantile(values, list(QUANTILES.values()), axis=0), strict=True)),
    }


def merge_stats(episodes: Sequence[Stats]) -> dict[str, dict[str, np.ndarray]]:
    """Statistics of all frames from those of the episodes: var = mean(var_e + (mean_e - mean)^2), weighted by
    frames; quantiles are the weighted means of the episodes', as LeRobot merges them.
    """
    merged = {}
    for name in episodes[0]:
        count = np.array([episode[name]["count"][0] for episode in episodes], float)
        means, stds = (np.array([episode[name][key] for episode in episodes]) for key in ("mean", "std"))
        weight = (count / count.sum()).reshape(-1, *[1] * (means.ndim - 1))
        mean = (weight * means).sum(0)
        merged[name] = {
            "min": np.min([episode[name]["min"] for episode in episodes], 0),
            "max": np.max([episode[name]["max"] for episode in episodes], 0),
            "mean": mean,
            "std": np.sqrt((weight * (stds**2 + (means - mean) ** 2)).sum(0)),
            "count": np.array([int(count.sum())]),
            **{key: (weight * np.array([episode[name][key] for episode in episodes])).sum(0) for key in QUANTILES},
        }
    return merged


def flatten_stats(stats: Stats) -> dict[str, list]:
    """Statistics of an episode as columns `stats/<column>/<statistic>` of its row."""
    return {f"stats/{name}/{key}": value.tolist() for name, values in stats.items() for key, value in values.items()}


def unflatten_stats(row: Mapping[str, Any]) -> dict[str, dict[str, np.ndarray]]:
    """The inverse of flatten_stats."""
    stats: dict[str, dict[str, np.ndarray]] = {}
    for column, value in row.items():
        if column.startswith("stats/"):
            _, name, key = column.split("/")
            stats.setdefault(name, {})[key] = np.array(value)
    return stats


def stats_to_json(stats: Stats) -> dict[str, dict[str, list]]:
    """Statistics as plain lists."""
    return {name: {key: value.tolist() for key, value in values.items()} for name, values in stats.items()}


def column(values: np.ndarray, feature: Mapping[str, Any]) -> pa.Array:
    """Values (T,) as a column of numbers, (T, W) as one of lists of fixed size, or (T, H, W) uint8 as one of RGB
    pictures, PNG each.
    """
    if values.ndim == 3:
        pictures = [iio.imwrite("<bytes>", np.repeat(one[..., None], 3, -1), extension=".png") for one in values]
        return pa.array(({"bytes": one, "path": None} for one in pictures), PICTURES)
    flat = pa.array(np.ascontiguousarray(values).ravel(), _ARROW[feature["dtype"]])
    return flat if values.ndim == 1 else pa.FixedSizeListArray.from_arrays(flat, values.shape[1])


def matrix(table: pa.Table, column: str, folder: Path) -> np.ndarray:
    """A column of fixed-size lists as (rows, width)."""
    merged = table.column(column).combine_chunks()
    width = merged.type.list_size if pa.types.is_fixed_size_list(merged.type) else 0
    if not width or merged.null_count:
        raise BadFile(
            f"{folder}: column {column!r} does not hold vectors of one length; make the "
            "demonstrations again with `mimicbench demos`"
        )
    values = merged.flatten().to_numpy(zero_copy_only=False).reshape(len(merged), width)
    if not np.isfinite(values).all():
        raise BadFile(
            f"{folder}: column {column!r} holds numbers that are not finite; make the demonstrations "
            "again with `mimicbench demos`"
        )
    return values


def read_tasks(folder: Path) -> list[str]:
    """The tasks of a dataset in the order of their index. Raises BadFile."""
    path = folder / "meta" / "tasks.parquet"
    rows = read_table(path).to_pylist()
    if not rows or any(type(row.get("task_index")) is not int or type(row.get("task")) is not str for row in rows):
        raise BadFile(f"{path} names no tasks with their numbers; make the demonstrations again")
    return [row["task"] for row in sorted(rows, key=lambda row: row["task_index"])]
