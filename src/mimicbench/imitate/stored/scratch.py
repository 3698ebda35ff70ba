"""Large arrays in files instead of memory: what there is no room for is on the disk, and read when it is asked for."""

import errno
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mimicbench.core.errors import MimicbenchError

LEAST = 64 << 20
"""[bytes] Smaller arrays are in memory."""
_ROWS = 1 << 16


def scratch(shape: tuple[int, ...], dtype: np.dtype | type, folder: Path | None) -> np.ndarray:
    """An array to be filled; if it is large, in a file of `folder` that has no name and is gone with the array.

    The operating system keeps of it in memory what there is room for, and takes that back when somebody else needs it.
    Without a folder it is in memory. Raises MimicbenchError if the disk is full.
    """
    size = int(np.prod(shape, dtype=np.int64)) * np.dtype(dtype).itemsize
    if folder is None or size < LEAST:
        return np.empty(shape, dtype)
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=folder) as file:
        try:
            os.posix_fallocate(file.fileno(), 0, size)  # or a full disk would kill the process at some later write
        except OSError as error:
            if error.errno != errno.ENOSPC:
                raise
            raise MimicbenchError(
                f"the disk of {folder} has no room for {size / 1e9:.1f} GB of demonstrations; free some, use another "
                "--workdir, or learn from fewer"
            ) from None
        return np.memmap(file, dtype, "r+", shape=shape)


def joined(parts: Sequence[np.ndarray], folder: Path | None) -> np.ndarray:
    """The rows of all; see scratch."""
    whole = scratch((sum(len(part) for part in parts), *parts[0].shape[1:]), parts[0].dtype, folder)
    at = 0
    for part in parts:
        for begin in range(0, len(part), _ROWS):
            rows = part[begin : begin + _ROWS]
            whole[at : at + len(rows)] = rows
            at += len(rows)
    return whole
