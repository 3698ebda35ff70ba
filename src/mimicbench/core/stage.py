"""One folder per stage: a header that says what it was made from, items beside it, and safe resumption.

`open_stage` is called before the work and `finish` after it. Running a finished stage again does nothing; running an
interrupted one goes on with the items that are missing; a folder made with another configuration is never mixed up
with this one, and never deleted either: the user is told what differs.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mimicbench
from mimicbench.core.errors import BadFile, MimicbenchError
from mimicbench.core.files import read_json, remove_unfinished, write_json

SCHEMA = 1
HEADER = "header.json"
_DETERMINES = ("schema", "stage", "task", "seed", "config", "made_from")


@dataclass(frozen=True)
class Stage:
    """An opened stage folder."""

    folder: Path
    header: Mapping[str, Any]

    @property
    def complete(self) -> bool:
        """Whether every item was made."""
        return bool(self.header["complete"])

    @property
    def fingerprint(self) -> str:
        """A short hash of the configuration and of everything it was made from."""
        return fingerprint(self.header)

    def finish(self, **summary: Any) -> "Stage":
        """Mark the stage complete and keep its summary numbers in the header."""
        header = {**self.header, "complete": True, "summary": summary}
        write_json(self.folder / HEADER, header)
        return Stage(self.folder, header)


def fingerprint(header: Mapping[str, Any]) -> str:
    """A short hash of what determines a stage's content: stage, task, seed, configuration, inputs, schema."""
    text = json.dumps({key: header[key] for key in _DETERMINES}, sort_keys=True)
    return hashlib.blake2b(text.encode(), digest_size=8).hexdigest()


def open_stage(
    folder: Path,
    stage: str,
    task: str,
    seed: int,
    config: Mapping[str, Any],
    made_from: Mapping[str, str] | None = None,
) -> Stage:
    """Start or take up a stage. `config` is the resolved configuration as plain JSON values.

    `made_from` maps each earlier stage's name to its fingerprint. Raises MimicbenchError if the folder holds the same
    stage made from something else.
    """
    header = {
        "schema": SCHEMA,
        "stage": stage,
        "task": task,
        "seed": seed,
        "config": dict(config),
        "made_from": dict(made_from or {}),
        "mimicbench": mimicbench.__version__,
        "complete": False,
    }
    path = folder / HEADER
    if path.exists():
        found = _read_header(path)
        differs = [key for key in _DETERMINES if found[key] != json.loads(json.dumps(header[key]))]
        if differs:
            raise MimicbenchError(
                f"{folder} was made with another {' and '.join(differs)}; use another --workdir, or "
                "delete that folder to make it again"
            )
        if not found["complete"]:
            remove_unfinished(folder)
        return Stage(folder, found)
    write_json(path, header)
    return Stage(folder, header)


def read_stage(folder: Path, command: str) -> Stage:
    """An earlier stage that this one needs; `command` is what makes it.

    Raises BadFile if it is missing or unfinished.
    """
    path = folder / HEADER
    if not path.exists():
        raise BadFile(f"{folder} does not exist; run `{command}` first")
    header = _read_header(path)
    if not header["complete"]:
        raise BadFile(f"{folder} is unfinished; run `{command}` again, it goes on where it stopped")
    return Stage(folder, header)


def _read_header(path: Path) -> dict[str, Any]:
    header = read_json(path)
    if not isinstance(header, dict) or not {*_DETERMINES, "complete"} <= header.keys():
        raise BadFile(f"{path} is not the header of a stage; delete {path.parent} and make it again")
    return header
