"""Practice: reinforcement learning on what robots sense while they try a task (imitate.exploring.episodes), from
nothing or from what was learned before.
"""

import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Protocol

import msgspec
import numpy as np
import torch
from torch import Tensor, nn

from mimicbench.core.progress import Pulse
from mimicbench.core.seeds import digest
from mimicbench.core.settings import Amount, Positive
from mimicbench.core.training import (
    Resumable,
    TorchRandom,
    append_metrics,
    check_losses,
    resume_training,
    save_training,
)
from mimicbench.envs.vec_env import EnvConfig
from mimicbench.imitate.exploring.episodes import Exploration, ExploreConfig, Sensing
from mimicbench.imitate.spec import Given
from mimicbench.track.network import Blueprint
from mimicbench.track.ppo_config import PPOConfig, ppo_learner

if TYPE_CHECKING:
    from mimicbench.track.ppo import PPOLearner

REPORT_EVERY = 10
"""Updates between the lines of `metrics.jsonl`."""


def _ppo() -> PPOConfig:
    """At a fixed rate: what is seen widens while learning goes on, which the divergence alone would put the rate down
    for.
    """
    return PPOConfig(steps=24, epochs=5, gamma=0.99, entropy=0.0, learning_rate=3e-4, schedule="fixed", initial_std=0.4)


@dataclass(frozen=True)
class Practice:
    """How practice goes, and how long."""

    ppo: PPOConfig = field(default_factory=_ppo)
    """The reinforcement learning; layers are those of the network."""
    explore: ExploreConfig = field(default_factory=ExploreConfig)
    samples: Annotated[int, Amount()] = 20_000_000
    """Control steps to learn from, over all robots."""
    threads: Positive = 2
    """Threads of the network's arithmetic. Sums round differently with another number, so it is part of the result."""
    save_every: float = 120.0
    """Seconds between saves of the training state: what a kill can lose at most."""


CRITIC_FIRST = 10
"""Updates in which the critic of who knows already what to do learns alone: one that knows nothing would only spoil
the actor."""


class Student(Protocol):
    """Who practises: what it senses, and the network that turns that into actions."""

    senses: Sensing
    blueprint: Blueprint
    """Of the actor."""
    critic: Blueprint | None
    """Of the critic, for who knows already what to do; None: the actor's, and both begin with nothing."""
    action_size: int

    def flat(self, vector: Tensor, maps: Tensor | None) -> Tensor:
        """(N, inputs) what the actor takes, of what the senses see."""
        ...

    def targets(self, action: Tensor, joint_pos: Tensor) -> Tensor:
        """(N, J) joint targets [rad] of actions (N, A) of robots whose joints are at (N, J) [rad]."""
        ...

    def shown(self) -> nn.Module | None:
        """What gives the actions (N, A) that it knew before, to stray from; None for who knew nothing."""
        ...

    def save(self, folder: Path, tensors: Mapping[str, np.ndarray], notes: Mapping[str, Any]) -> None:
        """Write the policy with the actor's tensors, those of a TrackerNetwork."""
        ...


def practise(
    folder: Path, given: Given, config: Practice, student: Student, course: Mapping[str, Any]
) -> dict[str, Any]:
    """Let a student practise, or go on practising, to the same bytes; what to tell of it.

    Args:
        folder: Gets the checkpoint, `training.safetensors` to go on from, and `metrics.jsonl`.
        given: The objects, and how to run.
        config: How practice goes.
        student: Who practises.
        course: All that decides the course, beside the seed and the objects.
    """
    run = _Run(folder, given, config, student, course)
    pulse, now, saved, progress = Pulse(given.context.say), time.monotonic(), time.monotonic(), run.progress
    while progress["samples"] < config.samples:
        losses = run.round()
        progress["seconds"], now = progress["seconds"] + time.monotonic() - now, time.monotonic()
        check_losses(losses, folder, progress["samples"])
        finished = progress["samples"] >= config.samples
        if progress["updates"] % REPORT_EVERY == 0 or finished:
            row = {**progress, **losses, **run.env.told()}
            append_metrics(folder, row)
            pulse(lambda row=row: _words(row, config.samples))
        if finished or now - saved > config.save_every:
            save_training(folder, run.identity, run.parts, progress)
            run.save()
            saved = now
    run.env.close()
    run.save()  # it may have been killed between the state and the checkpoint
    return {"objects": len(given.clips.objects), "samples": progress["samples"]}


class _Run:
    """One practice: episodes, network, and how far it has come."""

    def __init__(
        self, folder: Path, given: Given, config: Practice, student: Student, course: Mapping[str, Any]
    ) -> None:
        context, explore = given.context, config.explore
        torch.manual_seed(digest(given.seed, "practice") % (1 << 63))
        torch.set_num_threads(1)
        self.folder, self.config, self.student = folder, config, student
        env_config = EnvConfig(device=context.device, workers=context.workers)
        self.env = Exploration(given.clips, student.senses, given.gains, explore, given.seed, env_config)
        made = student.blueprint, student.action_size, explore.num_envs, config.ppo, self.env.device
        self.learner: PPOLearner = ppo_learner()(*made, student.critic)
        self._shown = student.shown() if explore.stray else None
        self.parts: dict[str, Resumable] = {
            "env": self.env,
            "learner": self.learner,
            "torch": TorchRandom(self.env.device),
        }
        self.identity = {"config": dict(course), "seed": given.seed, "objects": sorted(given.clips.objects)}
        begun = {"samples": 0, "updates": 0, "seconds": 0.0}
        self.progress = resume_training(folder, self.identity, self.parts, begun)
        self._notes = {"seed": given.seed, "task": given.clips.task.name, "gains": given.gains}
        self._obs = student.flat(*self.env.seen)

    def round(self) -> dict[str, float]:
        """Try, and learn from it: the losses."""
        self._try()
        torch.set_num_threads(self.config.threads)
        alone = self.student.critic is not None and self.progress["updates"] < CRITIC_FIRST
        losses = self.learner.update(self._obs, critic_alone=alone)
        torch.set_num_threads(1)
        self.progress["samples"] += self.config.explore.num_envs * self.config.ppo.steps
        self.progress["updates"] += 1
        return losses

    @torch.no_grad()
    def _try(self) -> None:
        """All robots try for some steps, which the learner remembers."""
        env, student = self.env, self.student
        for _ in range(self.config.ppo.steps):
            action = self.learner.act(self._obs)
            target = student.targets(action, env.env.context.state.joint_pos)
            shown = None if self._shown is None else self._shown(self._obs)
            reward, done, time_out = env.step(target, action, shown)
            self._obs = student.flat(*env.seen)
            self.learner.record(self._obs, reward, done, time_out)

    def save(self) -> None:
        """Write the policy as it is now."""
        self.student.save(self.folder, self.learner.network_tensors(), {**self._notes, **self.progress})


def _words(row: Mapping[str, float], samples: int) -> str:
    done, rate = row["samples"] / 1e6, row["samples"] / max(row["seconds"], 1e-9)
    told = f"reward {row['reward']:.3f}  each {row['seconds_each']:.1f} s  K {row['success']:.3f}"
    return f"{done:6.2f} of {samples / 1e6:.2f} M samples  {rate:6.0f}/s  {told}  fell {row['fell']:.2f}"


def course_of(config: Practice) -> dict[str, Any]:
    """What decides the course of a training; it may run longer, and be saved more or less often."""
    plain = msgspec.to_builtins(asdict(config))
    return {name: value for name, value in plain.items() if name not in ("samples", "save_every")}
