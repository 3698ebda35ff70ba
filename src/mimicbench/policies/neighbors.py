"""A policy's file and the rest of the program, each as if the other were not there.

What it imports from beside it is there while it runs, and gone while others do: two policies may each have a
`helper.py`, and Python keeps modules by name alone. It has random numbers of its own, the same in every run, and a
default precision of its own. What it prints goes to stderr, for stdout may be read by a program.
"""

import contextlib
import copy
import os
import random
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import torch
from torch import Tensor

from mimicbench.core.errors import INSTALLED, STANDARD
from mimicbench.envs.policy import Policy
from mimicbench.sensors.observations import Observations

SEED = 0
"""Of the random numbers that policies of files draw without seeding any."""
_RUNNING: list["Neighbors"] = []
"""Whose modules are there: the last one's, which a policy of the one before it may have called."""


class Neighbors:
    """The modules in a policy's folder, and in those that it adds to the path itself."""

    def __init__(self, folder: Path) -> None:
        self._folder = str(folder.resolve())
        self._path = [self._folder]
        self._modules: dict[str, ModuleType] = {}
        self._world: _World | None = None

    @contextmanager
    def there(self) -> Iterator[None]:
        """They can be imported, and those that have been are as the policy left them."""
        outer = _RUNNING[-1] if _RUNNING else None
        if outer is not None:
            outer._leave()
        self._enter()
        _RUNNING.append(self)
        try:
            with contextlib.redirect_stdout(sys.stderr):
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
        self._outside, grads, threads = _World.now(), torch.is_grad_enabled(), torch.get_num_threads()
        self._computing = grads, threads
        (self._world or _World.fresh()).put()

    def _leave(self) -> None:
        self._world = _World.now()
        self._outside.put()
        grads, threads = self._computing
        torch.set_grad_enabled(grads)
        if torch.get_num_threads() != threads:
            torch.set_num_threads(threads)
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


@dataclass(frozen=True)
class _World:
    """What libraries keep for a whole program: where their random numbers have come to, and the default precision."""

    of_torch: Tensor
    of_numpy: Any
    of_python: Any
    precision: torch.dtype

    @staticmethod
    def now() -> "_World":
        """As it is."""
        return _World(torch.get_rng_state(), np.random.get_state(), random.getstate(), torch.get_default_dtype())

    @staticmethod
    def fresh() -> "_World":
        """As it is when a policy begins; the world stays as it is."""
        return _World(
            torch.Generator().manual_seed(SEED).get_state(),
            np.random.RandomState(SEED).get_state(),
            random.Random(SEED).getstate(),
            torch.float32,
        )

    def put(self) -> None:
        """Make it the present one."""
        torch.set_rng_state(self.of_torch)
        np.random.set_state(self.of_numpy)
        random.setstate(self.of_python)
        torch.set_default_dtype(self.precision)


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
