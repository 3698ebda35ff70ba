"""The panel in which items are found and opened."""

from __future__ import annotations

import random
from collections.abc import Mapping, Sequence
from typing import Any

from mimicbench.core.errors import MimicbenchError
from mimicbench.tasks.registry import TASKS
from mimicbench.viewer.catalog import ANY, FAILED, KINDS, Catalog, ItemSet
from mimicbench.viewer.markdown import plain
from mimicbench.viewer.opened import open_item
from mimicbench.viewer.session import Session

SHOWN = 60
"""Names that the list has at a time: browsers take long over more."""
STEPS = ("Previous", "Next", "Random")


class BrowsePanel:
    """Task, kind, set, outcome of episodes, words to find, item."""

    def __init__(self, session: Session, catalog: Catalog) -> None:
        self.session, self.catalog = session, catalog
        gui, on = session.server.gui, session.safely
        tasks = catalog.tasks()
        with gui.add_folder("Browse", order=1.0):
            self.task = gui.add_dropdown("Task", tasks)
            self.kind = gui.add_dropdown("Kind", [KINDS[kind] for kind in catalog.kinds(tasks[0])])
            self.set = gui.add_dropdown("Set", [" "])
            self.outcome = gui.add_dropdown("Outcome", [ANY], hint="how episodes ended", visible=False)
            self.words = gui.add_text("Find", "", hint="words that the name has")
            self.item = gui.add_dropdown("Item", [" "])
            self.steps = gui.add_button_group("Go to", STEPS)
            self.facts = gui.add_markdown("")
            with gui.add_folder("Details", expand_by_default=False):
                self.details = gui.add_markdown("")
        self._found: list[str] = []
        self._ignoring = False
        self.task.on_update(on(lambda event: self._fill("kind")))
        self.kind.on_update(on(lambda event: self._fill("set")))
        self.set.on_update(on(lambda event: self._fill("item")))
        self.outcome.on_update(on(lambda event: self._fill("item")))
        self.words.on_update(on(lambda event: self._fill("item")))
        self.item.on_update(on(lambda event: self._open()))
        self.steps.on_click(on(lambda event: self._step(str(event.target.value))))

    def start(self, task: str | None, kind: str | None, words: str) -> None:
        """Open the first item of a task and a kind, whose name has some words."""
        if task is not None:
            self._choose(self.task, self.catalog.tasks(), task)
        kinds = self.catalog.kinds(str(self.task.value))
        kind = kind if kind in kinds else "retarget" if "retarget" in kinds else kinds[0]
        self._choose(self.kind, [KINDS[one] for one in kinds], KINDS[kind])
        self._ignoring = True
        self.words.value = words
        self._ignoring = False
        self._fill("set")

    def start_failed(self, task: str | None, words: str, networks: Sequence[Mapping[str, Any]]) -> None:
        """Open the first episode that failed, of a task or of any, and of who runs on some of these networks if there
        is one.
        """
        found = self.catalog.failed(task, words, networks)
        if found is not None:
            task = found.task
            names = [one.name for one in self.catalog.sets(task, found.kind)]
            self._choose(self.set, names, found.name)
        self._choose(self.outcome, [ANY, FAILED], FAILED)
        self.start(task, "evaluate", words)

    @property
    def current(self) -> ItemSet:
        """The set that is chosen."""
        kind = next(kind for kind, words in KINDS.items() if words == self.kind.value)
        return self.catalog.named(str(self.task.value), kind, str(self.set.value))

    def _fill(self, what: str) -> None:
        """Bring a list up to date after what stands above it has changed, and those below it."""
        if self._ignoring:
            return
        task = str(self.task.value)
        if what == "kind":
            kinds = [KINDS[kind] for kind in self.catalog.kinds(task)]
            self._choose(self.kind, kinds, str(self.kind.value))
        if what in ("kind", "set"):
            kind = next(kind for kind, words in KINDS.items() if words == self.kind.value)
            names = [one.name for one in self.catalog.sets(task, kind)]
            self._choose(self.set, names, str(self.set.value))
        self.outcome.visible = self.current.kind == "evaluate"
        # who cannot see the box cannot change it
        came_to = str(self.outcome.value) if self.outcome.visible else ANY
        self._choose(self.outcome, self.current.outcomes, came_to)
        self._found = self.current.matching(str(self.words.value), str(self.outcome.value))
        self._choose(self.item, self._found[:SHOWN] or [" "], str(self.item.value))
        self._open()

    def _choose(self, dropdown: Any, options: list[str], value: str) -> None:
        """Give a list other options, and one of them."""
        self._ignoring = True
        dropdown.options = options
        dropdown.value = value if value in options else options[0]
        self._ignoring = False

    def _open(self) -> None:
        item = str(self.item.value)
        if self._ignoring:
            return
        if item not in self._found:
            lacks = [f"is {self.outcome.value!r}"] if self.outcome.value != ANY else []
            lacks += [f"has {self.words.value!r} in its name"] if self.words.value else []
            self.facts.content, self.details.content = f"*nothing {' and '.join(lacks) or 'is here'}*", ""
            self.session.empty()
            return
        place = f"**{plain(item)}** · {self._found.index(item) + 1} of {len(self._found)}"
        try:
            opened = open_item(self.catalog, self.current, item)
        except MimicbenchError as error:  # one that is damaged keeps nobody from the others
            self.facts.content, self.details.content = f"{place}\n\ncannot be shown: {plain(str(error))}", ""
            self.session.empty()
            return
        self.session.open(opened)
        lines = [TASKS.get(str(self.task.value)).title, *opened.facts]
        self.facts.content = "\n".join([place, "", *(f"- {plain(line)}" for line in lines)])
        self.details.content = "\n".join(f"- {plain(line)}" for line in opened.details) or "*nothing more is known*"

    def _step(self, step: str) -> None:
        if not self._found:
            return
        item = str(self.item.value)
        place = self._found.index(item) if item in self._found else 0
        count = len(self._found)
        place = random.randrange(count) if step == STEPS[2] else (place + (1 if step == STEPS[1] else -1)) % count
        first = min(max(0, place - SHOWN // 2), max(0, count - SHOWN))
        self._choose(self.item, self._found[first : first + SHOWN], self._found[place])
        self._open()
