"""What a parquet file says that it holds, before anything of it is unpacked: a few bytes can stand for any number."""

from pathlib import Path

import pyarrow.parquet as pq

from mimicbench.core.errors import BadFile

SMALL = 1 << 30
"""Bytes that any file may come to."""
RATIO = 100
"""Beyond that, bytes that a byte of a file may come to; demonstrations of ours come to some 3."""


def check_claims(path: Path, metadata: pq.FileMetaData) -> None:
    """Raise BadFile if a file's columns are too large to be what it holds.

    Args:
        path: the file, for the message.
        metadata: its own.
    """
    groups = [metadata.row_group(i) for i in range(metadata.num_row_groups)]
    values = sum(group.column(i).num_values for group in groups for i in range(group.num_columns))
    size = path.stat().st_size
    if 8 * values > max(SMALL, RATIO * size):
        raise BadFile(f"{path} says that it has {values} numbers in {size} bytes; it is damaged, or made to do harm")
