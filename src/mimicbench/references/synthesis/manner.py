"""Who chooses what a clip leaves open: chance, or nobody, so that everybody does it in the same way."""

from typing import Any

import numpy as np


class Middle(np.random.Generator):
    """Draws the middle of what could be drawn, and of what can be chosen the most frequent, or else the first.

    Clips whose styles it draws are alike: what is done in them follows from the start and the object alone. Who has to
    learn from them what to do next, and is not told a style, has nothing to guess.
    """

    def __init__(self) -> None:
        super().__init__(np.random.PCG64(0))

    def uniform(self, low: Any = 0.0, high: Any = 1.0, size: Any = None) -> Any:
        """The middle between both bounds."""
        middle = (np.asarray(low) + np.asarray(high)) / 2
        return float(middle) if size is None else np.full(size, middle)

    def standard_normal(self, size: Any = None, *_: Any, **__: Any) -> Any:
        """The mean."""
        return 0.0 if size is None else np.zeros(size)

    def integers(self, low: Any, high: Any = None, size: Any = None, *_: Any, **__: Any) -> Any:
        """The first that could be drawn."""
        first = 0 if high is None else int(low)
        return first if size is None else np.full(size, first)

    def choice(self, a: Any, size: Any = None, replace: bool = True, p: Any = None, *_: Any, **__: Any) -> Any:
        """The most probable one, so often."""
        things = np.arange(a) if np.ndim(a) == 0 else np.asarray(a)
        best = things[0 if p is None else int(np.argmax(p))]
        return best if size is None else np.full(size, best)

    def permutation(self, x: Any, *_: Any, **__: Any) -> Any:
        """As it is."""
        return np.arange(x) if np.ndim(x) == 0 else np.asarray(x)


def manner(random: np.random.Generator, alike: bool) -> np.random.Generator:
    """What draws a clip's style: `random`, or the middle of all if everybody is to be alike."""
    return Middle() if alike else random
