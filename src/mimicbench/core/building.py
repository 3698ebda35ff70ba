"""Networks from checkpoints: nothing is allocated before what their configuration asks for is seen to be stored."""

from collections.abc import Callable, Sequence
from typing import TypeVar

import torch
from torch import nn

from mimicbench.core.checkpoint import CONFIG, BadCheckpoint, Checkpoint

MAX_LAYERS = 64
"""No network here repeats anything more often."""
MAX_DERIVED = 1 << 24
"""Numbers that a network works out for itself instead of storing them, such as positions of tokens: 64 MiB."""

Network = TypeVar("Network", bound=nn.Module)


def built(checkpoint: Checkpoint, build: Callable[[], Network], layers: Sequence[int]) -> Network:
    """The network of a checkpoint, ready for use.

    Args:
        checkpoint: As read.
        build: Makes the network from its configuration, with any weights.
        layers: How many of everything that is repeated the configuration asks for.

    Raises:
        BadCheckpoint: The configuration describes no network, or not the one that is stored.
    """
    where = f"{checkpoint.folder / CONFIG}"
    if not all(0 <= count <= MAX_LAYERS for count in layers):
        raise BadCheckpoint(
            f"{where} asks for {max(layers, key=abs)} layers of a kind, which are 0 to {MAX_LAYERS}; it is not one of "
            "ours"
        )
    try:
        with torch.device("meta"):  # shapes without numbers
            plan = build()
    except (RuntimeError, ValueError, TypeError, IndexError, ArithmeticError, AssertionError) as error:
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise BadCheckpoint(f"{where} describes no {checkpoint.kind} ({reason}); train it again") from None
    stored = plan.state_dict()
    arrays = checkpoint.matching({name: tuple(value.shape) for name, value in stored.items()})
    derived = sum(value.numel() for name, value in plan.named_buffers() if name not in stored)
    if derived > MAX_DERIVED:
        raise BadCheckpoint(
            f"{where} describes a {checkpoint.kind} with {derived} numbers beside those that are stored; it is not one "
            "of ours"
        )
    network = build()
    network.load_state_dict({name: torch.from_numpy(array.copy()) for name, array in arrays.items()})
    return network.eval()
