"""Saving and resuming any training, whole: a training that was killed goes on to the same bytes as one that was not.

Everything that has a state gives it as tensors and takes it back: environments, networks, optimizers, memories,
generators of random numbers. All of it goes into one file, written to a temporary name and then renamed.
"""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Protocol

import safetensors
import safetensors.torch
import torch
from torch import Tensor, nn

from mimicbench.core.checkpoint import BadCheckpoint
from mimicbench.core.errors import MimicbenchError
from mimicbench.core.events import append_events, write_events
from mimicbench.core.files import DIGEST, write_atomic

STATE = "training.safetensors"
METRICS = "metrics.jsonl"
MAX_BYTES = 64 << 30  # a planner's memory of frames can be several GiB
_HEADER = "mimicbench"


class Resumable(Protocol):
    """Something with a state."""

    def state_tensors(self) -> dict[str, Tensor]:
        """A copy of all that decides how it goes on."""
        ...

    def load_state_tensors(self, tensors: Mapping[str, Tensor]) -> None:
        """The inverse of `state_tensors`, in one made alike."""
        ...


class NetworkState:
    """A network's weights and buffers."""

    def __init__(self, network: nn.Module) -> None:
        self.network = network

    def state_tensors(self) -> dict[str, Tensor]:
        """By their names."""
        return dict(self.network.state_dict())

    def load_state_tensors(self, tensors: Mapping[str, Tensor]) -> None:
        """The inverse of `state_tensors`."""
        self.network.load_state_dict(dict(tensors))


class OptimizerState:
    """An optimizer's moments and learning rates."""

    def __init__(self, optimizer: torch.optim.Optimizer) -> None:
        self.optimizer = optimizer

    def state_tensors(self) -> dict[str, Tensor]:
        """Moments as `<parameter>/<moment>`, and the learning rate of each group."""
        state = self.optimizer.state_dict()
        found = {
            f"{index}/{name}": torch.as_tensor(value)
            for index, moments in state["state"].items()
            for name, value in moments.items()
        }
        rates = [float(group["lr"]) for group in state["param_groups"]]
        return {**found, "rates": torch.tensor(rates, dtype=torch.float64)}

    def load_state_tensors(self, tensors: Mapping[str, Tensor]) -> None:
        """The inverse of `state_tensors`."""
        moments: dict[int, dict[str, Tensor]] = {}
        for key, value in tensors.items():
            index, _, name = key.partition("/")
            if name:
                moments.setdefault(int(index), {})[name] = value
        groups = self.optimizer.state_dict()["param_groups"]
        self.optimizer.load_state_dict({"state": moments, "param_groups": groups})
        for group, rate in zip(self.optimizer.param_groups, tensors["rates"].tolist(), strict=True):
            group["lr"] = rate


class TorchRandom:
    """torch's own random numbers, on the CPU and on one GPU."""

    def __init__(self, device: str = "cpu") -> None:
        self.device = device

    def state_tensors(self) -> dict[str, Tensor]:
        """States of the generators."""
        found = {"cpu": torch.get_rng_state()}
        if torch.device(self.device).type == "cuda":
            found["cuda"] = torch.cuda.get_rng_state(self.device)
        return found

    def load_state_tensors(self, tensors: Mapping[str, Tensor]) -> None:
        """The inverse of `state_tensors`."""
        torch.set_rng_state(tensors["cpu"])
        if "cuda" in tensors and torch.device(self.device).type == "cuda":
            torch.cuda.set_rng_state(tensors["cuda"], self.device)


def save_training(
    folder: Path, identity: Mapping[str, Any], parts: Mapping[str, Resumable], progress: Mapping[str, float]
) -> None:
    """Write `training.safetensors`, whole or not at all.

    Args:
        folder: Of the training.
        identity: What decides its course, as plain JSON values; a training of another identity does not go on from it.
        parts: Everything with a state, by name.
        progress: How far it has come; the first entry is what it counts by.
    """
    tensors = {
        f"{name}/{key}": value.detach().to("cpu", copy=True).contiguous()
        for name, part in parts.items()
        for key, value in part.state_tensors().items()
    }
    header = {_HEADER: json.dumps({"identity": dict(identity), "progress": dict(progress)}, sort_keys=True)}
    header[DIGEST] = _digest(header[_HEADER], tensors)
    data = safetensors.torch.save(tensors, header)
    write_atomic(folder / STATE, lambda stream: stream.write(data))


def resume_training(
    folder: Path, identity: Mapping[str, Any], parts: Mapping[str, Resumable], fresh: Mapping[str, float]
) -> dict[str, float]:
    """Take up what `save_training` left and return its progress; `fresh` if there is nothing.

    Lines of `metrics.jsonl` from after the save are dropped: they will be written again. Raises BadCheckpoint if the
    file cannot be read, MimicbenchError if it is of a training of another identity.
    """
    path = folder / STATE
    if not path.exists():
        forget_after(folder / METRICS, {name: -1 for name in fresh})
        return dict(fresh)
    if path.stat().st_size > MAX_BYTES:
        raise BadCheckpoint(f"{path} is larger than {MAX_BYTES >> 30} GiB, more than any training keeps: delete it")
    try:
        with safetensors.safe_open(path, "pt") as file:
            written = file.metadata() or {}
            header = json.loads(written[_HEADER])
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        if len(written) > 1 and written.get(DIGEST) != _digest(written[_HEADER], tensors):
            raise ValueError("it is damaged")
        known, progress = header["identity"], {name: header["progress"][name] for name in fresh}
    except (safetensors.SafetensorError, OSError, KeyError, TypeError, ValueError) as error:
        raise BadCheckpoint(f"{path} cannot be read ({error}); delete {folder} to train from the start") from None
    wanted = json.loads(json.dumps(dict(identity)))
    if known != wanted:
        differs = sorted(name for name in {*known, *wanted} if known.get(name) != wanted.get(name))
        raise MimicbenchError(
            f"{folder} holds a training with another {' and '.join(differs)}; use another folder, or delete it"
        )
    for name, part in parts.items():
        prefix = f"{name}/"
        part.load_state_tensors({k.removeprefix(prefix): v for k, v in tensors.items() if k.startswith(prefix)})
    forget_after(folder / METRICS, progress)
    return progress


def _digest(header: str, tensors: Mapping[str, Tensor]) -> str:
    """Stands for all of a training's state."""
    found = hashlib.blake2b(header.encode(), digest_size=8)
    for name, tensor in sorted(tensors.items()):
        found.update(f"{name} {tensor.dtype} {tuple(tensor.shape)}".encode())
        found.update(tensor.detach().cpu().contiguous().view(-1).view(torch.uint8).numpy().data)
    return found.hexdigest()


def check_losses(losses: Mapping[str, float], folder: Path, samples: float) -> None:
    """Raises MimicbenchError if learning has diverged, of a training that had so many samples."""
    for name, value in losses.items():
        if value != value or abs(value) == float("inf"):
            raise MimicbenchError(
                f"training diverged: {name} is not a number after {samples:.0f} samples; {folder} keeps what it saved "
                "before: train with a smaller learning rate"
            )


def append_metrics(folder: Path, row: Mapping[str, object]) -> None:
    """Append a line to `metrics.jsonl`, and the same for TensorBoard; numbers that are none become null."""
    folder.mkdir(parents=True, exist_ok=True)
    plain = {name: None if isinstance(value, float) and value != value else value for name, value in row.items()}
    with open(folder / METRICS, "a") as stream:
        stream.write(json.dumps(plain) + "\n")
    append_events(folder, plain)


def read_metrics(path: Path) -> list[dict[str, Any]]:
    """The lines of a `metrics.jsonl`; a last one that was cut off is left out."""
    if not path.exists():
        return []
    rows = []
    for line in path.read_text().splitlines():
        try:
            rows.append(json.loads(line))
        except json.JSONDecodeError:
            break
    return rows


def forget_after(path: Path, progress: Mapping[str, float]) -> None:
    """Drop the lines of a metrics file that were written after a save of that progress, and TensorBoard's, too.

    The first entry of a progress is what a training counts by; others may begin anew on the way.
    """
    if not path.exists():
        return
    name, most = next(iter(progress.items()))
    kept = [row for row in read_metrics(path) if row.get(name, 0) <= most]
    write_atomic(path, lambda stream: stream.writelines(f"{json.dumps(row)}\n".encode() for row in kept))
    write_events(path.parent, kept)


class MovingAverage:
    """A moving average of a network's weights, which is what is kept."""

    def __init__(self, network: nn.Module, decay: float) -> None:
        self.decay = decay
        self.values = {n: v.detach().clone() for n, v in network.named_parameters()} if decay else {}

    def follow(self, network: nn.Module, steps: int) -> None:
        """After `steps` batches."""
        # young averages forget faster, or they would long remember the first weights
        decay = min(self.decay, (1 + steps) / (10 + steps))
        parameters = dict(network.named_parameters())
        for name, value in self.values.items():
            value.lerp_(parameters[name].detach(), 1 - decay)

    def state_tensors(self) -> dict[str, Tensor]:
        """The averages by name."""
        return dict(self.values)

    def load_state_tensors(self, tensors: Mapping[str, Tensor]) -> None:
        """The inverse of `state_tensors`."""
        for name, value in self.values.items():
            value.copy_(tensors[name])
