"""What an observation is: a name, a shape, and how it is worked out."""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from mimicbench.robots.description import Robot
from mimicbench.sensors.context import StepContext
from mimicbench.tasks.task import Task

BOUND = 1000.0
"""Observations beyond this are out of every space; no robot that is still in one piece comes near it."""


@dataclass(frozen=True)
class Term:
    """One thing that N robots can observe."""

    name: str
    """As policies, trackers and environments ask for it."""
    shape: Callable[[Robot, Task], tuple[int, ...]]
    """Of one robot's part."""
    compute: Callable[[StepContext], Tensor]
    """(N, *shape)."""
    privileged: bool = False
    """Whether no robot can know it: simulators and trainers only."""
    exists: Callable[[Task], bool] = lambda task: True
    """Whether the task has it."""
    some: Callable[[StepContext, Tensor], Tensor] | None = None
    """(n, *shape) of robots (n,) alone, if that is cheaper than picking them out of all."""
    turns: tuple[int, ...] = ()
    """Where in it rotation vectors begin: half a turn is the same to the left and to the right."""
    low: float = -BOUND
    high: float = BOUND
    dtype: torch.dtype = torch.float32
