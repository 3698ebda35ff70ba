"""Leaves the processors to the physics: torch's own threads wait for work by spinning, and would take turns with it."""

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

import torch

P = ParamSpec("P")
T = TypeVar("T")


def one_torch_thread(function: Callable[P, T]) -> Callable[P, T]:
    """Let torch compute on this thread alone; what an environment does between steps is too little to share."""

    @wraps(function)
    def alone(*args: P.args, **kwargs: P.kwargs) -> T:
        threads = torch.get_num_threads()
        if threads == 1:
            return function(*args, **kwargs)
        torch.set_num_threads(1)
        try:
            return function(*args, **kwargs)
        finally:
            torch.set_num_threads(threads)

    return alone
