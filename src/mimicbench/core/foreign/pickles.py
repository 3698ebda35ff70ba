"""Unpickling without running anything that a pickle names.

A pickle is a small program. Here its instructions are first counted and checked against a short list; then it is
unpickled with stand-ins in place of every class and function, so that all it can make is numbers, text, lists, dicts
and descriptions of arrays; arrays are made from those only after their sizes were checked.
"""

import io
import math
import pickle
import pickletools
import re
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from mimicbench.core.foreign.instructions import MAX_OPCODES, OPCODES, Sizes

PLAIN_TYPE = re.compile(r"[<>=|]?(b1|[iu][1248]|f[248]|c(8|16)|\?|[SU]\d{1,4}|O8?)")
"""What a data type may be called."""


class RefusedError(Exception):
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
        if not isinstance(code, str) or not PLAIN_TYPE.fullmatch(code):
            raise ValueError(f"data type {code!r} is not a plain number, text or object")
        self.code = code

    def __setstate__(self, state: tuple) -> None:
        # (version, byte order, subarray, names, fields, ...): structured types have no place here
        if (
            not isinstance(state, tuple)
            or len(state) < 5
            or state[1] not in ("<", ">", "|", "=")
            or any(part is not None for part in state[2:5])
        ):
            raise ValueError("a structured data type")
        self.code = state[1] + self.code.lstrip("<>=|")

    def dtype(self) -> np.dtype:
        return np.dtype(self.code)


class StorageType(_Type):
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
        return make_array(
            shape,
            kind.dtype(),
            bool(fortran),
            [resolve(item) for item in content] if isinstance(content, list) else content,
        )


def make_array(shape: Any, dtype: np.dtype, fortran: bool, content: bytes | list) -> np.ndarray:
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


class Storage:
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
        if (
            not isinstance(storage, Storage)
            or len(shape) != len(strides)
            or len(shape) > 8
            or not all(type(n) is int and n >= 0 for n in whole)
        ):
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
    return make_array((), kind.dtype(), False, content)[()]


_GLOBALS = {
    **{(f"numpy.{core}.multiarray", "_reconstruct"): _Maker(_Array) for core in ("core", "_core")},
    **{(f"numpy.{core}.multiarray", "scalar"): _Maker(_scalar) for core in ("core", "_core")},
    ("numpy", "ndarray"): _Maker(None),
    ("numpy", "dtype"): _Maker(_Type),
    ("collections", "OrderedDict"): _Maker(dict),
}

_TORCH_TYPES = {
    "Float": "f4",
    "Double": "f8",
    "Half": "f2",
    "Long": "i8",
    "Int": "i4",
    "Short": "i2",
    "Char": "i1",
    "Byte": "u1",
    "Bool": "b1",
}
_TORCH_GLOBALS = _GLOBALS | {
    **{("torch", f"{name}Storage"): StorageType(code) for name, code in _TORCH_TYPES.items()},
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
            raise RefusedError(f"{module}.{name}") from None

    def persistent_load(self, pid: Any) -> Any:
        """The storage that a tensor refers to."""
        if self._storage is None:
            raise RefusedError("something outside of the file")
        return self._storage(pid)


def unpickle(raw: bytes, storage: Callable[[Any], Storage] | None = None) -> Any:
    """The value of a pickle, after its instructions were checked.

    With `storage`, which finds the numbers that a reference of torch's stands for, tensors may be in it too. Raises
    RefusedError if it asks for anything else, and nearly anything if it is damaged.
    """
    known = _GLOBALS if storage is None else _TORCH_GLOBALS
    sizes = Sizes()
    for count, (opcode, argument, _) in enumerate(pickletools.genops(raw)):
        if opcode.name not in OPCODES and not (storage is not None and opcode.name == "BINPERSID"):
            raise RefusedError(f"the pickle instruction {opcode.name}")
        # the memo is a table as long as its largest index: a few bytes could ask for gigabytes
        if count >= MAX_OPCODES or ("PUT" in opcode.name and int(argument or 0) > MAX_OPCODES):
            raise ValueError(f"more than {MAX_OPCODES} pickle instructions")
        if opcode.name == "GLOBAL" and tuple(str(argument).split(" ", 1)) not in known:
            raise RefusedError(str(argument).replace(" ", "."))
        sizes.follow(opcode, argument)
    return _resolve(_Unpickler(raw, known, storage).load(), {})


def _resolve(value: Any, done: dict[int, tuple[Any, Any]]) -> Any:
    """The same value with arrays in place of their descriptions.

    What occurs twice is made once; a value inside itself is refused.
    """
    if not isinstance(value, dict | list | tuple | _Array):
        if isinstance(value, _Maker | _Type | Storage):
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
