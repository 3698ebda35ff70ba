"""What a parquet file says that it holds, before anything of it is unpacked: a few bytes can stand for any number."""

from collections.abc import Sequence
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
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


def read_checked(path: Path, schema: pa.Schema, columns: Sequence[str] | None = None) -> pa.Table:
    """Columns of a parquet file, all if None, whose texts are counted before they are written out: a file may say one
    long text once, and that it is in every row.

    Args:
        path: the file, whose claims have been checked.
        schema: its own.
        columns: those that are wanted, without those that it does not have.

    Raises:
        BadFile: Its texts are too long to be what it holds; and what pyarrow raises for a file that is damaged.
    """
    texts = [
        field.name for field in schema if pa.types.is_string(field.type) and field.name in (columns or schema.names)
    ]
    wanted = None if columns is None else list(columns)
    table = pq.read_table(path, columns=wanted, read_dictionary=texts, page_checksum_verification=True)
    size = 0
    for chunk in (chunk for name in texts if name in table.column_names for chunk in table[name].chunks):
        size += pc.sum(pc.binary_length(chunk.dictionary).take(chunk.indices)).as_py() or 0
        if size > max(SMALL, RATIO * path.stat().st_size):
            raise BadFile(f"{path} holds more text than such a file can; it is damaged, or made to do harm")
    fields = [
        pa.field(field.name, pa.string(), field.nullable) if field.name in texts else field for field in table.schema
    ]
    return table.cast(pa.schema(fields, table.schema.metadata))
