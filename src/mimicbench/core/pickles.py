"""Reading other projects' `.npy` and pickle files without running anything that they name.

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
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from mimicbench.core.errors import BadFile

MAX_OPCODES = 20_000
"""Instructions in one file; the motion files that we know have a few hundred."""
MAX_HEADER = 1_000
"""Bytes of an `.npy` file's header."""

_OPCODES = frozenset({
    "PROTO", "FRAME", "STOP", "MARK", "POP", "POP_MARK", "DUP", "NONE", "NEWTRUE", "NEWFALSE", "BININT", "BININT1", "BININT2", "LONG1", "LONG4",
    "BINFLOAT", "BINUNICODE", "SHORT_BINUNICODE", "BINUNICODE8", "BINBYTES", "SHORT_BINBYTES", "BINBYTES8", "EMPTY_LIST", "APPEND", "APPENDS",
    "EMPTY_TUPLE", "TUPLE", "TUPLE1", "TUPLE2", "TUPLE3", "EMPTY_DICT", "DICT", "LIST", "SETITEM", "SETITEMS", "BINPUT", "LONG_BINPUT", "MEMOIZE",
    "BINGET", "LONG_BINGET", "GLOBAL", "STACK_GLOBAL", "REDUCE", "BUILD",
})  # fmt: skip
_TYPE = re.compile(r"[<>=|]?(b1|[iu][1248]|f[248]|c(8|16)|\?|[SU]\d{1,4}|O8?)")

_MALFORMED = (
    ValueError, TypeError, EOFError, KeyError, IndexError, AttributeError, OverflowError, MemoryError, RecursionError, SyntaxError, pickle.PickleError
)  # fmt: skip
"""What reading a damaged file may raise."""


def load_restricted(path: Path, max_bytes: int) -> Any:
    """What a `.npy` file (object arrays included) or a pickle holds: plain values and NumPy arrays.

    An object array without dimensions, as `np.save` makes of a dict, is unwrapped. Raises BadFile if the file is missing,
    larger than `max_bytes`, cut off, or names a class or function outside the short list of NumPy's and OrderedDict.
    """
    try:
        size = path.stat().st_size
        if size > max_bytes:
            raise BadFile(f"{path} has {size >> 20} MiB, more than the {max_bytes >> 20} MiB that such a file may have")
        raw = path.read_bytes()
    except OSError as error:
        raise BadFile(f"{path} cannot be read ({error.strerror or error}); give the path of a file that exists") from None
    if not raw:
        raise BadFile(f"{path} is empty; get it again from where it came")
    try:
        value = _read_npy(raw) if raw.startswith(b"\x93NUMPY") else _unpickle(raw)
    except _RefusedError as error:
        raise BadFile(f"{path} asks for {error}, which a motion file has no need of; nothing was run: get the file from a source you trust") from None
    except _MALFORMED as error:
        detail = " ".join(str(error).split())[:120]
        raise BadFile(f"{path} cannot be read ({detail}); it is cut off or not an .npy or pickle file: get it again") from None
    if isinstance(value, np.ndarray) and value.dtype == object and value.shape == ():
        return value.item()
    return value


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


class _Unpickler(pickle.Unpickler):
    """Hands out stand-ins only."""

    def find_class(self, module: str, name: str) -> Any:
        """The stand-in for module.name, which is never imported."""
        try:
            return _GLOBALS[module, name]
        except KeyError:
            raise _RefusedError(f"{module}.{name}") from None


def _unpickle(raw: bytes) -> Any:
    """The value of a pickle, after its instructions were checked."""
    for count, (opcode, argument, _) in enumerate(pickletools.genops(raw)):
        if opcode.name not in _OPCODES:
            raise _RefusedError(f"the pickle instruction {opcode.name}")
        # the memo is a table as long as its largest index: a few bytes could ask for gigabytes
        if count >= MAX_OPCODES or ("PUT" in opcode.name and int(argument or 0) > MAX_OPCODES):
            raise ValueError(f"more than {MAX_OPCODES} pickle instructions")
        named = str(argument)
        if opcode.name == "GLOBAL" and tuple(named.split(" ", 1)) not in _GLOBALS:
            raise _RefusedError(named.replace(" ", "."))
    return _resolve(_Unpickler(io.BytesIO(raw)).load(), {})


def _resolve(value: Any, done: dict[int, tuple[Any, Any]]) -> Any:
    """The same value with arrays in place of their descriptions. What occurs twice is made once; a value inside itself is refused."""
    if not isinstance(value, dict | list | tuple | _Array):
        if isinstance(value, _Maker | _Type):
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
