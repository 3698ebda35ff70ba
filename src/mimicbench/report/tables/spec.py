"""What a table is made of: judged episodes, and a function that makes rows of cells of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property

from mimicbench.core.errors import BadObject, MimicbenchError, UnknownName
from mimicbench.evaluate.rows import EpisodeRow, Summary, group, summarize
from mimicbench.objects.registry import make_object
from mimicbench.objects.shape import SceneObject
from mimicbench.report.paper_tables import TASKS
from mimicbench.report.table import Table


@dataclass(frozen=True)
class Episodes:
    """Judged episodes, of which tables tell."""

    rows: tuple[EpisodeRow, ...]
    """In any order."""
    known: Mapping[str, SceneObject] = field(default_factory=dict)
    """Objects by id that whoever asks has at hand."""

    @cached_property
    def by_task(self) -> tuple[Episodes, ...]:
        """Those of each task."""
        tasks = dict.fromkeys(row.task for row in self.rows)
        if len(tasks) == 1:
            return (self,)
        return tuple(Episodes(tuple(row for row in self.rows if row.task == task), self.known) for task in tasks)

    @cached_property
    def methods(self) -> tuple[tuple[Summary, tuple[EpisodeRow, ...]], ...]:
        """Each method on each task, its rates and episodes: policies, then trackers, who stays most often first."""
        found = [(summarize(rows), tuple(rows)) for rows in group(self.rows).values()]
        return tuple(sorted(found, key=lambda one: _order(one[0])))

    @property
    def summaries(self) -> list[Summary]:
        """The rates of all methods in this order."""
        return [summary for summary, _ in self.methods]

    @property
    def ordered(self) -> list[EpisodeRow]:
        """The episodes of all methods in this order."""
        return [row for _, rows in self.methods for row in rows]

    @cached_property
    def objects(self) -> dict[str, SceneObject]:
        """The episodes' objects by id: those at hand, others made again. Own meshes that nobody has are missing."""
        found = {}
        for name in dict.fromkeys(row.object_id for row in self.rows):
            with suppress(BadObject, UnknownName):
                found[name] = self.known[name] if name in self.known else make_object(name)
        return found


def _of_task(table: Table, episodes: Episodes) -> Table:
    """The same table with its task in name and title, where there are others like it."""
    task = episodes.rows[0].task
    told = table.title.endswith(f"({TASKS.get(task, task)})")
    return replace(table, name=f"{table.name}-{task}", title=table.title if told else f"{table.title} ({task})")


def _order(s: Summary) -> tuple[bool, float, float, float, str, str]:
    # K is fulfilled by who is gone a moment later, too
    return s.stage != "imitate", -s.stays.rate, -s.kinematic.rate, -s.energy.rate, s.policy, s.preset


@dataclass(frozen=True)
class TableSpec:
    """A table, before there are episodes to make it of."""

    name: str
    what: str
    """What it shows, in one line."""
    make: Callable[[Episodes], Sequence[Table]]
    """One table, or several; none where the episodes have nothing for it. They are called `name`, or `name-...`."""
    per_task: bool = True
    """Whether it is of one task's episodes, as those of reports are, or of the episodes of all tasks together."""

    def of(self, episodes: Episodes) -> list[Table]:
        """The tables of these episodes: of each task by itself, which several name, or of all tasks. Raises
        MimicbenchError.
        """
        parts = episodes.by_task if self.per_task else (episodes,)
        several = len(parts) > 1
        made = [_of_task(table, part) if several else table for part in parts for table in self.make(part)]
        for table in made:
            if table.name != self.name and not table.name.startswith(f"{self.name}-"):
                raise MimicbenchError(
                    f"table {self.name!r} makes one that calls itself {table.name!r}; "
                    f"call it {self.name!r}, or {self.name + '-...'!r} if there are several"
                )
        return made
