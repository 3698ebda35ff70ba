"""How checkpoints of one kind become policies."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from mimicbench.envs.policy import Policy
from mimicbench.robots.description import Robot
from mimicbench.tasks.task import Task


@dataclass(frozen=True)
class Loader:
    """Reads the checkpoints of one kind."""

    name: str
    """The kind, as in `config.json`."""
    load: Callable[[Path, Robot, Task], Policy]
    """From the checkpoint's folder. Raises BadCheckpoint."""
    exports: bool = False
    """Whether these policies say what they remember (policies.export.Remembers), and so can be ONNX files."""
