"""Reading other projects' `.npy`, `.npz`, `.pt` and pickle files without running anything that they name.

A pickle is a small program. Here its instructions are first counted and checked against a short list; then it is
unpickled with stand-ins in place of every class and function, so that all it can make is numbers, text, lists, dicts
and descriptions of arrays; arrays are made from those only after their sizes were checked.
"""

import ast
import io
import math
import pickle
import pickletools
import re
import zipfile
import zlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mimicbench.core.errors import BadFile

NPY = b"\x93NUMPY"
MAX_OPCODES = 20_000
"""Instructions in one file; the motion files that we know have a few hundred."""
MAX_HEADER = 1_000
"""Bytes of an `.npy` file's header."""
MAX_MEMBERS = 1_000
"""Files in one archive; motions have a dozen."""

_OPCODES = frozenset({
    "PROTO", "FRAME", "STOP", "MARK", "POP", "POP_MARK", "DUP", "NONE", "NEWTRUE", "NEWFALSE", "BININT", "BININT1", "BININT2", "LONG1", "LONG4",
    "BINFLOAT", "BINUNICODE", "SHORT_BINUNICODE", "BINUNICODE8", "BINBYTES", "SHORT_BINBYTES", "BINBYTES8", "EMPTY_LIST", "APPEND", "APPENDS",
    "EMPTY_TUPLE", "TUPLE", "TUPLE1", "TUPLE2", "TUPLE3", "EMPTY_DICT", "DICT", "LIST", "SETITEM", "SETITEMS", "BINPUT", "LONG_BINPUT", "MEMOIZE",
    "BINGET", "LONG_BINGET", "GLOBAL", "STACK_GLOBAL", "REDUCE", "BUILD",
})  # fmt: skip
_TYPE = re.compile(r"[<>=|]?(b1|[iu][1248]|f[248]|c(8|16)|\?|[SU]\d{1,4}|O8?)")

_MALFORMED = (
    ValueError, TypeError, EOFError, KeyError, IndexError, AttributeError, OverflowError, MemoryError, RecursionError, SyntaxError, pickle.PickleError,
    zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, OSError
)  # fmt: skip
"""What reading a damaged file may raise."""


def load_restricted(path: Path, max_bytes: int) -> Any:
    """What a `.npy` file (object arrays included) or a pickle holds: plain values and NumPy arrays.

    An object array without dimensions, as `np.save` makes of a dict, is unwrapped. Raises BadFile if the file is missing,
    larger than `max_bytes`, cut off, or names a class or function outside the short list of NumPy's and OrderedDict.
    """
    raw = read_bytes(path, max_bytes)
    return _guarded(path, ".npy or pickle", lambda: _unwrapped(_read_npy(raw) if raw.startswith(NPY) else _unpickle(raw)))


def load_npz(path: Path, max_bytes: int, names: Sequence[str]) -> dict[str, Any]:
    """Those of an `.npz` file's arrays that are in `names`; objects in them are unpickled as `load_restricted` does.

    Nothing else is unpacked, and together they may unpack to `max_bytes`. Raises BadFile.
    """
    raw = read_bytes(path, max_bytes)
    return _guarded(path, ".npz", lambda: {name: _unwrapped(_read_npy(member)) for name, member in _members(raw, names, ".npy", max_bytes).items()})


def load_torch(path: Path, max_bytes: int) -> Any:
    """What a `.pt` file holds, with NumPy arrays in place of its tensors. Raises BadFile."""
    raw = read_bytes(path, max_bytes)
    return _guarded(path, ".pt", lambda: _read_torch(raw, max_bytes))


def read_bytes(path: Path, max_bytes: int) -> bytes:
    """A file's content. Raises BadFile if it is missing, empty or larger than `max_bytes`."""
    try:
        if not path.is_file():
            raise BadFile(f"{path} cannot be read (no such file); give the path of a file that exists")
        size = path.stat().st_size
        if size > max_bytes:
            raise BadFile(f"{path} has {size >> 20} MiB, more than the {max_bytes >> 20} MiB that such a file may have")
        raw = path.read_bytes()
    except OSError as error:
        raise BadFile(f"{path} cannot be read ({error.strerror or error}); give the path of a file that exists") from None
    if not raw:
        raise BadFile(f"{path} is empty; get it again from where it came")
    return raw


def _guarded(path: Path, what: str, read: Callable[[], Any]) -> Any:
    """What `read` returns; whatever goes wrong in it becomes one sentence."""
    try:
        return read()
    except _RefusedError as error:
        raise BadFile(f"{path} asks for {error}, which a motion file has no need of; nothing was run: get the file from a source you trust") from None
    except _MALFORMED as error:
        detail = " ".join(str(error).split())[:120]
        raise BadFile(f"{path} cannot be read ({detail}); it is cut off or not {'an' if what[1] == 'n' else 'a'} {what} file: get it again") from None


def _unwrapped(value: Any) -> Any:
    return value.item() if isinstance(value, np.ndarray) and value.dtype == object and value.shape == () else value


def _members(raw: bytes, names: Sequence[str], ending: str, max_bytes: int) -> dict[str, bytes]:
    """Files of a zip archive by name, without their ending, of which only those named are unpacked; the rest must be small, too."""
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
            raise ValueError(f"it unpacks to {total >> 20} MiB, more than the {max_bytes >> 20} MiB that such a file may have")
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
        raise ValueError("not the zip archive that torch writes since version 1.6; load and save it again with a newer torch")
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

    def storage(key: Any) -> _Storage:
        nonlocal spent
        if not (isinstance(key, tuple) and len(key) == 5 and key[0] == "storage" and isinstance(key[1], _StorageType) and isinstance(key[2], str)):
            raise ValueError("a reference that is no storage")
        if key[2] not in storages:
            name = f"{folder}data/{key[2]}"
            numbers = _members(raw, [name], "", max_bytes - spent)
            if name not in numbers or type(key[4]) is not int:
                raise ValueError(f"no numbers for storage {key[2]!r:.40}")
            spent += len(numbers[name])
            storages[key[2]] = _make_array((key[4],), key[1].dtype(), False, numbers[name])
        return _Storage(storages[key[2]])

    return _unpickle(content, _TORCH_GLOBALS, storage)


class _RefusedError(Exception):
    """Names what a pickle asked for and does not get."""


class _Maker:
    """Stands for a function or class that a pickle may name; only calling it does anything."""

    __slots__ = ("_make",)

    def __init__(self, make: Callable[..., Any] | None) -> None:
        self._make = make

    def __call__(self, *args: Any) -> Any:
        if self._make is None:
            raise ValueError("a class is called that is only ever named")
        return self._make(*args)

    def __setstate__(self, state: Any) -> None:
        raise ValueError("a function is given a state")


class _Type:
    """A data type as the pickle describes it."""

    def __init__(self, code: str, *_: Any) -> None:
        if not isinstance(code, str) or not _TYPE.fullmatch(code):
            raise ValueError(f"data type {code!r} is not a plain number, text or object")
        self.code = code

    def __setstate__(self, state: tuple) -> None:
        # (version, byte order, subarray, names, fields, ...): structured types have no place here
        if not isinstance(state, tuple) or len(state) < 5 or state[1] not in ("<", ">", "|", "=") or any(part is not None for part in state[2:5]):
            raise ValueError("a structured data type")
        self.code = state[1] + self.code.lstrip("<>=|")

    def dtype(self) -> np.dtype:
        return np.dtype(self.code)


class _StorageType(_Type):
    """A data type that stands for itself; there is one of each, so nothing may change it."""

    def __setstate__(self, state: tuple) -> None:
        raise ValueError("a data type is given a state")


class _Array:
    """An array as the pickle describes it; `array` checks and makes it."""

    def __init__(self, *_: Any) -> None:
        self.state: tuple | None = None

    def __setstate__(self, state: tuple) -> None:
        self.state = state

    def array(self, resolve: Callable[[Any], Any]) -> np.ndarray:
        if not isinstance(self.state, tuple) or len(self.state) != 5:
            raise ValueError("an array without content")
        _, shape, kind, fortran, content = self.state
        if not isinstance(kind, _Type):
            raise ValueError("an array without data type")
        return _make_array(shape, kind.dtype(), bool(fortran), [resolve(item) for item in content] if isinstance(content, list) else content)


def _make_array(shape: Any, dtype: np.dtype, fortran: bool, content: bytes | list) -> np.ndarray:
    """An array from its description, of which the sizes must agree."""
    if not isinstance(shape, tuple) or len(shape) > 8 or not all(type(n) is int and n >= 0 for n in shape):
        raise ValueError(f"array of shape {shape!r:.60}")
    count, order = math.prod(shape), "F" if fortran else "C"
    if dtype.kind == "O":
        if not isinstance(content, list) or len(content) != count:
            raise ValueError("object array of the wrong length")
        array = np.empty(count, object)
        for i, item in enumerate(content):
            array[i] = item
        return array.reshape(shape, order=order)
    if not isinstance(content, bytes) or len(content) != count * dtype.itemsize:
        raise ValueError(f"array of shape {shape} does not fill its bytes")
    if count == 0:
        return np.zeros(shape, dtype)
    return np.frombuffer(content, dtype).reshape(shape, order=order).copy()


class _Storage:
    """The numbers of one or several tensors."""

    def __init__(self, numbers: np.ndarray) -> None:
        self.numbers = numbers


class _Tensor(_Array):
    """A tensor as the pickle describes it."""

    def __init__(self, storage: Any, offset: Any, shape: Any, strides: Any, *_: Any) -> None:
        super().__init__()
        self._view = (storage, offset, shape, strides)

    def __setstate__(self, state: tuple) -> None:
        raise ValueError("a tensor is given a state")

    def array(self, resolve: Callable[[Any], Any]) -> np.ndarray:
        storage, offset, shape, strides = self._view
        whole = [offset, *shape, *strides] if isinstance(shape, tuple) and isinstance(strides, tuple) else [None]
        if not isinstance(storage, _Storage) or len(shape) != len(strides) or len(shape) > 8 or not all(type(n) is int and n >= 0 for n in whole):
            raise ValueError("a tensor without numbers, shape or strides")
        numbers = storage.numbers
        if math.prod(shape) > len(numbers):
            raise ValueError(f"a tensor of shape {shape!r:.60} made of {len(numbers)} numbers")
        if math.prod(shape) == 0:
            return np.zeros(shape, numbers.dtype)
        if offset + sum((n - 1) * step for n, step in zip(shape, strides, strict=True)) >= len(numbers):
            raise ValueError(f"a tensor of shape {shape!r:.60} that reaches beyond its numbers")
        size = numbers.itemsize
        return np.lib.stride_tricks.as_strided(numbers[offset:], shape, [step * size for step in strides]).copy()


def _scalar(kind: _Type, content: bytes) -> Any:
    if not isinstance(kind, _Type):
        raise ValueError("a number without data type")
    return _make_array((), kind.dtype(), False, content)[()]


_GLOBALS = {
    **{(f"numpy.{core}.multiarray", "_reconstruct"): _Maker(_Array) for core in ("core", "_core")},
    **{(f"numpy.{core}.multiarray", "scalar"): _Maker(_scalar) for core in ("core", "_core")},
    ("numpy", "ndarray"): _Maker(None),
    ("numpy", "dtype"): _Maker(_Type),
    ("collections", "OrderedDict"): _Maker(dict),
}

_TORCH_TYPES = {"Float": "f4", "Double": "f8", "Half": "f2", "Long": "i8", "Int": "i4", "Short": "i2", "Char": "i1", "Byte": "u1", "Bool": "b1"}
_TORCH_GLOBALS = _GLOBALS | {
    **{("torch", f"{name}Storage"): _StorageType(code) for name, code in _TORCH_TYPES.items()},
    ("torch._utils", "_rebuild_tensor_v2"): _Maker(_Tensor),
}


class _Unpickler(pickle.Unpickler):
    """Hands out stand-ins only."""

    def __init__(self, raw: bytes, known: Mapping[tuple[str, str], Any], storage: Callable[[Any], Any] | None) -> None:
        super().__init__(io.BytesIO(raw))
        self._known, self._storage = known, storage

    def find_class(self, module: str, name: str) -> Any:
        """The stand-in for module.name, which is never imported."""
        try:
            return self._known[module, name]
        except KeyError:
            raise _RefusedError(f"{module}.{name}") from None

    def persistent_load(self, pid: Any) -> Any:
        """The storage that a tensor refers to."""
        if self._storage is None:
            raise _RefusedError("something outside of the file")
        return self._storage(pid)


def _unpickle(raw: bytes, known: Mapping[tuple[str, str], Any] = _GLOBALS, storage: Callable[[Any], Any] | None = None) -> Any:
    """The value of a pickle, after its instructions were checked."""
    for count, (opcode, argument, _) in enumerate(pickletools.genops(raw)):
        if opcode.name not in _OPCODES and not (storage is not None and opcode.name == "BINPERSID"):
            raise _RefusedError(f"the pickle instruction {opcode.name}")
        # the memo is a table as long as its largest index: a few bytes could ask for gigabytes
        if count >= MAX_OPCODES or ("PUT" in opcode.name and int(argument or 0) > MAX_OPCODES):
            raise ValueError(f"more than {MAX_OPCODES} pickle instructions")
        named = str(argument)
        if opcode.name == "GLOBAL" and tuple(named.split(" ", 1)) not in known:
            raise _RefusedError(named.replace(" ", "."))
    return _resolve(_Unpickler(raw, known, storage).load(), {})


def _resolve(value: Any, done: dict[int, tuple[Any, Any]]) -> Any:
    """The same value with arrays in place of their descriptions. What occurs twice is made once; a value inside itself is refused."""
    if not isinstance(value, dict | list | tuple | _Array):
        if isinstance(value, _Maker | _Type | _Storage):
            raise ValueError("a function or a data type where a value should be")
        return value
    if id(value) in done:
        known = done[id(value)][1]
        if known is done:
            raise ValueError("a value that holds itself")
        return known
    done[id(value)] = (value, done)  # being made; the reference keeps the id from being used again
    if isinstance(value, dict):
        made: Any = {_resolve(key, done): _resolve(item, done) for key, item in value.items()}
    elif isinstance(value, list):
        made = [_resolve(item, done) for item in value]
    elif isinstance(value, tuple):
        made = tuple(_resolve(item, done) for item in value)
    else:
        made = value.array(lambda item: _resolve(item, done))
    done[id(value)] = (value, made)
    return made


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
    if not isinstance(descr, str) or not _TYPE.fullmatch(descr):
        raise ValueError(f"data type {descr!r:.40}")
    rest = raw[stream.tell() :]
    dtype = np.dtype(descr)
    if dtype.kind == "O":
        return _unpickle(rest)
    return _make_array(shape, dtype, fortran is True, rest)
