"""Learning the planner by DAgger: tracker or planner drives, and the clip says what should have been planned."""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import msgspec
import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from mimicbench.core.seeds import digest
from mimicbench.core.settings import BadSetting
from mimicbench.core.training import (
    NetworkState,
    OptimizerState,
    Resumable,
    TorchRandom,
    append_metrics,
    resume_training,
    save_training,
)
from mimicbench.envs.clips import ClipSet
from mimicbench.envs.mirrored import with_mirror_images
from mimicbench.envs.vec_env import EnvConfig
from mimicbench.imitate.dagger import SEEN, Drivers, Episodes, Replay, set_statistics
from mimicbench.imitate.learners.planner import PlannerConfig
from mimicbench.imitate.networks.planner import PlannerNetwork, PlannerSizes, TaskColumns, columns_of
from mimicbench.imitate.plan import PlanLayout
from mimicbench.imitate.planner import own_terms, styles_of
from mimicbench.sim.timing import CONTROL_DT
from mimicbench.track.history import Follower
from mimicbench.track.spec import Terms
from mimicbench.track.tracker import Tracker, flat, sizes
from mimicbench.track.tracking import TrackingEnv


def train_planner(
    folder: Path,
    tracker: Tracker,
    clips: Sequence[ClipSet],
    config: PlannerConfig,
    seed: int,
    env_config: EnvConfig | None = None,
    report: Callable[[dict], None] | None = None,
    begin_from: Mapping[str, Tensor] | None = None,
) -> PlannerNetwork:
    """Learn a planner over `tracker` by DAgger on `clips`, one set for each task.

    Training state goes to `<folder>/training.safetensors`, progress to `<folder>/metrics.jsonl`; a killed training goes
    on from there to the same bytes. The networks move to where the tensors of physics on the device live. With
    `begin_from`, tensors of a planner's network, learning begins there; raises BadSetting if they are of another.
    """
    clips = [with_mirror_images(some) for some in clips] if config.mirrored else clips
    torch.manual_seed(digest(seed, "planner") % (1 << 63))
    torch.set_num_threads(config.threads)
    run = _Run(tracker, clips, config, seed, env_config)
    if begin_from is not None:
        run.begin_from(begin_from)
    plain = msgspec.to_builtins(asdict(config))
    identity = {"config": {name: value for name, value in plain.items() if name != "save_every"}, "seed": seed}
    identity["clips"] = [motion.id for some in clips for motion in some.motions]
    parts = run.parts()
    progress = resume_training(folder, identity, parts, {"round": 0, "samples": 0, "seconds": 0.0})
    rounds = math.ceil(config.samples / (config.num_envs * config.steps))
    now = saved = time.monotonic()
    while progress["round"] < rounds:
        row = run.round(progress["round"] / rounds, first=progress["round"] == 0 and begin_from is None)
        progress["round"] += 1
        progress["samples"] += config.num_envs * config.steps
        progress["seconds"] += time.monotonic() - now
        now, finished = time.monotonic(), progress["round"] == rounds
        if progress["round"] % 10 == 0 or finished:
            append_metrics(folder, {**progress, **row})
        if report:
            report({**progress, **row})
        if now - saved > config.save_every or finished:
            save_training(folder, identity, parts, progress)
            saved = now
    run.close()
    return run.network.eval()


AHEAD = 15
"""Frames by which is told where a clip is going."""
WALKS = 0.1
"""[m/s] Who is slower stays where he is."""
NEAR = 0.08
"""[m] A robot that is so much behind its clip, or ahead of it, is with it."""


class _Part:
    """One task of a training: its environment, and what is remembered of it."""

    def __init__(
        self,
        tracker: Tracker,
        clips: ClipSet,
        columns: TaskColumns,
        config: PlannerConfig,
        seed: int,
        env_config: EnvConfig | None,
    ) -> None:
        """`config` is of this task alone, as to robots and memory."""
        self.tracker, self.clips, self.columns, self.config, self.seed = tracker, clips, columns, config, seed
        robot, task = clips.robot, clips.task
        self.env = TrackingEnv(tracker.spec, clips, config.num_envs, config.tracking, seed, env_config)
        self.layout = PlanLayout(tracker.spec, robot, task)
        # what robots measure of themselves is among the inputs anyway
        self.own = ("last_action", *(name for name in own_terms(tracker.spec, task) if name != "proprio"))
        self.follower = Follower(tracker, config.num_envs, self.env.device)
        self.sensed_widths = [*sizes(self.own, robot, task), self.follower.history.past.shape[1]]
        _, styles = styles_of(clips.motions)
        self.raw_styles = (styles if config.clock else styles[:, :0]).to(self.env.device)
        self.drivers = Drivers(config.num_envs, self.env.device)
        self.drivers.draw(torch.arange(config.num_envs, device=self.env.device), 1.0)

    def begin(self, network: PlannerNetwork) -> None:
        """Episodes in which this network is to drive."""
        self.network = network
        styles = network.normalized_style(self.raw_styles)
        self.episodes = Episodes(self.env, self.columns, styles, self.seed, self.config.clock)
        widths = [network.sizes.inputs, sum(self.sensed_widths), self.layout.size]
        self.replay = Replay(self.config.memory, widths, self.env.device)

    def parts(self) -> dict[str, Resumable]:
        """Everything with a state, by name."""
        return {
            "env": self.env,
            "episodes": self.episodes,
            "store": self.replay,
            "drivers": self.drivers,
            "follower": self.follower.history,
        }

    @torch.no_grad()
    def collect(self, share: float) -> tuple[int, int]:
        """Let tracker or planner drive for some steps and remember what each robot should have planned.

        Returns failures and endings of planner episodes.
        """
        failures = endings = 0
        env, drivers, robot = self.env, self.drivers, self.clips.robot
        for _ in range(self.config.steps):
            terms = env.env.observe((*env.spec.observations, "last_action", *SEEN))
            inputs = self.episodes.inputs(terms)
            label = self.layout.flat(terms)
            self.replay.add(inputs, flat(terms, self.own), self.follower.history.past, label)
            plan = torch.where(drivers.teacher[:, None], label, self.columns.own(self.network.plan(inputs)))
            planned = {**dict(terms), **self.layout.split(plan)}
            action = self.follower.action(planned)
            target = self.tracker.target(robot, planned, action)
            if self.config.pace:
                self.keep_pace()
            _, _, done, time_out = env.step(action, self.tracker.settings, target)
            self.follower.history.begin(env.env.rows(done))
            if done.any():
                ids, teacher = done.nonzero()[:, 0], drivers.teacher
                endings += int((~teacher[ids]).sum())
                failures += int((~teacher[ids] & ~time_out[ids]).sum())
                drivers.draw(ids, share)
                self.episodes.begin(ids)
        return failures, endings

    def keep_pace(self) -> None:
        """Clips go slower where the robots that the planner drives lag behind on the way, and faster where they are
        ahead. Where a person stays, the clip goes on whatever the robot does, or both would wait for ever.
        """
        env, bank = self.env.env, self.env.bank
        now = bank.frame(env.clip, env.index).root_pos_w[:, :2]
        way = bank.frame(env.clip, env.index + AHEAD).root_pos_w[:, :2] - now
        length = way.norm(dim=-1)
        behind = ((now - self.env.context.state.root_pos_w[:, :2]) * way).sum(-1) / length.clamp(min=1e-6)
        some = torch.rand(len(length)).to(length.device) < self.config.pace
        moves = ~self.drivers.teacher & (length > WALKS * AHEAD * CONTROL_DT) & some
        slower, faster = moves & (behind > NEAR) & (env.index > 0), moves & (behind < -NEAR)
        # the frame after the next control step is the same once more, or the one after the next
        env.index += faster.long() - slower.long()

    def errors(self, inputs: Tensor, own: Tensor, label: Tensor, planned: Tensor) -> tuple[Tensor, Tensor]:
        """How far normalized plans (B, plans) are from labels (B, P), and the difference that they make to the
        tracker's action: smooth L1.
        """
        network = self.network
        mean, std = self.columns.own(network.plan_mean), self.columns.own(network.plan_std)
        *parts, past = own.split(self.sensed_widths, -1)
        sensed: Terms = dict(zip(self.own, parts, strict=True))
        sensed = {**sensed, "proprio": inputs[:, : network.sizes.body]}

        def act(plan: Tensor) -> Tensor:
            return self.tracker.action({**sensed, **self.layout.split(plan)}, past)

        said = self.columns.own(planned)
        with torch.no_grad():
            wanted = act(label)
        done = act(said * std + mean)
        return functional.smooth_l1_loss(said, (label - mean) / std), functional.smooth_l1_loss(done, wanted)


class _Run:
    """One training: the network, and the parts of its tasks."""

    def __init__(
        self,
        tracker: Tracker,
        clips: Sequence[ClipSet],
        config: PlannerConfig,
        seed: int,
        env_config: EnvConfig | None,
    ) -> None:
        self.config, count = config, len(clips)
        robot, tasks = clips[0].robot, [some.task for some in clips]
        self.tasks = [
            _Part(
                tracker,
                some,
                columns,
                replace(config, num_envs=len(range(number, config.num_envs, count)), memory=config.memory // count),
                digest(seed, "part", number) if number else seed,
                env_config,
            )
            for number, (some, columns) in enumerate(zip(clips, columns_of(tracker.spec, robot, tasks), strict=True))
        ]
        self.device = self.tasks[0].env.device
        styles = self.tasks[0].raw_styles
        planner_sizes = PlannerSizes.of(robot, tasks, tracker.spec, styles.shape[1], config.clock)
        self.network = PlannerNetwork(planner_sizes, config.hidden).to(self.device)
        self.network.set_styles(styles)
        tracker.network.to(self.device)
        for part in self.tasks:
            part.begin(self.network)
        self.optimizer = torch.optim.Adam(self.network.parameters(), lr=config.learning_rate)

    def begin_from(self, tensors: Mapping[str, Tensor]) -> None:
        """Take over a network, with what it knows of what it sees. Raises BadSetting if it is of another shape."""
        own = self.network.state_dict()
        if {n: v.shape for n, v in tensors.items()} != {n: v.shape for n, v in own.items()}:
            raise BadSetting(
                "imitate.begin_from leads to a planner of other layers, or that sees or tells something else; begin "
                "from one learned with the same --imitate.planner.hidden, clock, tasks and tracker, or from nothing"
            )
        self.network.load_state_dict(dict(tensors))
        for part in self.tasks:  # it goes on telling styles by the mean and deviation of the clips that it learned from
            part.episodes.tell_styles(self.network.normalized_style(part.raw_styles))

    def parts(self) -> dict[str, Resumable]:
        """Everything with a state, by name."""
        names = ["", *(f"{number}/" for number in range(1, len(self.tasks)))]
        return {
            **{
                f"{name}{key}": value
                for name, part in zip(names, self.tasks, strict=True)
                for key, value in part.parts().items()
            },
            "network": NetworkState(self.network),
            "optimizer": OptimizerState(self.optimizer),
            "torch": TorchRandom(self.device),
        }

    def round(self, part: float, first: bool) -> dict[str, float]:
        """Collect and learn, `part` of the training being over; what to tell of it."""
        config = self.config
        share = max(0.0, 1.0 - part / config.teacher_share) if config.teacher_share else 0.0
        failures, endings = map(sum, zip(*(task.collect(share) for task in self.tasks), strict=True))
        if first:
            set_statistics(self.network, [task.replay for task in self.tasks], [task.columns for task in self.tasks])
        for group in self.optimizer.param_groups:
            group["lr"] = config.learning_rate * (0.55 + 0.45 * np.cos(np.pi * part))
        losses = [self.learn() for _ in range(config.batches)]
        return {"loss": float(np.mean(losses)), "failed": failures / max(endings, 1), "teacher_share": share}

    def learn(self) -> float:
        """One step on as many frames of each task: errors of plans, of what the tracker does by them, and of the
        chooser.
        """
        network = self.network
        drawn = [task.replay.draw(self.config.batch // len(self.tasks)) for task in self.tasks]
        planned = network(torch.cat([inputs for inputs, _, _ in drawn])).chunk(len(self.tasks))
        errors = [task.errors(*frames, said) for task, frames, said in zip(self.tasks, drawn, planned, strict=True)]
        plans, actions = (torch.stack(each).mean() for each in zip(*errors, strict=True))
        loss = plans + self.config.action_weight * actions
        if network.sizes.style:
            for task in self.tasks:
                loss = loss + functional.mse_loss(network.chooser(task.episodes.known), task.episodes.styles)
        self.optimizer.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        self.optimizer.step()
        return float(loss.detach())

    def close(self) -> None:
        """Give everything back."""
        for task in self.tasks:
            task.env.env.close()
