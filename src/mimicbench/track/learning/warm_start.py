"""What a training takes from a trained network, and what it leaves: a TrackerNetwork's tensors, into and out of the
models that are trained.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from mimicbench.core.errors import MimicbenchError

WARM_COUNT = 1_000_000_000
"""Observations that the statistics of a network to begin from count as: they stay nearly as they are. Where they moved
to those of the new starts within the first million samples, a tracker of 91 % had 31 % before it had learned anything.
"""
Columns = Sequence[tuple[slice, slice]]
"""Which inputs of a network to begin from are which of ours."""


def plain_network(model: nn.Module) -> dict[str, np.ndarray]:
    """What a model has learned, as tensors of a TrackerNetwork."""
    statistics = _statistics(model)
    tensors = {f"obs{name}": statistics[name][0] for name in ("_mean", "_std") if name in statistics}
    weights = {name: value for name, value in model.state_dict().items() if name.startswith("mlp.")}
    tensors |= {f"layers.{name.removeprefix('mlp.')}": value for name, value in weights.items()}
    return {name: value.detach().cpu().numpy() for name, value in tensors.items()}


def take_statistics(model: nn.Module, tensors: Mapping[str, np.ndarray], columns: Columns) -> None:
    """What a TrackerNetwork, whose inputs are those columns, saw in the mean; nothing where it does not normalize."""
    statistics = _statistics(model)
    if not statistics or "obs_mean" not in tensors:
        return
    given = {name: torch.from_numpy(np.array(tensors[name])) for name in ("obs_mean", "obs_std")}
    for theirs, ours in columns:
        mean, std = given["obs_mean"][theirs], given["obs_std"][theirs]
        for name, value in (("_mean", mean), ("_std", std), ("_var", std**2), ("count", WARM_COUNT)):
            statistics[name][:, ours] = value


def take_over(model: nn.Module, tensors: Mapping[str, np.ndarray], columns: Columns, widens: bool) -> None:
    """Weights and statistics of a TrackerNetwork, whose inputs are those columns. Raises MimicbenchError.

    Where `widens`, the model is a chain of linear layers: they may be wider, and their inputs elsewhere.
    """
    own = {f"layers.{n.removeprefix('mlp.')}": v for n, v in model.named_parameters() if n.startswith("mlp.")}
    taken = {n: torch.from_numpy(np.array(value)) for n, value in tensors.items() if n.startswith("layers.")}
    if set(own) == set(taken) and not widens:
        _take_as_it_is(own, taken, columns)
    elif set(own) != set(taken) or any(
        own[name].shape[0] < value.shape[0] or ("0." not in name and own[name].shape[-1] < value.shape[-1])
        for name, value in taken.items()
    ):
        raise MimicbenchError(
            "the network to begin from has another number of layers than track.ppo.hidden, or wider ones; give "
            f"{len(taken) // 2 - 1} layers at least as wide as its own"
            if widens
            else "the network to begin from is of another kind, or has another number of layers; give one like it"
        )
    else:
        _take_wider(own, taken, columns)
    take_statistics(model, tensors, columns)


def _take_as_it_is(own: Mapping[str, Tensor], taken: Mapping[str, Tensor], columns: Columns) -> None:
    if any(own[name].shape != value.shape for name, value in taken.items()) or any(a != b for a, b in columns):
        raise MimicbenchError(
            "the network to begin from has other sizes or inputs, which only an MLP could take over; give one that "
            "was trained for the same tasks, with the same settings of track.network"
        )
    for name, value in taken.items():
        own[name].copy_(value)


def _take_wider(own: Mapping[str, Tensor], taken: Mapping[str, Tensor], columns: Columns) -> None:
    first = next(iter(own))
    for name, value in taken.items():
        there = own[name]
        if there.ndim == 1:
            there[: len(value)] = value
        elif name == first:
            there[: len(value)] = 0.0
            for theirs, ours in columns:
                there[: len(value), ours] = value[:, theirs]
        else:  # what is new has no say at first
            there[: len(value)] = 0.0
            there[: len(value), : value.shape[1]] = value


def _statistics(model: nn.Module) -> dict[str, Tensor]:
    """What the model saw in the mean, as it can be written to; nothing where it does not normalize."""
    normalizer: Any = model.obs_normalizer
    return dict(normalizer.named_buffers())
