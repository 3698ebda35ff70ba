"""PPO on what the robot senses, from nothing: the paper's baseline that learns from nobody (Schulman et al. 2017).

Actor and critic are a ResNet that reads the map and an MLP that reads its features beside the state. Actions are joint
position targets around the robot's rest pose, `rest + scale * a`. Reward and ends are those of
imitate.exploring.episodes, updates those of track.ppo. The paper says no more of it than that it is vision-based PPO.

On a processor the ResNet takes most of the time (560 of 850 microseconds a sample, of the smallest that made sense), so
small networks read the map's cells by one linear layer, as is usual where robots walk over rough ground.
"""

import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import msgspec
import torch
from torch import Tensor, nn
from torch.nn import functional

from mimicbench.core.checkpoint import beside
from mimicbench.core.progress import Pulse
from mimicbench.core.seeds import digest
from mimicbench.core.settings import Amount, Positive, Sizes
from mimicbench.core.training import TorchRandom, append_metrics, check_losses, resume_training, save_training
from mimicbench.envs.vec_env import EnvConfig
from mimicbench.imitate.encoder import Encoder, EncoderConfig
from mimicbench.imitate.exploring.episodes import Exploration, ExploreConfig
from mimicbench.imitate.goals import known_goal
from mimicbench.imitate.inputs import Learner, NetworkConfig
from mimicbench.imitate.learned import save_learner
from mimicbench.imitate.policy import Senses
from mimicbench.imitate.spec import Given, ImitateConfig, LearnerSpec
from mimicbench.track.network import Blueprint, MLPConfig
from mimicbench.track.ppo_config import PPOConfig, ppo_learner

if TYPE_CHECKING:
    from mimicbench.track.ppo import PPOLearner

HEIGHT_UNIT = 0.03
"""What heights [m] of maps are multiplied by. All that is seen is divided by its deviation and 0.01 more, so cells are
by a third of a metre at least: those that seldom hold anything would else be the largest numbers of all."""


@dataclass(frozen=True)
class SightConfig:
    """Layers that take a state and, laid out behind it, maps: how actor and critic are made."""

    encoder: EncoderConfig
    """What reads the maps, whose channels and cells are those that it is given; 0 channels where there are none."""
    convolves: bool
    """Whether it is used: without, what follows it is given the cells themselves."""
    features: int
    """Numbers that its grid of features, or the cells, are brought down to."""
    hidden: tuple[int, ...]
    """Widths of the hidden layers."""

    normalizes: ClassVar[bool] = True
    widens: ClassVar[bool] = False

    @property
    def repeats(self) -> tuple[int, ...]:
        """How many of everything that is repeated."""
        return len(self.hidden), *self.encoder.layers

    @property
    def cells(self) -> int:
        """Numbers of the maps."""
        return self.encoder.channels * self.encoder.cells**2

    def build(self, width: int, frames: int, outputs: int) -> nn.Module:
        """(N, outputs) of (N, width) numbers, the maps last."""
        return Sight(self, width * frames, outputs)


class Sight(nn.Module):
    """MLP(state, linear(ResNet(maps))), or MLP(state, linear(maps))."""

    def __init__(self, config: SightConfig, inputs: int, outputs: int) -> None:
        super().__init__()
        self.config, size = config, inputs - config.cells
        if config.cells:
            grid = config.encoder.widths[-1] * config.encoder.side**2
            self.encoder = Encoder(config.encoder) if config.convolves else nn.Identity()
            self.squeeze = nn.Linear(grid if config.convolves else config.cells, config.features)
            size += config.features
        self.mlp = MLPConfig(config.hidden).build(size, 1, outputs)

    def forward(self, seen: Tensor) -> Tensor:
        """(N, outputs) from (N, inputs)."""
        if not self.config.cells:
            return self.mlp(seen)
        state, cells = seen.split([seen.shape[1] - self.config.cells, self.config.cells], -1)
        encoder = self.config.encoder
        maps = cells.unflatten(1, (encoder.channels, encoder.cells, encoder.cells))
        found = functional.elu(self.squeeze(self.encoder(maps).flatten(1)))
        return self.mlp(torch.cat([state, found], -1))


@dataclass(frozen=True)
class PPONetworkConfig(NetworkConfig):
    """The network. The defaults are ResNet-18 and the layers of HumanPlus' tracker."""

    encoder: EncoderConfig = field(default_factory=EncoderConfig)
    """The network that reads the map; what it pools is pooled before anything is remembered for an update."""
    convolves: bool = True
    """Whether it reads the map; without, a linear layer reads the cells that it would be given."""
    features: Positive = 256
    """Numbers that the map's features, or its cells, are brought down to."""
    hidden: Sizes = (512, 512, 512)
    """Widths of the hidden layers."""
    scale: float = 0.5
    """[rad] by which an action of 1 is off the rest pose."""

    @property
    def layers(self) -> tuple[int, ...]:
        """How many of everything that is repeated."""
        return len(self.hidden), *self.encoder.layers

    @property
    def blueprint(self) -> Blueprint:
        """What actor and critic are built by."""
        channels = self.inputs.seen_channels if self.inputs.sees else 0
        encoder = replace(self.encoder, channels=channels, cells=self.encoder.cells // self.encoder.pool, pool=1)
        sight = SightConfig(encoder, self.convolves, self.features, self.hidden)
        return Blueprint(sight, self.inputs.seen_size + sight.cells)

    def build(self) -> "Explorer":
        """A new network, with weights from torch's random numbers."""
        return Explorer(self)

    @staticmethod
    def small() -> "PPONetworkConfig":
        """For a CPU: the highest of 4 x 4 cells, by a linear layer; about 200 thousand parameters."""
        encoder = replace(EncoderConfig.small(), pool=4)
        return PPONetworkConfig(encoder=encoder, convolves=False, features=64, hidden=(256, 128))


class Explorer(Learner):
    """What was learned: state and maps -> joint targets. What it sees is normalized inside of its layers."""

    kind = "ppo"

    def __init__(self, config: PPONetworkConfig) -> None:
        super().__init__(config.inputs, (config.action_size,))
        self.config = config
        self.network = config.blueprint.network(config.action_size)

    def begin_at(self, pose: Tensor) -> None:
        """Actions are around joint angles (A,) [rad]."""
        self.action_mean.copy_(pose)
        self.action_std.fill_(self.config.scale)

    def flat(self, vector: Tensor, picture: Tensor | None) -> Tensor:
        """(N, inputs) what the layers take, of vectors (N, ...) and maps (N, ..., 128, 128) as Senses gives them."""
        if picture is None:
            return vector.flatten(1)
        maps = HEIGHT_UNIT * functional.max_pool2d(picture.flatten(1, -3), self.config.encoder.pool)
        return torch.cat([vector.flatten(1), maps.flatten(1)], -1)

    def targets(self, action: Tensor) -> Tensor:
        """Joint targets (N, A) [rad] of actions (N, A)."""
        return self.action_mean + self.action_std * action

    def plan(self, vector: Tensor, picture: Tensor | None) -> Tensor:
        """The targets (N, 1, A) [rad] of the mean action."""
        return self.targets(self.network(self.flat(vector, picture)))[:, None]


def _ppo() -> PPOConfig:
    """At a fixed rate: what is seen widens while learning goes on, which the divergence alone would put the rate down
    for.
    """
    return PPOConfig(steps=24, epochs=5, gamma=0.99, entropy=0.0, learning_rate=3e-4, schedule="fixed", initial_std=0.4)


@dataclass(frozen=True)
class PPOImitation(ImitateConfig):
    """Vision-based PPO without references."""

    learner: str = "ppo"
    gains: str | None = "improved"
    """Gains of the robot that the policy drives."""
    network: PPONetworkConfig = field(default_factory=PPONetworkConfig.small)
    ppo: PPOConfig = field(default_factory=_ppo)
    """The reinforcement learning; layers are those of the network."""
    explore: ExploreConfig = field(default_factory=ExploreConfig)
    samples: Annotated[int, Amount()] = 20_000_000
    """Control steps to learn from, over all robots."""
    threads: Positive = 2
    """Threads of the network's arithmetic. Sums round differently with another number, so it is part of the result."""
    save_every: float = 120.0
    """Seconds between saves of the training state: what a kill can lose at most."""

    references: ClassVar[bool] = False

    @property
    def remembers(self) -> bool:
        """Whether it remembers its goal."""
        return self.network.inputs.memory


REPORT_EVERY = 10
"""Updates between the lines of `metrics.jsonl`."""


def learn(folder: Path, given: Given, config: PPOImitation) -> dict[str, Any]:
    """Learn into a folder, or go on learning there, to the same bytes."""
    robot, task, context = given.clips.robot, given.clips.task, given.context
    torch.manual_seed(digest(given.seed, "ppo") % (1 << 63))
    torch.set_num_threads(1)
    network: PPONetworkConfig = config.network.of(robot, task)
    goal = known_goal(beside(folder, "perception"), robot, task) if network.inputs.memory else None
    env_config = EnvConfig(device=context.device, workers=context.workers)
    senses = Senses(network.inputs, goal)
    env = Exploration(given.clips, senses, given.gains, config.explore, given.seed, env_config)
    explorer = network.build().to(env.device)
    explorer.begin_at(torch.tensor(robot.rest_pose))
    learner = ppo_learner()(network.blueprint, network.action_size, config.explore.num_envs, config.ppo, env.device)
    parts = {"env": env, "ppo": learner, "torch": TorchRandom(env.device)}
    identity = {"config": _course(config), "seed": given.seed, "objects": sorted(given.clips.objects)}
    progress = resume_training(folder, identity, parts, {"samples": 0, "updates": 0, "seconds": 0.0})
    notes = {"seed": given.seed, "task": task.name, "gains": given.gains}

    def save() -> None:
        explorer.network.load_tensors(learner.network_tensors())
        save_learner(folder, explorer, robot.name, {**notes, **progress})

    obs = explorer.flat(*env.seen)
    pulse, now, saved = Pulse(context.say), time.monotonic(), time.monotonic()
    while progress["samples"] < config.samples:
        obs, losses = _round(env, learner, explorer, obs, config)
        progress["samples"] += config.explore.num_envs * config.ppo.steps
        progress["updates"] += 1
        progress["seconds"], now = progress["seconds"] + time.monotonic() - now, time.monotonic()
        check_losses(losses, folder, progress["samples"])
        finished = progress["samples"] >= config.samples
        if progress["updates"] % REPORT_EVERY == 0 or finished:
            row = {**progress, **losses, **env.told()}
            append_metrics(folder, row)
            pulse(lambda row=row: _words(row, config.samples))
        if finished or now - saved > config.save_every:
            save_training(folder, identity, parts, progress)
            save()
            saved = now
    env.close()
    save()  # it may have been killed between the state and the checkpoint
    return {"objects": len(given.clips.objects), "samples": progress["samples"]}


def _round(
    env: Exploration, learner: "PPOLearner", explorer: Explorer, obs: Tensor, config: PPOImitation
) -> tuple[Tensor, dict[str, float]]:
    """Collect and update: what is seen after it, and the losses."""
    for _ in range(config.ppo.steps):
        action = learner.act(obs)
        reward, done, time_out = env.step(explorer.targets(action), action)
        obs = explorer.flat(*env.seen)
        learner.record(obs, reward, done, time_out)
    torch.set_num_threads(config.threads)
    losses = learner.update(obs)
    torch.set_num_threads(1)
    return obs, losses


def _words(row: Mapping[str, float], samples: int) -> str:
    done, rate = row["samples"] / 1e6, row["samples"] / max(row["seconds"], 1e-9)
    told = f"reward {row['reward']:.3f}  each {row['seconds_each']:.1f} s  K {row['success']:.3f}"
    return f"{done:6.2f} of {samples / 1e6:.2f} M samples  {rate:6.0f}/s  {told}  fell {row['fell']:.2f}"


def _course(config: PPOImitation) -> dict[str, Any]:
    """What decides the course of a training; it may run longer, and be saved more or less often."""
    plain = msgspec.to_builtins(asdict(config))
    return {name: value for name, value in plain.items() if name not in ("samples", "save_every")}


LEARNER = LearnerSpec("ppo", PPOImitation, learn)
