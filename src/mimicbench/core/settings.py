"""What configurations share: bounds of numbers, amounts that may be raised, and strict reading of a tree of values.

A configuration is a frozen dataclass whose fields are numbers, words, tuples and further configurations. A field of
type `Annotated[int, Amount()]` says how much of a stage is made, not what it is: it can be raised later, and the stage
goes on. Everything else determines the stage.
"""

import json
from collections.abc import Mapping
from dataclasses import MISSING, asdict, dataclass, fields, is_dataclass, replace
from functools import cache
from math import isfinite
from typing import Annotated, Any, TypeVar, get_type_hints

import msgspec

from mimicbench.core.errors import MimicbenchError

Config = TypeVar("Config", bound=Any)


class BadSetting(MimicbenchError):
    """A setting that does not exist, is of another type, out of its bounds, or does not go with another."""


@dataclass(frozen=True)
class Within:
    """Bounds of a number, both allowed."""

    low: float
    high: float


@dataclass(frozen=True)
class Amount(Within):
    """Bounds of a number that says how much is made."""

    low: float = 1
    high: float = 1e12


@dataclass(frozen=True)
class Later:
    """Of a setting that came after others: at its default it changes nothing, and determines nothing, so that what was
    made before there was such a setting is still known.
    """


Count = Annotated[int, Amount(1, 10_000_000)]
"""How many items a stage has."""
Positive = Annotated[int, Within(1, 1e12)]
Sizes = Annotated[tuple[int, ...], Within(1, 1 << 20)]
"""Of layers."""
Share = Annotated[float, Within(0, 1)]
Seed = Annotated[int, Within(0, 2**63 - 1)]


def check(config: Any, where: str = "") -> None:
    """Raise BadSetting for the first value in a configuration that is of another type, or a number that is out of
    bounds or not finite.

    Numbers without bounds are not negative: a field that may be says so by its bounds.
    """
    hints = _hints(type(config))
    for entry in fields(config):
        value, name = getattr(config, entry.name), f"{where}{entry.name}"
        if is_dataclass(value):
            check(value, f"{name}.")
            continue
        _check_type(name, value, hints[entry.name])
        check_value(name, value, hints[entry.name])
        _check_sign(name, value, hints[entry.name])


def check_value(name: str, value: Any, hint: Any) -> None:
    """Raise BadSetting if a value, or one in a tuple, is not finite or out of the bounds in its type's annotation."""
    numbers = [x for x in (value if isinstance(value, tuple) else (value,)) if isinstance(x, int | float)]
    if not all(isfinite(x) for x in numbers):
        raise BadSetting(f"{name} is {value}; give a finite number")
    for bounds in _bounds(hint):
        if not all(bounds.low <= x <= bounds.high for x in numbers):
            raise BadSetting(f"{name} is {value}; give {_number(bounds.low)} to {_number(bounds.high)}")
    if any(isinstance(x, int) and x < 0 for x in numbers):
        raise BadSetting(f"{name} is {value}; give a whole number that is not negative")


def _check_type(name: str, value: Any, hint: Any) -> None:
    """What the command line cannot give, a program can."""
    inner = _dataclass_of(hint)
    if inner is not None and value is not None:
        raise BadSetting(f"{name} is a {type(value).__name__}; give a {inner.__name__}")
    try:
        msgspec.convert(value, hint)
    except msgspec.ValidationError as error:
        raise BadSetting(f"{name} is {value!r}, which cannot be: {error}") from None


def _check_sign(name: str, value: Any, hint: Any) -> None:
    """Lengths, times, rates, weights and deviations have a sign only where their bounds say so."""
    numbers = [x for x in (value if isinstance(value, tuple) else (value,)) if isinstance(x, float)]
    if not _bounds(hint) and any(x < 0 for x in numbers):
        raise BadSetting(f"{name} is {value}; give a number that is not negative")


def identity(config: Any) -> dict[str, Any]:
    """What determines a stage: the configuration as plain JSON values, without its amounts, nor settings that are
    Later at their defaults.
    """
    return {name: value for name, value in _plain(config, amounts=False).items() if value != {}}


def amounts(config: Any) -> dict[str, int | float]:
    """The amounts of a configuration by dotted name."""
    found: dict[str, int | float] = {}
    for entry in fields(config):
        value = getattr(config, entry.name)
        if is_dataclass(value):
            found |= {f"{entry.name}.{name}": amount for name, amount in amounts(value).items()}
        elif _is_amount(config, entry.name):
            found[entry.name] = value
    return found


def to_tree(config: Any) -> dict[str, Any]:
    """A configuration as plain JSON values, amounts and all."""
    return json.loads(json.dumps(asdict(config)))


def differences(config: Any, other: Any) -> dict[str, Any]:
    """The tree of values in which a configuration differs from another one of its class."""
    found: dict[str, Any] = {}
    for entry in fields(config):
        value, before = getattr(config, entry.name), getattr(other, entry.name)
        if is_dataclass(value) and type(value) is type(before):
            found |= {entry.name: inner} if (inner := differences(value, before)) else {}
        elif value != before:
            found[entry.name] = to_tree(value) if is_dataclass(value) else json.loads(json.dumps(value))
    return found


def read(
    kind: type[Config], tree: Mapping[str, Any], where: str = "", source: str = "", base: Config | None = None
) -> Config:
    """The configuration that a tree of values gives; what it leaves out is as in `base`, or has its default.

    A configuration within, of which the tree says something, is otherwise what it is by default where it stands: a
    learner's network of a laptop's size, of which one switch is set, keeps that size.

    Args:
        kind: The dataclass to make.
        tree: Values by name; a mapping for a configuration within.
        where: What stands before the names in messages, such as `track.`.
        source: Where the tree comes from, such as `my.toml`, for messages.
        base: What the tree changes.

    Raises:
        BadSetting: A name is unknown, or a value has the wrong type or is out of bounds.
    """
    said = f" (in {source})" if source else ""
    hints = _hints(kind)
    known = {entry.name for entry in fields(kind)}  # hints are also of what all of a class share
    unknown = [name for name in tree if name not in known]
    if unknown:
        raise BadSetting(f"unknown setting {where}{unknown[0]}{said}; known are: {', '.join(sorted(known))}")
    values = {}
    for name, value in tree.items():
        inner = _dataclass_of(hints[name])
        if inner is not None and isinstance(value, Mapping):
            before = _default(kind, name) if base is None else getattr(base, name)
            values[name] = read(inner, value, f"{where}{name}.", source, before if isinstance(before, inner) else None)
            continue
        try:
            values[name] = msgspec.convert(value, hints[name])
        except msgspec.ValidationError as error:
            raise BadSetting(f"{where}{name} = {value!r}{said} cannot be: {error}") from None
    config = kind(**values) if base is None else replace(base, **values)
    check(config, where)
    return config


def _default(kind: type, name: str) -> Any:
    """What a field of a dataclass is by default; None if nobody says."""
    (entry,) = (entry for entry in fields(kind) if entry.name == name)
    if entry.default_factory is not MISSING:
        return entry.default_factory()
    return None if entry.default is MISSING else entry.default


def merge(*trees: Mapping[str, Any]) -> dict[str, Any]:
    """Trees of values on top of each other: the last one that has a value gives it."""
    found: dict[str, Any] = {}
    for tree in trees:
        for name, value in tree.items():
            old = found.get(name)
            found[name] = merge(old, value) if isinstance(old, Mapping) and isinstance(value, Mapping) else value
    return found


def _plain(config: Any, amounts: bool) -> dict[str, Any]:
    found = {}
    for entry in fields(config):
        value = getattr(config, entry.name)
        if is_dataclass(value):
            found[entry.name] = _plain(value, amounts)
        elif amounts or not (_is_amount(config, entry.name) or _is_later(config, entry.name)):
            found[entry.name] = json.loads(json.dumps(value))
    return found


@cache
def _hints(kind: type) -> dict[str, Any]:
    """Types of a dataclass's fields, bounds and all; kept, for every stage's key asks for those of all settings."""
    return get_type_hints(kind, include_extras=True)


def _is_amount(config: Any, name: str) -> bool:
    return any(isinstance(b, Amount) for b in _bounds(_hints(type(config))[name]))


def _is_later(config: Any, name: str) -> bool:
    """Whether a setting that came later is at its default."""
    marks = _marks(_hints(type(config))[name])
    return any(isinstance(mark, Later) for mark in marks) and getattr(config, name) == _default(type(config), name)


def _bounds(hint: Any) -> list[Within]:
    """The bounds in a type's annotation, or in that of one of its options."""
    return [mark for mark in _marks(hint) if isinstance(mark, Within)]


def _marks(hint: Any) -> list[Any]:
    options = [hint, *getattr(hint, "__args__", ())]
    return [mark for option in options for mark in getattr(option, "__metadata__", ())]


def _dataclass_of(hint: Any) -> type | None:
    """The dataclass that a type is, or that it may be beside None."""
    options = [hint, *getattr(hint, "__args__", ())]
    return next((option for option in options if isinstance(option, type) and is_dataclass(option)), None)


def _number(value: float) -> str:
    return str(int(value)) if value == int(value) else f"{value:g}"
