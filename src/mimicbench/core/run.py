"""How a program runs: never part of what its results are."""

import sys
from collections.abc import Callable
from dataclasses import dataclass

from mimicbench.core.errors import MimicbenchError
from mimicbench.core.names import printable

MOST_WORKERS = 4096


def to_stderr(line: str) -> None:
    """Progress goes to stderr, so that stdout holds results alone."""
    print(printable(line, lines=True), file=sys.stderr, flush=True)


@dataclass(frozen=True)
class RunContext:
    """What a stage is given beside its inputs. Results do not depend on it (networks that learn on a GPU excepted)."""

    workers: int = 0
    """Threads or processes; 0 for all processors."""
    device: str = "cpu"
    """What computes the physics, and where networks learn and judge: `cpu`, `cuda`, `cuda:1` or `warp-cpu`."""
    quiet: bool = False
    """No progress bars."""
    say: Callable[[str], None] = to_stderr
    """Hears, in single lines, what is going on."""

    def __post_init__(self) -> None:
        if not 0 <= self.workers <= MOST_WORKERS:
            raise MimicbenchError(f"--workers is {self.workers}; give 1 to {MOST_WORKERS}, or 0 for all processors")
