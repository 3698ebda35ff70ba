"""What there is to look at in a workdir. Only names are listed; no item is read before somebody opens it."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mimicbench.benchmark.who import networks_of
from mimicbench.core.errors import BadFile
from mimicbench.core.files import read_record
from mimicbench.core.names import typed
from mimicbench.core.stage import HEADER
from mimicbench.tasks.registry import TASKS

if TYPE_CHECKING:
    from mimicbench.evaluate.rows import EpisodeRow

SUFFIX = {"objects": ".json", "references": ".npz", "retarget": ".npz"}
"""What files of items end in."""
KINDS = {
    "objects": "objects",
    "references": "human references",
    "retarget": "retargeted clips",
    "demos": "demonstrations",
    "evaluate": "episodes",
}
"""Folder of a kind of items -> what they are called."""
ROWS = ".parquet"
ANY, FAILED = "any", "failed"
"""Which episodes are listed: all, those that failed, or (a word of `evaluate.failures.FAILURES`) failed in one way."""


@dataclass(frozen=True)
class ItemSet:
    """Items of one kind that were made together."""

    task: str
    kind: str
    path: Path
    """A stage's folder; of episodes a file of rows."""

    @property
    def name(self) -> str:
        """Such as `made-eb482617`."""
        return self.path.stem if self.kind == "evaluate" else self.path.name

    @cached_property
    def items(self) -> tuple[str, ...]:
        """Names of all items, in order."""
        if self.kind == "demos":
            from mimicbench.imitate.lerobot import DATASET, episode_rows

            rows = episode_rows(self.path / DATASET)
            return tuple(f"{row['episode_index']:05d} {row['reference_id']}" for row in rows)
        if self.kind == "evaluate":
            return tuple(f"{row.id} {outcome(row)}" for row in self.rows)
        suffix = SUFFIX[self.kind]
        with os.scandir(self.path) as entries:
            names = [entry.name for entry in entries if entry.name.endswith(suffix) and entry.name != HEADER]
        return tuple(sorted(name.removesuffix(suffix) for name in names if not name.startswith(".")))

    @cached_property
    def places(self) -> dict[str, int]:
        """Place of each item in `items`."""
        return {name: place for place, name in enumerate(self.items)}

    @cached_property
    def rows(self) -> list[EpisodeRow]:
        """Of episodes. Raises BadFile."""
        from mimicbench.evaluate.rows import read_rows

        return read_rows(self.path)

    @cached_property
    def made_from(self) -> dict[str, Any]:
        """Of episodes: what their rows depend on, networks and clips by their digests; empty if they do not say."""
        from mimicbench.evaluate.rows import rows_made_from

        return rows_made_from(self.path)

    @cached_property
    def failures(self) -> dict[str, str]:
        """Of episodes: the items that failed, and how. Raises BadFile."""
        from mimicbench.evaluate.failures import failure

        if self.kind != "evaluate":
            return {}
        return {item: how for item, row in zip(self.items, self.rows, strict=True) if (how := failure(row))}

    @property
    def outcomes(self) -> list[str]:
        """What episodes can be picked by: `any`, `failed`, and every way in which one failed, the most usual first."""
        return [ANY, FAILED, *(how for how, _ in Counter(self.failures.values()).most_common())]

    @cached_property
    def header(self) -> dict[str, Any]:
        """Of a stage, finished or not: what is in it is whole. Raises BadFile."""
        return read_record(self.path / HEADER)

    def file(self, item: str) -> Path:
        """The file of an item. Raises BadFile for a name that is not in the list: it may come from a file's header,
        and lead anywhere.
        """
        if item not in self.places:
            raise BadFile(f"{self.path} has no {item!r}; make it again, or open the page anew if it was just made")
        return self.path / f"{item}{SUFFIX[self.kind]}"

    def matching(self, words: str, outcome: str = ANY) -> list[str]:
        """Names of the items in which all these words are, in any case, and which came to an outcome."""
        wanted = words.lower().split()
        picked = [
            name
            for name in self.items
            if outcome == ANY or (name in self.failures and outcome in (FAILED, self.failures[name]))
        ]
        return [name for name in picked if all(word in name.lower() for word in wanted)]


@dataclass(frozen=True)
class Catalog:
    """The sets of items in a workdir."""

    workdir: Path
    _known: dict[Path, tuple[int, ItemSet]] = field(default_factory=dict, repr=False)
    """Sets that have been listed, with the time of their last change."""

    def __post_init__(self) -> None:
        if not self.workdir.is_dir():
            raise BadFile(
                f"{self.workdir} does not exist; give the --workdir of a run, or make one with `mimicbench run`"
            )
        if not self.tasks():
            raise BadFile(
                f"{self.workdir} holds nothing to look at; run `mimicbench retarget --workdir {typed(self.workdir)}`"
            )

    def tasks(self) -> list[str]:
        """Tasks of which there is something."""
        return [task for task in TASKS if any(self.sets(task, kind) for kind in KINDS)]

    def kinds(self, task: str) -> list[str]:
        """Kinds of items that a task has."""
        return [kind for kind in KINDS if self.sets(task, kind)]

    def sets(self, task: str, kind: str) -> list[ItemSet]:
        """The sets of a kind, in order of their names."""
        folder = self.workdir / task / kind
        if kind == "evaluate":
            paths = sorted(folder.glob(f"*{ROWS}"))
        else:
            paths = sorted(path.parent for path in folder.glob(f"*/{HEADER}"))
        return [self._set(task, kind, path) for path in paths]

    def failed(self, task: str | None, words: str, networks: Sequence[Mapping[str, Any]]) -> ItemSet | None:
        """The first set, of a task or of any, with an episode that failed and whose name has these words: one of who
        runs on some of these networks, or else of anybody. None if there is none; what is damaged is passed over.
        """
        sets = [one for name in self.tasks() if task in (None, name) for one in self.sets(name, "evaluate")]
        for theirs in (True, False) if networks else (False,):
            for one in sets:
                with suppress(BadFile):
                    if (not theirs or networks_of(one.made_from) in networks) and one.matching(words, FAILED):
                        return one
        return None

    def named(self, task: str, kind: str, name: str) -> ItemSet:
        """The set of a name. Raises BadFile."""
        for one in self.sets(task, kind):
            if one.name == name:
                return one
        raise BadFile(f"{self.workdir / task} has no {KINDS[kind]} called {name!r}; make them again")

    def read_by(self, one: ItemSet, kind: str) -> ItemSet:
        """The set that a stage was made from. Raises BadFile if it is gone.

        A header may come from anywhere, so that what it names is looked for among what there is.
        """
        folder = str(one.header.get("reads", {}).get(kind, ""))
        return self.named(one.task, kind, folder.rpartition("/")[2])

    def _set(self, task: str, kind: str, path: Path) -> ItemSet:
        changed = path.stat().st_mtime_ns
        if self._known.get(path, (0, None))[0] != changed:
            self._known[path] = changed, ItemSet(task, kind, path)
        return self._known[path][1]


def outcome(row: EpisodeRow) -> str:
    """What an episode came to, in a few words, such as `policy: K at 7.3 s, did not stay, fell after success`."""
    from mimicbench.evaluate.failures import failure

    told, how = [], failure(row)
    if row.success:
        told.append("K" if row.first_success_time is None else f"K at {row.first_success_time:.1f} s")
    if how and not how.startswith("fell"):  # falls are told below, with what the robot was at
        told.append(how)
    if row.fell:
        told.append(f"fell {'' if row.fell_phase.startswith('after') else 'while '}{row.fell_phase}")
    return f"{row.policy}: {', '.join(told)}"
