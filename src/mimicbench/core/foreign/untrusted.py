"""Reading other projects' `.npy`, `.npz`, `.pt` and pickle files: sizes are bounded, and nothing that they name is
run (see pickles.py).
"""

import ast
import io
import pickle
import zipfile
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mimicbench.core.errors import BadFile
from mimicbench.core.foreign.pickles import PLAIN_TYPE, RefusedError, Storage, StorageType, make_array, unpickle

NPY = b"\x93NUMPY"
POINTERS = (b"version https://git-lfs.github.com/spec/", b"/annex/objects/")
"""What stands in a file whose content Git LFS or git-annex keeps elsewhere."""
MAX_HEADER = 1_000
"""Bytes of an `.npy` file's header."""
MAX_MEMBERS = 1_000
"""Files in one archive; motions have a dozen."""

_MALFORMED = (
    ValueError,
    TypeError,
    EOFError,
    KeyError,
    IndexError,
    AttributeError,
    OverflowError,
    MemoryError,
    RecursionError,
    SyntaxError,
    pickle.PickleError,
    zipfile.BadZipFile,
    zlib.error,
    NotImplementedError,
    RuntimeError,
    OSError,
)
"""What reading a damaged file may raise."""


def load_restricted(path: Path, max_bytes: int) -> Any:
    """What a `.npy` file (object arrays included) or a pickle holds: plain values and NumPy arrays.

    An object array without dimensions, as `np.save` makes of a dict, is unwrapped. Raises BadFile if the file is
    missing, larger than `max_bytes`, cut off, or names a class or function outside the short list of NumPy's and
    OrderedDict.
    """
    raw = read_bytes(path, max_bytes)
    return _guarded(
        path, ".npy or pickle", lambda: _unwrapped(_read_npy(raw) if raw.startswith(NPY) else unpickle(raw))
    )


def load_npz(path: Path, max_bytes: int, names: Sequence[str]) -> dict[str, Any]:
    """Those of an `.npz` file's arrays that are in `names`; objects in them are unpickled as `load_restricted` does.

    Nothing else is unpacked, and together they may unpack to `max_bytes`. Raises BadFile.
    """
    raw = read_bytes(path, max_bytes)
    return _guarded(
        path,
        ".npz",
        lambda: {
            name: _unwrapped(_read_npy(member)) for name, member in _members(raw, names, ".npy", max_bytes).items()
        },
    )


def load_torch(path: Path, max_bytes: int) -> Any:
    """What a `.pt` file holds, with NumPy arrays in place of its tensors. Raises BadFile."""
    raw = read_bytes(path, max_bytes)
    return _guarded(path, ".pt", lambda: _read_torch(raw, max_bytes))


def is_file(path: Path) -> bool:
    """Whether there is such a file; a name that is too long is none's."""
    try:
        return path.is_file()
    except OSError:
        return False


def read_bytes(path: Path, max_bytes: int) -> bytes:
    """A file's content. Raises BadFile if it is missing, empty or larger than `max_bytes`."""
    try:
        if not path.is_file():
            why = "it is a folder; give the files in it" if path.is_dir() else "no such file; give one that exists"
            raise BadFile(f"{path} cannot be read ({why})")
        size = path.stat().st_size
        if size > max_bytes:
            raise BadFile(f"{path} has {size >> 20} MiB, more than the {max_bytes >> 20} MiB that such a file may have")
        raw = path.read_bytes()
    except OSError as error:
        raise BadFile(
            f"{path} cannot be read ({error.strerror or error}); give the path of a file that exists"
        ) from None
    if not raw:
        raise BadFile(f"{path} is empty; get it again from where it came")
    if len(raw) < 2000 and raw.startswith(POINTERS):
        raise BadFile(
            f"{path} is a pointer of Git LFS or git-annex, not the file itself; fetch it first (git lfs pull, or "
            "git annex get)"
        )
    return raw


def _guarded(path: Path, what: str, read: Callable[[], Any]) -> Any:
    """What `read` returns; whatever goes wrong in it becomes one sentence."""
    try:
        return read()
    except RefusedError as error:
        raise BadFile(
            f"{path} asks for {error}, which a motion file has no need of; nothing was run: get the "
            "file from a source you trust"
        ) from None
    except _MALFORMED as error:
        detail = " ".join(str(error).split())[:120]
        raise BadFile(
            f"{path} cannot be read ({detail}); it is cut off or not "
            f"{'an' if what[1] == 'n' else 'a'} {what} file: get it again"
        ) from None


def _unwrapped(value: Any) -> Any:
    return value.item() if isinstance(value, np.ndarray) and value.dtype == object and value.shape == () else value


def _members(raw: bytes, names: Sequence[str], ending: str, max_bytes: int) -> dict[str, bytes]:
    """Files of a zip archive by name, without their ending, of which only those named are unpacked.

    The rest must be small, too.
    """
    with zipfile.ZipFile(io.BytesIO(raw)) as archive:
        entries = archive.infolist()
        if len(entries) > MAX_MEMBERS:
            raise ValueError(f"an archive of {len(entries)} files")
        chosen = {entry.filename.removesuffix(ending): entry for entry in entries}
        chosen = {name: chosen[name] for name in names if name in chosen}
        if not entries:
            raise ValueError("an empty archive")
        total = sum(entry.file_size for entry in chosen.values())
        if total > max_bytes:
            raise ValueError(
                f"it unpacks to {total >> 20} MiB, more than the {max_bytes >> 20} MiB that such a file may have"
            )
        for entry in chosen.values():
            # the other methods may be told to reserve gigabytes
            if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED) or entry.flag_bits & 1:
                raise ValueError("an unusual way of packing, or a password")
        found = {}
        for name, entry in chosen.items():
            with archive.open(entry) as member:
                found[name] = member.read(entry.file_size + 1)
        return found


def _read_torch(raw: bytes, max_bytes: int) -> Any:
    """The content of a `.pt` archive: a pickle, and one file of numbers for each storage that it names."""
    if not raw.startswith(b"PK"):
        raise ValueError(
            "not the zip archive that torch writes since version 1.6; load and save it again with a newer torch"
        )
    with zipfile.ZipFile(io.BytesIO(raw)) as archive:
        pickles = [name for name in archive.namelist()[:MAX_MEMBERS] if name.endswith("/data.pkl")]
    if len(pickles) != 1:
        raise ValueError("no data.pkl")
    folder = pickles[0].removesuffix("data.pkl")
    (order,) = _members(raw, [f"{folder}byteorder"], "", 100).values() or (b"little",)
    if order.strip() != b"little":
        raise ValueError("numbers of an unusual byte order")
    content = _members(raw, pickles, "", 1 << 20)[pickles[0]]
    storages: dict[str, np.ndarray] = {}
    spent = 0

    def storage(key: Any) -> Storage:
        nonlocal spent
        if not (
            isinstance(key, tuple)
            and len(key) == 5
            and key[0] == "storage"
            and isinstance(key[1], StorageType)
            and isinstance(key[2], str)
        ):
            raise ValueError("a reference that is no storage")
        if key[2] not in storages:
            name = f"{folder}data/{key[2]}"
            numbers = _members(raw, [name], "", max_bytes - spent)
            if name not in numbers or type(key[4]) is not int:
                raise ValueError(f"no numbers for storage {key[2]!r:.40}")
            spent += len(numbers[name])
            storages[key[2]] = make_array((key[4],), key[1].dtype(), False, numbers[name])
        return Storage(storages[key[2]])

    return unpickle(content, storage)


def _read_npy(raw: bytes) -> Any:
    """The content of an `.npy` file, version 1 to 3."""
    stream = io.BytesIO(raw)
    stream.seek(6)
    major = stream.read(2)[0]
    if major not in (1, 2, 3):
        raise ValueError(f".npy version {major}")
    length = int.from_bytes(stream.read(2 if major == 1 else 4), "little")
    if length > MAX_HEADER:
        raise ValueError("a header that is too long")
    header = ast.literal_eval(stream.read(length).decode("latin1" if major < 3 else "utf8").strip())
    descr, fortran, shape = header["descr"], header["fortran_order"], header["shape"]
    if not isinstance(descr, str) or not PLAIN_TYPE.fullmatch(descr):
        raise ValueError(f"data type {descr!r:.40}")
    rest = raw[stream.tell() :]
    dtype = np.dtype(descr)
    if dtype.kind == "O":
        return unpickle(rest)
    return make_array(shape, dtype, fortran is True, rest)
