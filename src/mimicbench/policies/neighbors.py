"""What a policy's file imports from beside it: there while the policy runs, and gone while others do.

Two policies may each have a `helper.py`. Python keeps modules by name alone, so the second would get the first one's.
"""

import copy
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

from torch import Tensor

from mimicbench.core.errors import INSTALLED, STANDARD
from mimicbench.envs.policy import Policy
from mimicbench.sensors.observations import Observations

_RUNNING: list["Neighbors"] = []
"""Whose modules are there: the last one's, which a policy of the one before it may have called."""


class Neighbors:
    """The modules in a policy's folder, and in those that it adds to the path itself."""

    def __init__(self, folder: Path) -> None:
        self._folder = str(folder.resolve())
        self._path = [self._folder]
        self._modules: dict[str, ModuleType] = {}

    @contextmanager
    def there(self) -> Iterator[None]:
        """They can be imported, and those that have been are as the policy left them."""
        outer = _RUNNING[-1] if _RUNNING else None
        if outer is not None:
            outer._leave()
        self._enter()
        _RUNNING.append(self)
        try:
            yield
        finally:
            _RUNNING.pop()
            self._leave()
            if outer is not None:
                outer._enter()

    def _enter(self) -> None:
        self._before, sys.path[:0] = sys.path.copy(), self._path
        self._aside = {name: sys.modules.pop(name) for name in self._modules if name in sys.modules}
        self._known = sys.modules.copy()  # cheaper than the set of its names
        sys.modules.update(self._modules)

    def _leave(self) -> None:
        added = set(sys.path) - set(self._before) | {self._folder}
        self._path = [place for place in dict.fromkeys(sys.path) if place in added]
        new = [name for name in sys.modules.keys() - self._known.keys() if self._own(name)]
        self._modules = {name: sys.modules[name] for name in new}
        for name in new:
            del sys.modules[name]
        sys.modules.update(self._aside)
        sys.path[:] = self._before

    def _own(self, name: str) -> bool:
        """Whether a new module is the policy's: no library, which everyone shares, and some cannot be loaded twice."""
        whole = name.partition(".")[0]
        if name in self._modules or whole in self._known or whole not in sys.modules:
            return name in self._modules
        module, folders = sys.modules[whole], {os.path.abspath(place) for place in self._path}
        places = [getattr(module, "__file__", None), *getattr(module, "__path__", ())]
        return any(
            os.path.dirname(place) in folders and not INSTALLED.search(place) and not place.startswith(STANDARD)
            for place in places
            if isinstance(place, str)
        )


class AmongNeighbors:
    """A policy of a Python file, which finds its neighbors whenever it is called."""

    def __init__(self, policy: Policy, neighbors: Neighbors) -> None:
        self.observations: tuple[str, ...] = policy.observations
        self.gains = policy.gains
        self._policy, self._neighbors = policy, neighbors
        if hasattr(policy, "drove"):  # no method of the class: not every policy is one that can be corrected
            self.drove = self._drove

    def to(self, device: str) -> None:
        """Move to a device."""
        with self._neighbors.there():
            self._policy.to(device)

    def reset(self, ids: Tensor, obs: Observations) -> None:
        """Robots `ids` (M,) begin anew."""
        with self._neighbors.there():
            self._policy.reset(ids, obs)

    def act(self, obs: Observations) -> Tensor:
        """Joint position targets (N, J) [rad]."""
        with self._neighbors.there():
            return self._policy.act(obs)

    def _drove(self, target: Tensor) -> None:
        with self._neighbors.there():
            self._policy.drove(target)  # pyright: ignore[reportAttributeAccessIssue]

    def __deepcopy__(self, memo: dict[int, Any]) -> "AmongNeighbors":
        """With the same modules, which cannot be copied."""
        with self._neighbors.there():
            return AmongNeighbors(copy.deepcopy(self._policy, memo), self._neighbors)
