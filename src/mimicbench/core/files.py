"""Files that are whole or absent, safe to read, and that say what they are.

Everything is written to a temporary name and then renamed, so a reader never sees half a file. Nothing here is a
pickle, and what is read is bounded in size before it is unpacked. What no format of its own protects from flipped bits
carries a digest, which is checked on reading.
"""

import hashlib
import json
import os
import tokenize
import zipfile
import zlib
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np

from mimicbench.core.errors import BadFile

DIGEST = "digest"
"""What a digest is called in a file."""
MAX_UNPACKED = 2 << 30  # bytes; the largest artefact we write is far below


def write_atomic(path: Path, write: Callable[[IO[bytes]], object]) -> None:
    """Call `write` with a temporary file, then rename it to `path`. Raises BadFile if that is a folder."""
    if path.is_dir():
        raise BadFile(f"{path} is a folder; give the name of a file, such as one in it")
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with open(temporary, "wb") as stream:
            write(stream)
        os.replace(temporary, path)
    except OSError as error:
        if error.errno is not None and error.filename is None:
            error.filename = str(path)  # of a full disk the system says no more than that it is full
        raise
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def back_again() -> Iterator[None]:
    """Whoever works in another folder within this, such as somebody else's program, leaves the working folder as it
    was: relative paths mean the same as before.
    """
    handle = os.open(".", os.O_RDONLY)
    try:
        yield
    finally:
        os.fchdir(handle)
        os.close(handle)


def digest_of(path: Path) -> str:
    """Sixteen hex digits that stand for a file's bytes. Raises BadFile if there is no such file."""
    try:
        with open(path, "rb") as stream:
            return hashlib.file_digest(stream, lambda: hashlib.blake2b(digest_size=8)).hexdigest()
    except FileNotFoundError:
        raise BadFile(f"{path} does not exist") from None


def remove_unfinished(folder: Path) -> None:
    """Remove what `write_atomic` was writing into a folder, or one within it, when it was killed. Hold the folder."""
    for path in list(folder.rglob(".*.tmp*")):
        path.unlink(missing_ok=True)


def write_json(path: Path, data: Any) -> None:
    """Write JSON with sorted keys, atomically."""
    text = json.dumps(data, indent=1, sort_keys=True) + "\n"
    write_atomic(path, lambda stream: stream.write(text.encode()))


def read_json(path: Path, max_bytes: int = 64 << 20) -> Any:
    """Read JSON. Raises BadFile if it is missing, too large or not JSON."""
    try:
        if path.stat().st_size > max_bytes:
            raise BadFile(f"{path} is larger than {max_bytes >> 20} MiB; it is not a file of ours")
        return json.loads(path.read_text())
    except FileNotFoundError:
        raise BadFile(f"{path} does not exist") from None
    except (ValueError, RecursionError) as error:  # of text, of JSON, of numbers too long, of what is nested too deep
        raise BadFile(f"{path} is not valid JSON ({error}); it may be cut off: make it again") from None


def digest_of_json(data: Any) -> str:
    """Sixteen hex digits that stand for JSON values, however they are laid out."""
    return hashlib.blake2b(json.dumps(data, sort_keys=True).encode(), digest_size=8).hexdigest()


def write_record(path: Path, record: Mapping[str, Any]) -> None:
    """Write a JSON object together with its digest, atomically."""
    plain = json.loads(json.dumps(dict(record)))
    write_json(path, {**plain, DIGEST: digest_of_json(plain)})


def read_record(path: Path, known: Collection[str] | None = None, max_bytes: int = 64 << 20) -> dict[str, Any]:
    """Read what `write_record` wrote, without its digest; one without a digest may have been written by hand.

    `known` are the names that may be there: one that is not was damaged, for what if it was the digest's? Raises
    BadFile.
    """
    record = read_json(path, max_bytes)
    if not isinstance(record, dict):
        raise BadFile(f"{path} holds {type(record).__name__}, not names and values; make it again")
    found = record.pop(DIGEST, None)
    if found is not None and found != digest_of_json(record):
        raise BadFile(
            f"{path} is not as it was written: it is damaged, make it again; if you have edited it, remove its "
            f"{DIGEST!r}"
        )
    strange = sorted(set(record) - set(record if known is None else known))
    if strange:
        raise BadFile(f"{path} has an unknown {strange[0]!r}; it is damaged or not of ours: make it again")
    return record


def write_npz(path: Path, header: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
    """Write arrays with a JSON header as a compressed `.npz`, atomically and with the same bytes for the same
    content.
    """
    write_arrays(path, {"header": np.array(json.dumps(header, sort_keys=True)), **arrays})


def write_arrays(path: Path, arrays: Mapping[str, np.ndarray]) -> None:
    """Write arrays alone as a compressed `.npz`, for other people's programs, in the same way."""

    def write(stream: IO[bytes]) -> None:
        # np.savez stamps the time of day; a fixed date keeps the bytes reproducible
        with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED, compresslevel=4) as archive:
            for name, array in arrays.items():
                entry = zipfile.ZipInfo(f"{name}.npy", date_time=(1980, 1, 1, 0, 0, 0))
                entry.compress_type = zipfile.ZIP_DEFLATED
                with archive.open(entry, "w", force_zip64=True) as member:
                    np.lib.format.write_array(member, np.asanyarray(array), allow_pickle=False)

    write_atomic(path, write)


_PACKED = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""The other methods may be told to reserve gigabytes."""


def read_npz(
    path: Path, kind: str, only: Collection[str] | None = None
) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Read what `write_npz` wrote: its header, whose `type` must be `kind`, and its arrays, or those in `only`.

    Raises BadFile.
    """
    if not path.is_file():
        raise BadFile(f"{path} is a folder; give a file in it" if path.is_dir() else f"{path} does not exist")
    try:
        with zipfile.ZipFile(path) as archive:
            if any(entry.compress_type not in _PACKED for entry in archive.infolist()):
                raise BadFile(f"{path} is packed in an unusual way; it was not written by mimicbench")
            unpacked = sum(entry.file_size for entry in archive.infolist())
            if unpacked > MAX_UNPACKED:
                raise BadFile(
                    f"{path} unpacks to {unpacked >> 20} MiB, more than any file of ours; refusing to read it"
                )
        with np.load(path, allow_pickle=False) as archive:
            if "header" not in archive.files:
                raise BadFile(f"{path} has no header; it was not written by mimicbench")
            header = json.loads(str(archive["header"]))
            arrays = {
                name: archive[name] for name in archive.files if name != "header" and (only is None or name in only)
            }
    except BadFile:
        raise
    except (
        OSError,
        ValueError,
        EOFError,
        zipfile.BadZipFile,
        KeyError,
        SyntaxError,
        MemoryError,
        NotImplementedError,
        OverflowError,
        TypeError,
        tokenize.TokenError,
        RuntimeError,
        zlib.error,
    ) as error:
        raise BadFile(f"{path} cannot be read ({error}); it is cut off or not an .npz file of ours") from None
    if not isinstance(header, dict) or header.get("type") != kind:
        found = header.get("type") if isinstance(header, dict) else type(header).__name__
        raise BadFile(f"{path} holds {found!r}, expected {kind!r}")
    return header, arrays
