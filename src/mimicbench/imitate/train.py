"""Training of a learner on demonstrations: resumable at any moment, the same for the same seed, observed in a file."""

import dataclasses
import time
from collections import deque
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import torch

from mimicbench.core.errors import MimicbenchError
from mimicbench.core.parallel import cpu_count
from mimicbench.core.progress import counter
from mimicbench.core.seeds import digest
from mimicbench.core.training import (
    MovingAverage,
    NetworkState,
    OptimizerState,
    append_metrics,
    resume_training,
    save_training,
)
from mimicbench.imitate.dataset import DemoFrames
from mimicbench.imitate.inputs import Batch, Learner
from mimicbench.imitate.learned import save_learner, take_over
from mimicbench.imitate.settings.cloning import TrainConfig

_VALIDATION_FRAMES = 512


@dataclass(frozen=True)
class Course(TrainConfig):
    """The same for one network; a recipe has one seed and one device for all its stages."""

    seed: int = 0
    """Of weights, batches and noise."""
    device: str = "cpu"
    """`cpu`, or `cuda` for a GPU."""

    @staticmethod
    def of(config: TrainConfig, seed: int, device: str) -> "Course":
        """A training as configured, with a seed, on a device."""
        return Course(**vars(config), seed=seed, device=device)


def train(
    learner: Any,
    data: DemoFrames,
    config: Course,
    folder: Path,
    quiet: bool = False,
    begin_from: Learner | None = None,
    notes: Mapping[str, Any] | None = None,
) -> Learner:
    """Learn, or go on learning, and leave a checkpoint in `folder`.

    Args:
        learner: The network to train; its kind follows from the type.
        data: Frames of demonstrations, made with the same inputs and chunk.
        config: How long and how.
        folder: Gets the checkpoint, `training.safetensors` to go on from, and `metrics.jsonl`.
        quiet: Tell nothing of the progress.
        begin_from: A network of the same kind whose weights and statistics are where learning begins.
        notes: What every checkpoint says beside how long it was trained: its gains, its task.

    Returns:
        The trained network (the moving average, if there is one), on the CPU and ready for use.
    """
    torch.set_num_threads(config.threads)
    with closing(CloneTraining(learner, data, config, folder, begin_from, notes)) as run:
        return _trained(run, config, quiet)


def _trained(run: "CloneTraining", config: Course, quiet: bool) -> Learner:
    run.resume()
    saved = time.monotonic()
    sums, summed = dict[str, float](), 0
    with counter(config.steps, f"{type(run.learner).__name__} learns", quiet) as tick:
        tick(run.steps)
        while run.steps < config.steps:
            before = time.monotonic()
            parts = run.step()
            for name, value in parts.items():
                sums[name] = sums.get(name, 0.0) + value
            summed += 1
            run.seconds += time.monotonic() - before
            tick(1, f"loss {parts['loss']:.3f}")
            if run.steps % config.log_steps == 0:
                # fewer than log_steps where it was taken up in between
                run.log({name: total / summed for name, total in sums.items()})
                sums, summed = {}, 0
            if run.steps == config.steps or time.monotonic() - saved > config.save_every:
                run.save()
                saved = time.monotonic()
    return run.result()


def batches_ahead(device: str) -> int:
    """How many batches are made at a time. A processor learns slower than it makes them, a GPU many times as fast."""
    return 1 if device == "cpu" else min(8, cpu_count())


class CloneTraining:
    """One training: everything that has to survive a kill is in `save` and `resume`."""

    def __init__(
        self,
        learner: Any,
        data: DemoFrames,
        config: Course,
        folder: Path,
        begin_from: Learner | None = None,
        notes: Mapping[str, Any] | None = None,
    ) -> None:
        self.data, self.config, self.folder, self.notes = data, config, folder, dict(notes or {})
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(self._seed("weights"))
            self.learner = learner.build()
        frames = data.train_frames[:: max(1, len(data.train_frames) // 20_000)]
        self.learner.normalize_by(data.vector(frames), data.samples(frames), data.ends())
        if begin_from is not None:
            take_over(self.learner, begin_from)
        self.learner.to(config.device)
        self.parameters = dict(self.learner.named_parameters())
        self.average = MovingAverage(self.learner, config.average)
        self.optimizer = torch.optim.AdamW(
            self.parameters.values(), lr=config.learning_rate, betas=config.betas, weight_decay=config.weight_decay
        )
        self.steps = 0
        self.seconds = 0.0
        self.waited = 0.0
        """[s] that it has waited for data since it was begun or taken up."""
        # the next batches are made while the network learns from this one
        self._ahead = batches_ahead(config.device)
        self._makers = ThreadPoolExecutor(self._ahead, "demonstrations")
        self._coming: deque[Future[Batch]] = deque()
        self.identity = {
            "learner": msgspec.to_builtins(dataclasses.asdict(learner)),
            "train": _identity(config),
            "demonstrations": list(data.demos.reference_ids),
            "frames": data.demos.frames,
        }
        network, optimizer = NetworkState(self.learner), OptimizerState(self.optimizer)
        self.parts = {"network": network, "average": self.average, "optimizer": optimizer}

    def step(self) -> dict[str, float]:
        """One batch. Its random numbers follow from its number, so a resumed run draws the same ones."""
        config, done = self.config, self.steps / self.config.steps
        before = time.monotonic()
        while len(self._coming) <= self._ahead:
            self._coming.append(self._makers.submit(self._batch, self.steps + len(self._coming)))
        batch = _to(self._coming.popleft().result(), config.device)
        self.waited += time.monotonic() - before
        rate = min(1.0, (done + 1e-4) / config.warmup) if config.warmup else 1.0
        if config.schedule == "cosine":
            rate *= 0.5 * (1 + torch.cos(torch.tensor(done * torch.pi)).item())
        for group in self.optimizer.param_groups:
            group["lr"] = config.learning_rate * rate
        self.learner.train()
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(self._seed("dropout", self.steps))
            noise = torch.Generator(config.device).manual_seed(self._seed("noise", self.steps))
            with torch.autocast(config.device, torch.bfloat16, config.precision == "bfloat16"):
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
        self.average.follow(self.learner, self.steps)
        return values

    def _batch(self, number: int) -> Batch:
        """The batch of that number."""
        random = torch.Generator().manual_seed(self._seed("batch", number))
        config = self.config
        return self.data.batch(self.data.draw(config.batch, config.soon, config.driven, config.wrong, random), random)

    def log(self, parts: dict[str, float]) -> None:
        """Append a line to metrics.jsonl."""
        rate = self.optimizer.param_groups[0]["lr"]
        told = {"step": self.steps, "seconds": self.seconds, "waited": self.waited, "learning_rate": rate}
        append_metrics(self.folder, {**told, **parts})

    def close(self) -> None:
        """Make no more batches."""
        self._makers.shutdown(cancel_futures=True)

    def save(self) -> None:
        """Write the state to go on from, and a checkpoint with its error on the episodes kept apart."""
        learner = self.result()
        error = self.validation_error(learner)
        if error is not None:
            self.log({"validation_error": error})
        save_training(self.folder, self.identity, self.parts, {"step": self.steps, "seconds": self.seconds})
        notes = {
            **self.notes,
            "steps": self.steps,
            "seconds": self.seconds,
            "seed": self.config.seed,
            "episodes": self.data.demos.episodes,
            "validation_error": error,
        }
        save_learner(self.folder, learner, self.data.demos.robot, notes)

    def resume(self) -> None:
        """Take up what `save` left, if anything. Raises MimicbenchError if it was made with another configuration."""
        progress = resume_training(self.folder, self.identity, self.parts, {"step": 0, "seconds": 0.0})
        self.steps, self.seconds = int(progress["step"]), float(progress["seconds"])

    def result(self) -> Learner:
        """The network to keep, on the CPU."""
        learner = self.learner.config.build()
        learner.load_state_dict({**self.learner.state_dict(), **self.average.values})
        return learner.eval()

    @torch.no_grad()
    def validation_error(self, learner: Learner) -> float | None:
        """Mean absolute error of what is said of the present, on frames of episodes that were kept apart.

        None if there are none.
        """
        frames = self.data.validation_frames
        if not len(frames):
            return None
        batch = self.data.batch(frames[:: max(1, len(frames) // _VALIDATION_FRAMES)])
        present = batch.actions[:, self.data.window.past]
        return float((learner.predict(batch.vector, batch.picture) - present).abs().mean())

    def _seed(self, *keys: str | int) -> int:
        return digest(self.config.seed, "imitate", *keys) % (1 << 63)


def _identity(config: Course) -> dict[str, Any]:
    """The part of the configuration that a resumed run must share; it may run longer or elsewhere."""
    free = ("steps", "save_every", "log_steps", "device")
    return {key: value for key, value in msgspec.to_builtins(dataclasses.asdict(config)).items() if key not in free}


def _to(batch: Batch, device: str) -> Batch:
    parts = (batch.vector, batch.picture, batch.actions, batch.pad, batch.goal, batch.ahead)
    return Batch(*(None if part is None else part.to(device) for part in parts))  # pyright: ignore[reportArgumentType]
