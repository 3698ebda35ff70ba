"""One folder per stage: a header that says what it was made from, items beside it, a lock, and safe resumption.

What a stage is, its StageKey says: everything that determines its items, the keys of the stages before it included. The
folder's name carries the key's digest, so stages of several recipes stand side by side and are shared where they are
the same. How much of it there is, its amounts, is no part of the name: a stage that has less than is asked for goes on.

A release of this package that makes other items from the same key raises SCHEMA; until then, what another version made
is used, and the header says which version that was.
"""

import fcntl
import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import mimicbench
from mimicbench.core.errors import BadFile, MimicbenchError
from mimicbench.core.files import read_record, remove_unfinished, write_record

SCHEMA = 2
HEADER = "header.json"
_DETERMINES = ("schema", "stage", "task", "seed", "settings", "made_from")
_WORDS = {"task": "tasks", "seed": "seeds", "settings": "settings or files", "made_from": "stages before it"}
_WORDS |= {"schema": "versions of its format", "stage": "stages"}
_NEEDED = {*_DETERMINES, "amounts", "raised_from", "complete", "summary"}
_TOLD = {"reads", "recipe", "mimicbench", "items"}


@dataclass(frozen=True)
class StageKey:
    """What determines a stage, and how much of it is wanted."""

    stage: str
    task: str
    seed: int
    settings: Mapping[str, Any]
    """Plain JSON values: the stage's part of the recipe, without amounts."""
    made_from: Mapping[str, str] = field(default_factory=dict)
    """Name of each stage that it reads -> that stage's digest, or fingerprint where the amount counts, too."""
    amounts: Mapping[str, int | float] = field(default_factory=dict)
    """How much is wanted, by name."""
    words: tuple[str, ...] = ()
    """What the folder is called before the digest; determines nothing."""
    reads: Mapping[str, Path] = field(default_factory=dict)
    """Folders of the stages that it reads, for whoever follows an artefact back; determine nothing."""

    @property
    def digest(self) -> str:
        """Eight hex digits of what determines the items."""
        return _digest(_header(self, None, ()))

    @property
    def fingerprint(self) -> str:
        """Of what determines the items and how many are wanted: as the Stage's own, if it was made in one go."""
        return _digest(_header(self, None, ()), ("amounts", "raised_from"))

    def folder(self, workdir: Path) -> Path:
        """`<workdir>/<task>/<stage>/<words>-<digest>`."""
        return workdir / self.task / self.stage / "-".join([*self.words, self.digest])


@dataclass(frozen=True)
class Stage:
    """An opened stage folder."""

    folder: Path
    header: Mapping[str, Any]
    """As wanted: its amounts are those that were asked for, also where the folder has more."""
    ahead: bool = False
    """The folder holds more than is wanted, so its header is somebody else's: nothing is written to it."""

    @property
    def complete(self) -> bool:
        """Whether every wanted item is there, and the summary is about them alone."""
        return bool(self.header["complete"])

    @property
    def summary(self) -> Mapping[str, Any]:
        """What the stage came to."""
        return self.header["summary"]

    @property
    def digest(self) -> str:
        """Of what determines the items, whatever their number."""
        return _digest(self.header)

    @property
    def fingerprint(self) -> str:
        """Of what determines the items, and of how many there are."""
        return _digest(self.header, ("amounts", "raised_from"))

    def finish(self, **summary: Any) -> "Stage":
        """Everything that was wanted is there; keep the stage's summary numbers in the header."""
        header = {**self.header, "complete": True, "summary": summary, "items": _items(self.folder)}
        if not self.ahead:
            write_record(self.folder / HEADER, header)
        return replace(self, header=header)


@contextmanager
def opened(
    folder: Path, key: StageKey, recipe: Mapping[str, Any] | None = None, trained: bool = False
) -> Iterator[Stage]:
    """Start or take up a stage and hold it for this program alone, unless it is complete.

    Args:
        folder: Where it is.
        key: What it is, and how much is wanted.
        recipe: The resolved recipe, for the header.
        trained: The amounts are of a training, which cannot be had smaller than it has become; one that was raised
            on its way is told from one that was not.

    Raises:
        MimicbenchError: The folder holds something else, more of a training than is wanted, or another program works
            in it.
    """
    found = _take_up(folder, key, recipe, trained)
    if found is not None and found.complete:
        yield found
        return
    made = [path for path in (folder, *folder.parents) if not path.exists()]
    held = False
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with locked(folder):
            held = True
            stage = _take_up(folder, key, recipe, trained)
            if stage is None:
                stage = Stage(folder, _header(key, recipe, ()))
            if not stage.complete:
                remove_unfinished(folder)
            if not (stage.complete or stage.ahead):
                write_record(folder / HEADER, stage.header)
            yield stage
    except MimicbenchError:
        # not what another program has begun meanwhile
        if held and made and {path.name for path in folder.glob("*")} <= {HEADER}:
            (folder / HEADER).unlink(missing_ok=True)
            _remove_empty(made)
        raise


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold a folder for this program alone; the system gives it back when the program ends, however it ends.

    Raises MimicbenchError if another program holds it.
    """
    handle = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise MimicbenchError(
                f"another program is working in {folder}; wait until it has ended, or use another --workdir"
            ) from None
        yield
    finally:
        os.close(handle)


def read_stage(folder: Path, whole: bool = True) -> Stage:
    """A finished stage as it is. Raises BadFile if it is missing, unfinished or no stage; or if it lacks files, where
    it is needed `whole`.
    """
    if not (folder / HEADER).exists():
        raise BadFile(f"{folder} holds no stage")
    header = _read_header(folder)
    if not header["complete"]:
        raise BadFile(f"{folder} is unfinished; the command that makes it goes on where it stopped")
    if whole and (missing := _missing(folder, header)):
        raise BadFile(
            f"{folder} lacks {missing} of its {header['items']} files; give the command that made it once more"
        )
    return Stage(folder, header)


def is_complete(folder: Path) -> bool:
    """Whether a finished stage is there, with however much it has."""
    try:
        read_stage(folder)
    except BadFile:
        return False
    return True


def _take_up(folder: Path, key: StageKey, recipe: Mapping[str, Any] | None, trained: bool) -> Stage | None:
    """What is there already, as wanted; None if there is nothing."""
    if not (folder / HEADER).exists():
        return None
    found = _read_header(folder)
    wanted = _header(key, recipe, tuple(found["raised_from"]))
    differs = [name for name in _DETERMINES if found[name] != wanted[name]]
    if differs:
        # a folder that is not called by its digest is a set to which somebody gave a name
        hint = "" if folder.name.endswith(key.digest) else "give another name (--to), "
        raise MimicbenchError(
            f"{folder} was made with other {' and '.join(_WORDS[name] for name in differs)}; {hint}use another "
            "--workdir, or delete that folder to make it again"
        )
    have, want = found["amounts"], wanted["amounts"]
    if have == want:
        return Stage(folder, wanted if _missing(folder, found) else found)  # what is gone is made again
    if all(have.get(name, 0) >= amount for name, amount in want.items()):
        if trained and not found["complete"]:
            raise MimicbenchError(
                f"{folder} was begun for {_told(have, want)} and is unfinished; ask for as much to go on, which may be "
                "stopped at any time, or use another --workdir"
            )
        if trained:
            raise MimicbenchError(
                f"{folder} has been trained for {_told(have, want)}, more than the {_told(want, have)} that are asked "
                "for; ask for as much, or use another --workdir"
            )
        # of what was stopped on its way to more, less may be finished
        return Stage(folder, wanted, ahead=bool(found["complete"]))
    if trained:
        wanted["raised_from"] = [*found["raised_from"], have]
    return Stage(folder, wanted)


def _header(key: StageKey, recipe: Mapping[str, Any] | None, raised_from: tuple[Any, ...]) -> dict[str, Any]:
    header = {
        "schema": SCHEMA,
        "stage": key.stage,
        "task": key.task,
        "seed": key.seed,
        "settings": dict(key.settings),
        "made_from": dict(key.made_from),
        "amounts": dict(key.amounts),
        "raised_from": list(raised_from),
        "reads": {name: str(Path(*folder.parts[-2:])) for name, folder in key.reads.items()},
        "recipe": dict(recipe or {}),
        "mimicbench": mimicbench.__version__,
        "complete": False,
        "summary": {},
    }
    return json.loads(json.dumps(header))  # as it will be read again: tuples become lists


def _read_header(folder: Path) -> dict[str, Any]:
    header = read_record(folder / HEADER, (*_NEEDED, *_TOLD))
    header.setdefault("reads", {})
    if not header.keys() >= _NEEDED or not isinstance(header["reads"], dict):
        raise BadFile(f"{folder / HEADER} is not the header of a stage; delete {folder} and make it again")
    return header


def _digest(header: Mapping[str, Any], more: tuple[str, ...] = ()) -> str:
    text = json.dumps({name: header[name] for name in (*_DETERMINES, *more)}, sort_keys=True)
    return hashlib.blake2b(text.encode(), digest_size=8 if more else 4).hexdigest()


def _items(folder: Path) -> int:
    """How many files with an item each are there."""
    return sum(path.suffix in (".npz", ".json") and path.name != HEADER for path in folder.iterdir())


def _missing(folder: Path, header: Mapping[str, Any]) -> int:
    """How many items are no longer there."""
    return max(0, header.get("items", 0) - _items(folder))


def _told(amounts: Mapping[str, int | float], among: Mapping[str, int | float]) -> str:
    """Those amounts that are not the same as others."""
    differ = {name: amount for name, amount in amounts.items() if among.get(name) != amount}
    return " and ".join(f"{amount} {name.rpartition('.')[2]}" for name, amount in differ.items())


def _remove_empty(folders: list[Path]) -> None:
    """Remove folders, innermost first, as far as they are empty: a refused call leaves nothing behind."""
    for folder in folders:
        try:
            folder.rmdir()
        except OSError:
            return
