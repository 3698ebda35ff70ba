"""Training of a learner on demonstrations: resumable at any moment, the same for the same seed, observed in a file."""

import dataclasses
import hashlib
import json
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import msgspec
import safetensors
import safetensors.torch
import torch
from torch import Tensor

from mimicbench.core.checkpoint import BadCheckpoint
from mimicbench.core.errors import MimicbenchError
from mimicbench.core.files import write_atomic
from mimicbench.core.seeds import digest
from mimicbench.imitate.act import ACT
from mimicbench.imitate.bc import BC
from mimicbench.imitate.dataset import DemoFrames
from mimicbench.imitate.inputs import Batch
from mimicbench.imitate.learners import LearnerConfig, make_learner, save_learner

STATE = "training.safetensors"
METRICS = "metrics.jsonl"
_VALIDATION_FRAMES = 512


@dataclass(frozen=True)
class TrainConfig:
    """How long and how. The defaults are for a CPU."""

    steps: int | None = None
    """Batches; the result then depends on the seed alone."""
    minutes: float | None = None
    """Time to learn, all runs together; whichever of the two ends first."""
    batch: int = 128
    """Frames per batch."""
    learning_rate: float = 1e-3
    """The highest."""
    schedule: str = "cosine"
    """`cosine`: falls to 0 over the whole time; `constant`."""
    warmup: float = 0.02
    """Share of the time in which the learning rate rises from 0."""
    weight_decay: float = 1e-4
    """Of AdamW."""
    clip: float = 1.0
    """Longest gradient; 0 for no limit."""
    average: float = 0.999
    """Decay of the moving average of the weights, which is what is kept; 0 for the weights themselves."""
    checkpoint_minutes: float = 2.0
    """How much is lost at most when killed."""
    log_steps: int = 50
    """Batches per line of metrics.jsonl."""
    seed: int = 0
    """Of weights, batches and noise."""
    device: str = "cpu"
    """`cpu`, or `cuda` for a GPU."""

    @staticmethod
    def paper() -> "TrainConfig":
        """The original's optimization: AdamW at 1e-5, batches of 8."""
        return TrainConfig(
            steps=500_000, batch=8, learning_rate=1e-5, schedule="constant", warmup=0.0, clip=0.0, average=0.0
        )


def train(learner: LearnerConfig, data: DemoFrames, config: TrainConfig, folder: Path, quiet: bool = False) -> ACT | BC:
    """Learn, or go on learning, and leave a checkpoint in `folder`.

    Args:
        learner: The network to train; its kind follows from the type.
        data: Frames of demonstrations, made with the same inputs and chunk.
        config: How long and how.
        folder: Gets the checkpoint, `training.safetensors` to go on from, and `metrics.jsonl`.
        quiet: No progress bar.

    Returns:
        The trained network (the moving average, if there is one), on the CPU and ready for use.
    """
    if config.steps is None and config.minutes is None:
        raise MimicbenchError("say how long to train: give steps, minutes or both")
    run = _Run(learner, data, config, folder)
    run.resume()
    if run.steps and run.done() >= 1:
        return run.result()
    started = saved = time.monotonic()
    before = run.seconds
    sums: dict[str, float] = {}
    with _bar(quiet, f"{type(learner).__name__.removesuffix('Config')} learns") as show:
        while (done := run.done()) < 1:
            parts = run.step(done)
            for name, value in parts.items():
                sums[name] = sums.get(name, 0.0) + value
            now = time.monotonic()
            run.seconds = before + now - started
            if run.steps % config.log_steps == 0:
                run.log({name: total / config.log_steps for name, total in sums.items()})
                show(run.done(), f"loss {sums['loss'] / config.log_steps:.3f}")
                sums = {}
            if now - saved > 60 * config.checkpoint_minutes:
                run.save()
                saved = now
        run.save()
    return run.result()


class _Run:
    """One training run: everything that has to survive a kill is in `save` and `resume`."""

    def __init__(self, learner: LearnerConfig, data: DemoFrames, config: TrainConfig, folder: Path) -> None:
        self.data, self.config, self.folder = data, config, folder
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(self._seed("weights"))
            self.learner = make_learner(learner)
        frames = data.train_frames[:: max(1, len(data.train_frames) // 20_000)]
        self.learner.normalize_by(data.vector(frames), data.action[frames])
        self.learner.to(config.device)
        self.parameters = dict(self.learner.named_parameters())
        self.average = (
            {name: value.detach().clone() for name, value in self.parameters.items()} if config.average else {}
        )
        self.optimizer = torch.optim.AdamW(
            self.parameters.values(), lr=config.learning_rate, weight_decay=config.weight_decay
        )
        self.steps = 0
        self.seconds = 0.0
        plain = msgspec.to_builtins(
            {"learner": dataclasses.asdict(learner), "train": _identity(config), "frames": data.demos.frames}
        )
        references = "\0".join(data.demos.reference_ids)
        self.fingerprint = hashlib.blake2b(
            (json.dumps(plain, sort_keys=True) + references).encode(), digest_size=8
        ).hexdigest()

    def done(self) -> float:
        """The share of the training that is over."""
        config = self.config
        by_steps = 0.0 if config.steps is None else self.steps / max(1, config.steps)
        by_time = 0.0 if config.minutes is None else self.seconds / (60 * max(1e-9, config.minutes))
        return max(by_steps, by_time)

    def step(self, done: float) -> dict[str, float]:
        """One batch. Its random numbers follow from its number, so a resumed run draws the same ones."""
        config = self.config
        random = torch.Generator().manual_seed(self._seed("batch", self.steps))
        frames = self.data.train_frames[torch.randint(len(self.data.train_frames), (config.batch,), generator=random)]
        batch = _to(self.data.batch(frames, random), config.device)
        rate = min(1.0, (done + 1e-4) / config.warmup) if config.warmup else 1.0
        if config.schedule == "cosine":
            rate *= 0.5 * (1 + torch.cos(torch.tensor(done * torch.pi)).item())
        for group in self.optimizer.param_groups:
            group["lr"] = config.learning_rate * rate
        self.learner.train()
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(self._seed("dropout", self.steps))
            noise = torch.Generator(config.device).manual_seed(self._seed("noise", self.steps))
            parts = self.learner.loss(batch, noise)
        self.optimizer.zero_grad(set_to_none=True)
        parts["loss"].backward()
        if config.clip:
            torch.nn.utils.clip_grad_norm_(self.parameters.values(), config.clip)
        values = {name: float(value.detach()) for name, value in parts.items()}
        if not torch.isfinite(torch.tensor(values["loss"])):
            raise MimicbenchError(
                f"the loss is not a number after {self.steps} batches; train with a smaller learning "
                f"rate (it was {config.learning_rate})"
            )
        self.optimizer.step()
        self.steps += 1
        # young averages forget faster, or they would long remember the first weights
        decay = min(config.average, (1 + self.steps) / (10 + self.steps))
        for name, value in self.average.items():
            value.lerp_(self.parameters[name].detach(), 1 - decay)
        return values

    def log(self, parts: dict[str, float]) -> None:
        """Append a line to metrics.jsonl."""
        line = {
            "step": self.steps,
            "minutes": self.seconds / 60,
            "learning_rate": self.optimizer.param_groups[0]["lr"],
            **parts,
        }
        self.folder.mkdir(parents=True, exist_ok=True)
        with open(self.folder / METRICS, "a") as stream:
            stream.write(json.dumps(line) + "\n")

    def save(self) -> None:
        """Write the checkpoint, with its error on the episodes kept apart, and after it the state to go on from."""
        tensors = {f"weights/{name}": value.detach() for name, value in self.parameters.items()}
        tensors |= {
            f"buffers/{name}": value
            for name, value in self.learner.named_buffers()
            if name in self.learner.state_dict()
        }
        tensors |= {f"average/{name}": value for name, value in self.average.items()}
        for name, parameter in self.parameters.items():
            for key, value in self.optimizer.state.get(parameter, {}).items():
                tensors[f"optimizer.{key}/{name}"] = value
        header = {"fingerprint": self.fingerprint, "steps": str(self.steps), "seconds": repr(self.seconds)}
        data = safetensors.torch.save({name: value.cpu().contiguous() for name, value in tensors.items()}, header)

        def write(stream: IO[bytes]) -> None:
            stream.write(data)

        learner = self.result()
        error = self.validation_error(learner)
        if error is not None:
            self.log({"validation_error": error})
        notes = {
            "steps": self.steps,
            "minutes": self.seconds / 60,
            "seed": self.config.seed,
            "episodes": self.data.demos.episodes,
            "validation_error": error,
        }
        save_learner(self.folder, learner, self.data.demos.robot, notes)
        write_atomic(self.folder / STATE, write)

    def resume(self) -> None:
        """Take up what `save` left, if anything. Raises MimicbenchError if it was made with another configuration."""
        path = self.folder / STATE
        if not path.exists():
            return
        try:
            with safetensors.safe_open(path, "pt") as file:
                header, tensors = file.metadata() or {}, {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        except (safetensors.SafetensorError, OSError) as error:
            raise BadCheckpoint(
                f"{path} cannot be read ({error}); delete {self.folder} to train from the start"
            ) from None
        if header.get("fingerprint") != self.fingerprint:
            raise MimicbenchError(
                f"{self.folder} was trained with another configuration or other demonstrations; use "
                "another folder, or delete it"
            )
        self.steps, self.seconds = int(header["steps"]), float(header["seconds"])
        self.learner.load_state_dict(
            {
                name.split("/", 1)[1]: value
                for name, value in tensors.items()
                if name.startswith(("weights/", "buffers/"))
            }
        )
        for name, parameter in self.parameters.items():
            if self.average:
                self.average[name].copy_(tensors[f"average/{name}"])
            keys = [key for key in ("step", "exp_avg", "exp_avg_sq") if f"optimizer.{key}/{name}" in tensors]
            if keys:
                # the moments live beside the weights, the count of steps on the CPU
                self.optimizer.state[parameter] = {
                    key: tensors[f"optimizer.{key}/{name}"].to("cpu" if key == "step" else self.config.device)
                    for key in keys
                }
        _forget_after(self.folder / METRICS, self.steps)

    def result(self) -> ACT | BC:
        """The network to keep, on the CPU."""
        learner = make_learner(self.learner.config)
        learner.load_state_dict({**self.learner.state_dict(), **self.average})
        return learner.eval()

    @torch.no_grad()
    def validation_error(self, learner: ACT | BC) -> float | None:
        """Mean absolute error [rad] of the predicted action on frames of episodes that were kept apart.

        None if there are none.
        """
        frames = self.data.validation_frames
        if not len(frames):
            return None
        batch = self.data.batch(frames[:: max(1, len(frames) // _VALIDATION_FRAMES)])
        return float((learner.predict(batch.vector, batch.elevation) - batch.actions[:, 0]).abs().mean())

    def _seed(self, *keys: str | int) -> int:
        return digest(self.config.seed, "imitate", *keys) % (1 << 63)


def _identity(config: TrainConfig) -> dict[str, Any]:
    """The part of the configuration that a resumed run must share; it may run longer or elsewhere."""
    free = ("steps", "minutes", "checkpoint_minutes", "log_steps", "device")
    return {key: value for key, value in dataclasses.asdict(config).items() if key not in free}


def _to(batch: Batch, device: str) -> Batch:
    def move(value: Tensor) -> Tensor:
        return value.to(device)

    return Batch(
        move(batch.vector),
        None if batch.elevation is None else move(batch.elevation),
        move(batch.actions),
        move(batch.pad),
    )


def _forget_after(path: Path, step: int) -> None:
    """Drop the lines of metrics.jsonl that a killed run wrote after its last checkpoint."""
    if not path.exists():
        return
    lines = [line for line in path.read_text().splitlines() if line.endswith("}") and json.loads(line)["step"] <= step]
    write_atomic(path, lambda stream: stream.writelines(f"{line}\n".encode() for line in lines))


@contextmanager
def _bar(quiet: bool, label: str) -> Iterator[Any]:
    """A progress bar with the time left, on stderr; yields show(share done, remark)."""
    if quiet:
        yield lambda done, remark: None
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        TaskProgressColumn,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = [
        TextColumn("{task.description:<28}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    ]
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task(label, total=1.0)
        yield lambda done, remark: bar.update(task, completed=min(1.0, done), description=f"{label}, {remark}")
