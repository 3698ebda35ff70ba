"""What a training needs in order to go on after a kill: weights, the optimizer's moments, and how far it has come."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import safetensors.numpy
import torch
from torch import nn

from mimicbench.core.checkpoint import read_tensors
from mimicbench.core.files import read_json, write_atomic, write_json


def save_training(
    folder: Path, network: nn.Module, optimizer: torch.optim.Optimizer, progress: Mapping[str, float]
) -> None:
    """Write `training.safetensors`, and `training.json` after it: with it, the save is whole."""
    tensors = {f"network/{name}": value.cpu().numpy() for name, value in network.state_dict().items()}
    for i, moments in optimizer.state_dict()["state"].items():
        tensors |= {f"optimizer/{i}/{name}": torch.as_tensor(value).cpu().numpy() for name, value in moments.items()}
    data = safetensors.numpy.save(tensors)
    write_atomic(folder / "training.safetensors", lambda stream: stream.write(data))
    write_json(folder / "training.json", dict(progress))


def resume_training(
    folder: Path, network: nn.Module, optimizer: torch.optim.Optimizer, fresh: Mapping[str, float]
) -> dict[str, float]:
    """Take up what `save_training` left and return its progress; `fresh` if there is nothing. Raises BadCheckpoint."""
    if not (folder / "training.json").exists():
        return dict(fresh)
    moments: dict[int, dict[str, torch.Tensor]] = {}
    weights = {}
    for name, value in read_tensors(folder / "training.safetensors").items():
        head, _, rest = name.partition("/")
        if head == "network":
            weights[rest] = torch.from_numpy(value.copy())
        else:
            index, _, key = rest.partition("/")
            moments.setdefault(int(index), {})[key] = torch.from_numpy(np.array(value))
    network.load_state_dict(weights)
    optimizer.load_state_dict({"state": moments, "param_groups": optimizer.state_dict()["param_groups"]})
    return read_json(folder / "training.json")
