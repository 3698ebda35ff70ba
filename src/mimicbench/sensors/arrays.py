"""What is worked out of many small operations: on the CPU by NumPy, whose calls cost a fraction of torch's."""

from typing import Any

import numpy as np
import torch


def own(*tensors: torch.Tensor) -> tuple[Any, list[Any]]:
    """The library that works with these tensors, and they as its arrays, of the same memory.

    On the CPU that is NumPy, which is quicker for few robots; and torch's arctan2 rounds by a robot's place in the
    batch. Tensors that hold no numbers, with which an exporter finds out what is worked out, stay torch's.
    """
    plain = tensors[0].device.type == "cpu" and type(tensors[0]) is torch.Tensor
    return (np, [each.numpy() for each in tensors]) if plain else (torch, list(tensors))


def tensor(xp: Any, array: Any) -> torch.Tensor:
    """The inverse of `own`, of one array."""
    return torch.from_numpy(array) if xp is np else array


def along_robots(xp: Any, array: Any) -> Any:
    """The same array (N, K, C), with each number of all robots side by side in memory: work then runs along them."""
    return np.ascontiguousarray(array.T).T if xp is np else array.transpose(0, 2).contiguous().transpose(0, 2)
