"""Trained networks on disk: `config.json` that says what they are, `model.safetensors` that holds the numbers.

Whoever loads a checkpoint names the kind and the robot that it must be of; the arrays are compared with the shapes
that the network built from the configuration has. Nothing in either file is executed. `model.safetensors` is written
first and `config.json` last, each atomically, so a folder with a `config.json` is a whole checkpoint.

Where two checkpoints have the same numbers, as the trackers of two tasks that were learned together, one may have
`model.same-as` in place of them: a line with the way to the folder of the other, from its own.
"""

import dataclasses
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, TypeVar

import msgspec
import numpy as np
import safetensors
import safetensors.numpy

from mimicbench.core.errors import BadFile
from mimicbench.core.files import digest_of, digest_of_json, read_record, write_atomic, write_record
from mimicbench.core.settings import BadSetting

FORMAT = 1
CONFIG = "config.json"
MODEL = "model.safetensors"
SAME_AS = "model.same-as"
MAX_WAY = 200  # bytes of it
MAX_BYTES = 4 << 30  # the largest network here has 100 million parameters: 0.4 GiB

Config = TypeVar("Config")


class BadCheckpoint(BadFile):
    """A checkpoint is missing, cut off, of another kind or robot, or does not fit its network."""


@dataclass(frozen=True)
class Checkpoint:
    """A checkpoint as read: its arrays are not yet compared with a network (see `matching`)."""

    folder: Path
    kind: str
    """What it is: `tracker`, `planner`, `act`, `bc`, `perception`."""
    robot: str
    """The robot that it drives, such as `h1`."""
    config: Mapping[str, Any]
    """The configuration that the network is built from, as plain JSON values."""
    tensors: Mapping[str, np.ndarray]
    notes: Mapping[str, Any] = field(default_factory=dict)
    """How it came to be: steps, seed, the fingerprint of its data, scores; and what its use needs, such as the gains
    that a clone drives."""

    def config_as(self, config_type: type[Config]) -> Config:
        """The configuration as a dataclass, whose fields may be missing, but no others be there; no size is negative.

        Raises BadCheckpoint if it does not fit.
        """
        try:
            found = msgspec.convert(self.config, config_type)
        except (msgspec.ValidationError, BadSetting, TypeError, ValueError, RecursionError) as error:
            raise self._unlike(str(error)) from None
        wrong = _unfit(self.config, msgspec.to_builtins(found))
        if wrong:
            raise self._unlike(wrong)
        return found

    def _unlike(self, reason: str) -> BadCheckpoint:
        return BadCheckpoint(
            f"{self.folder / CONFIG} does not describe a {self.kind} ({reason}); train it again with this version"
        )

    def matching(self, shapes: Mapping[str, tuple[int, ...]]) -> dict[str, np.ndarray]:
        """The arrays, if they are exactly those of `shapes`. Raises BadCheckpoint with the first one that differs."""
        for name, shape in shapes.items():
            if name not in self.tensors:
                raise BadCheckpoint(
                    f"{self.folder / MODEL} lacks {name!r}; it is not the {self.kind} that its "
                    f"{CONFIG} describes: train it again"
                )
            found = tuple(self.tensors[name].shape)
            if found != tuple(shape):
                raise BadCheckpoint(
                    f"{self.folder / MODEL}: {name!r} is {_by(found)}, but the {self.kind} of its "
                    f"{CONFIG} needs {_by(tuple(shape))}; train it again"
                )
        extra = sorted(set(self.tensors) - set(shapes))
        if extra:
            raise BadCheckpoint(
                f"{self.folder / MODEL} holds {extra[0]!r}, which the {self.kind} of its {CONFIG} "
                "does not have; train it again"
            )
        return dict(self.tensors)


def save_checkpoint(
    folder: Path,
    kind: str,
    robot: str,
    config: Any,
    tensors: Mapping[str, np.ndarray],
    notes: Mapping[str, Any] | None = None,
) -> None:
    """Write a checkpoint, over an earlier one if there is one: each file whole or not at all; if it is killed between
    the two, loading says so.

    Args:
        folder: Where `config.json` and `model.safetensors` go; made if missing.
        kind: What it is, checked on loading.
        robot: The robot's name, checked on loading.
        config: A dataclass, a msgspec struct or a mapping of plain values.
        tensors: Arrays by name; all must be finite.
        notes: What to keep about how it was made, plain values.
    """
    for name, array in tensors.items():
        if np.issubdtype(array.dtype, np.floating) and not np.isfinite(array).all():
            raise BadCheckpoint(
                f"{name!r} of this {kind} is not finite: training diverged, so {folder} keeps what it "
                "held; train with a smaller learning rate"
            )
    plain = dataclasses.asdict(config) if dataclasses.is_dataclass(config) and not isinstance(config, type) else config
    data = safetensors.numpy.save({name: np.asarray(array, order="C") for name, array in tensors.items()})

    def write(stream: IO[bytes]) -> None:
        stream.write(data)

    write_atomic(folder / MODEL, write)
    header = {
        "format": FORMAT,
        "kind": kind,
        "robot": robot,
        "config": msgspec.to_builtins(plain),
        "notes": msgspec.to_builtins(notes or {}),
        "model": digest_of(folder / MODEL),
    }
    write_record(folder / CONFIG, header)


def load_checkpoint(folder: Path, kind: str | None = None, robot: str | None = None, again: bool = True) -> Checkpoint:
    """Read a checkpoint; `kind` and `robot`, if given, are what it must be of. If it is being written meanwhile, it is
    read `again`, once. Raises BadCheckpoint.
    """
    header = _read_header(folder)
    if kind is not None and header["kind"] != kind:
        raise BadCheckpoint(
            f"{folder} is a checkpoint of kind {header['kind']!r}, not {kind!r}; give the folder of a {kind}"
        )
    if robot is not None and header["robot"] != robot:
        raise BadCheckpoint(
            f"{folder} is a checkpoint of another robot, {header['robot']!r}; train one for "
            f"{robot!r}, or choose that robot"
        )
    path = model_file(folder)
    tensors = read_tensors(path)
    if header.get("model", "") not in ("", digest_of(path)):
        if again and _read_header(folder) != header:  # a training has just written both files
            return load_checkpoint(folder, kind, robot, again=False)
        raise BadCheckpoint(
            f"{path} is not what its {CONFIG} was written beside: it is damaged or of another training, or one was "
            "killed as it wrote; give the command that trains it once more, or copy the whole checkpoint again"
        )
    return Checkpoint(folder, header["kind"], header["robot"], header["config"], tensors, header["notes"])


def checkpoint_kind(folder: Path) -> str:
    """What kind of checkpoint a folder holds, without reading its arrays. Raises BadCheckpoint."""
    return _read_header(folder)["kind"]


def checkpoint_robot(folder: Path) -> str:
    """Name of the robot that a folder's checkpoint drives, without reading its arrays. Raises BadCheckpoint."""
    return _read_header(folder)["robot"]


def checkpoint_task(folder: Path) -> str:
    """Name of the task at which a folder's checkpoint was learned, if it tells; else empty. Raises BadCheckpoint."""
    return str(_read_header(folder)["notes"].get("task", ""))


def checkpoint_tasks(folder: Path) -> tuple[str, ...]:
    """Names of all tasks at which a folder's checkpoint was learned, if it tells: a tracker may have learned several.
    Raises BadCheckpoint.
    """
    notes = _read_header(folder)["notes"]
    tasks = notes.get("tasks", [notes["task"]] if notes.get("task") else [])
    return tuple(dict.fromkeys(map(str, tasks))) if isinstance(tasks, list) else ()


def checkpoint_digest(folder: Path) -> str:
    """Stands for all that decides what a checkpoint does: its arrays, and what the network is built from. Raises
    BadCheckpoint.
    """
    header = _read_header(folder)
    return digest_of(model_file(folder)) + digest_of_json([header["kind"], header["robot"], header["config"]])


def model_file(folder: Path) -> Path:
    """The file with the arrays of a checkpoint: its own, or that of the folder which its `model.same-as` names."""
    pointer = folder / SAME_AS
    if (folder / MODEL).exists() or not pointer.is_file():
        return folder / MODEL
    with pointer.open("rb") as stream:
        way = stream.read(MAX_WAY).decode(errors="replace").strip().replace("\0", "")
    return Path(os.path.normpath(folder / way)) / MODEL


def read_tensors(path: Path) -> dict[str, np.ndarray]:
    """The arrays of a safetensors file, bounded in size. Raises BadCheckpoint."""
    if not path.is_file():
        raise BadCheckpoint(f"{path} does not exist; train or download the whole checkpoint")
    if path.stat().st_size > MAX_BYTES:
        raise BadCheckpoint(f"{path} is larger than {MAX_BYTES >> 30} GiB; it is not a checkpoint of ours")
    try:
        tensors = safetensors.numpy.load_file(path)
    except (safetensors.SafetensorError, OSError, ValueError, KeyError, TypeError) as error:
        raise BadCheckpoint(
            f"{path} cannot be read ({error}); it is cut off or not a safetensors file: copy or train it again"
        ) from None
    for name, array in tensors.items():
        if np.issubdtype(array.dtype, np.floating) and not np.isfinite(array).all():
            raise BadCheckpoint(
                f"{path}: {name!r} holds numbers that are not finite; use an earlier checkpoint or train it again"
            )
    return tensors


def _read_header(folder: Path) -> dict[str, Any]:
    path = folder / CONFIG
    if not path.is_file():
        raise BadCheckpoint(f"{folder} is not a checkpoint: it has no {CONFIG}; give a folder that training wrote")
    try:
        header = read_record(path, ("format", "kind", "robot", "config", "notes", "model"), max_bytes=1 << 20)
    except BadFile as error:
        raise BadCheckpoint(str(error)) from None
    kinds = {"format": int, "kind": str, "robot": str, "config": dict, "notes": dict}
    if any(not isinstance(header.get(key), kind) for key, kind in kinds.items()):
        raise BadCheckpoint(f"{path} does not describe a checkpoint; give a folder that training wrote")
    if header["format"] != FORMAT:
        raise BadCheckpoint(
            f"{path} has checkpoint format {header['format']}, this version reads {FORMAT}; install "
            "the version that wrote it, or train again"
        )
    return header


def _unfit(given: Any, known: Any, where: str = "") -> str:
    """What of a configuration means nothing: keys that nobody knows, sizes below 0, NaN. Empty if all is well."""
    if isinstance(given, dict) and isinstance(known, dict):
        strange = sorted(set(given) - set(known))
        if strange:
            return f"unknown {where}{strange[0]!r}"
        found = (_unfit(given[key], known[key], f"{where}{key}.") for key in given)
    elif isinstance(given, list) and isinstance(known, list | tuple):
        found = (_unfit(one, other, where) for one, other in zip(given, known, strict=True))
    else:
        negative = isinstance(given, int) and given < 0
        return f"{where.rstrip('.')} is {given}" if negative or given != given else ""
    return next((wrong for wrong in found if wrong), "")


def _by(shape: tuple[int, ...]) -> str:
    return " x ".join(str(size) for size in shape) or "a single number"


def copy_checkpoint(source: Path, target: Path) -> None:
    """Copy a checkpoint's two files, whole or not at all."""
    for name, path in {MODEL: model_file(source), CONFIG: source / CONFIG}.items():  # with the last it is whole
        data = path.read_bytes()
        write_atomic(target / name, lambda stream, data=data: stream.write(data))


def beside(folder: Path, name: str) -> Path:
    """Where a checkpoint has another that it runs on: in the folder beside its own, or in its own if it is not the one
    that its neighbors use.
    """
    own = folder / name
    return own if (own / CONFIG).exists() else folder.parent / name


def used_by(folder: Path, names: Sequence[str]) -> dict[str, Path]:
    """The `checkpoint` in a folder, and those of these names that are beside it, which it may run on."""
    others = {name: beside(folder, name) for name in names}
    found = {"checkpoint": folder, **{name: other for name, other in others.items() if other != folder}}
    return {name: other for name, other in found.items() if model_file(other).exists()}
