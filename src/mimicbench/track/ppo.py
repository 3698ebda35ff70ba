"""PPO by rsl-rl. The only file that imports it, since its interface changes often."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import torch
from rsl_rl.algorithms import PPO
from rsl_rl.models import MLPModel
from rsl_rl.storage import RolloutStorage
from tensordict import TensorDict

from mimicbench.core.errors import MimicbenchError
from mimicbench.core.settings import Positive, Share, Sizes
from mimicbench.core.training import OptimizerState

WARM_COUNT = 1_000_000_000
"""Observations that the statistics of a network to begin from count as: they stay nearly as they are. Where they moved
to those of the new starts within the first million samples, a tracker of 91 % had 31 % before it had learned anything.
"""
_GROUPS = {"actor": ["obs"], "critic": ["obs"]}


@dataclass(frozen=True)
class PPOConfig:
    """Proximal policy optimization (Schulman et al. 2017)."""

    hidden: Sizes = (256, 192)
    """Widths of the hidden layers of actor and critic."""
    steps: Positive = 12
    """Control steps of every robot between updates."""
    epochs: Positive = 3
    """Passes over the collected samples."""
    minibatches: Positive = 4
    """Parts that a pass is split into."""
    gamma: Share = 0.97
    """Discount per control step."""
    lam: Share = 0.95
    """Decay of generalized advantage estimation."""
    clip: float = 0.2
    """Largest change of the probability ratio that counts."""
    entropy: float = 0.0005
    """Weight of the entropy bonus."""
    learning_rate: float = 1e-3
    """Where the optimizer starts."""
    schedule: Literal["adaptive", "fixed"] = "adaptive"
    """Whether the learning rate is adapted to the divergence below."""
    target_kl: float = 0.02
    """Divergence per update that the learning rate is adapted to."""
    critic_rate: float | None = 1e-3
    """The critic's own learning rate; None: the same. What the actor may change by is no measure for it: the better it
    is, the more of an advantage is more than noise."""
    optimizer: Literal["adam", "adamw"] = "adam"
    """AdamW decays weights by torch's default of 0.01."""
    value_weight: float = 1.0
    """Of the value loss."""
    max_grad_norm: float = 1.0
    """Longest gradient."""
    scale_rewards: bool = True
    """Multiply rewards by 1 - gamma, so that returns are of the size of one reward: the clipped value loss lets a value
    move by 0.2 per update, no more."""
    initial_std: float = 0.5
    """Standard deviation of the first actions. With 0.25 the allowed divergence makes every step so small that nothing
    is learned for millions of samples."""


class PPOLearner:
    """Actor, critic, and their updates."""

    def __init__(self, observations: int, actions: int, num_envs: int, config: PPOConfig, device: str = "cpu") -> None:
        self.config = config
        example = _wrap(torch.zeros(num_envs, observations, device=device))
        distribution = {
            "class_name": "GaussianDistribution",
            "init_std": config.initial_std,
            "std_type": "log",
            "std_range": (0.02, 1.0),
        }
        shape = {"hidden_dims": config.hidden, "activation": "elu", "obs_normalization": True}
        actor = MLPModel(example, _GROUPS, "actor", actions, **shape, distribution_cfg=distribution)
        critic = MLPModel(example, _GROUPS, "critic", 1, **shape)
        last = [layer for layer in actor.mlp.modules() if isinstance(layer, torch.nn.Linear)][-1]
        with torch.no_grad():  # the first actions are near zero: the reference itself
            last.weight *= 0.01
            last.bias.zero_()
        self.ppo = PPO(
            actor,
            critic,
            RolloutStorage("rl", num_envs, config.steps, example, [actions], device),
            num_learning_epochs=config.epochs,
            num_mini_batches=config.minibatches,
            clip_param=config.clip,
            gamma=config.gamma,
            lam=config.lam,
            entropy_coef=config.entropy,
            learning_rate=config.learning_rate,
            desired_kl=config.target_kl,
            schedule=config.schedule,
            max_grad_norm=config.max_grad_norm,
            value_loss_coef=config.value_weight,
            optimizer=config.optimizer,
            device=device,
        )
        if config.critic_rate is not None:
            self._let_critic_learn_at(config.critic_rate)
        self.ppo.train_mode()

    def _let_critic_learn_at(self, rate: float) -> None:
        """At its own rate, though rsl-rl gives every group of parameters the actor's."""
        groups = [{"params": list(model.parameters())} for model in (self.ppo.actor, self.ppo.critic)]
        self.ppo.optimizer = type(self.ppo.optimizer)(groups, lr=self.config.learning_rate)

        def correct(optimizer: torch.optim.Optimizer, *_: Any) -> None:
            optimizer.param_groups[1]["lr"] = rate

        self.ppo.optimizer.register_step_pre_hook(correct)

    @torch.no_grad()
    def act(self, obs: torch.Tensor) -> torch.Tensor:
        """Actions (N, A) with exploration, remembered for the update."""
        return self.ppo.act(_wrap(obs))

    @torch.no_grad()
    def record(self, obs: torch.Tensor, reward: torch.Tensor, done: torch.Tensor, time_out: torch.Tensor) -> None:
        """What the last actions led to."""
        scaled = reward * (1.0 - self.ppo.gamma) if self.config.scale_rewards else reward
        self.ppo.process_env_step(_wrap(obs), scaled, done, {"time_outs": time_out.float()})

    def update(self, obs: torch.Tensor, critic_alone: bool = False) -> dict[str, float]:
        """Learn from the recorded steps; `obs` is the observation after the last. Returns losses by name.

        With `critic_alone` the actor stays as it is: a critic that knows nothing would only spoil it.
        """
        with torch.no_grad():
            self.ppo.compute_returns(_wrap(obs))
        kept = {name: value.clone() for name, value in self.ppo.actor.named_parameters()} if critic_alone else {}
        losses = self.ppo.update()
        with torch.no_grad():
            for name, value in self.ppo.actor.named_parameters():
                if name in kept:
                    value.copy_(kept[name])
        return {
            **losses,
            "learning_rate": self.ppo.learning_rate,
            "std": float(self.ppo.actor.output_std.detach().mean()),
        }

    def network_tensors(self) -> dict[str, np.ndarray]:
        """The actor's mean as tensors of a TrackerNetwork."""
        return _plain_network(self.ppo.actor)

    def critic_tensors(self) -> dict[str, np.ndarray]:
        """The critic as tensors of a TrackerNetwork of one number, the value."""
        return _plain_network(self.ppo.critic)

    @torch.no_grad()
    def begin_from(
        self,
        tensors: Mapping[str, np.ndarray],
        columns: Sequence[tuple[slice, slice]],
        deviation: Sequence[float] = (),
        critic: Mapping[str, np.ndarray] | None = None,
    ) -> None:
        """Take over a trained network: wider layers keep what it does.

        Args:
            tensors: Of a TrackerNetwork with as many layers, none of them wider.
            columns: Which of its inputs are which of ours.
            deviation: Of its actions; the configuration's if empty.
            critic: Of a TrackerNetwork that told the values of what it did; without, the critic begins anew, but sees
                what it observes by the statistics of `tensors`.

        Raises:
            MimicbenchError: It has another number of layers, or wider ones.
        """
        _take_over(self.ppo.actor, tensors, columns)
        if critic is None:
            _take_statistics(self.ppo.critic, tensors, columns)
        else:
            _take_over(self.ppo.critic, critic, columns)
        if len(deviation):
            self._log_deviation.copy_(torch.tensor(deviation).log())

    @property
    def deviation(self) -> tuple[float, ...]:
        """Standard deviation of each number of the action now."""
        return tuple(self._log_deviation.detach().exp().tolist())

    @property
    def _log_deviation(self) -> torch.Tensor:
        return dict(self.ppo.actor.named_parameters())["distribution.log_std_param"]

    def state_tensors(self) -> dict[str, torch.Tensor]:
        """A copy of everything needed to go on learning; torch's own random numbers are the caller's."""
        tensors = {f"actor/{k}": v for k, v in self.ppo.actor.state_dict().items()}
        tensors |= {f"critic/{k}": v for k, v in self.ppo.critic.state_dict().items()}
        optimizer = OptimizerState(self.ppo.optimizer).state_tensors()
        tensors |= {f"optimizer/{name}": value for name, value in optimizer.items()}
        rate = torch.tensor(self.ppo.learning_rate, dtype=torch.float64)
        return {**{name: value.detach().clone() for name, value in tensors.items()}, "learning_rate": rate}

    def load_state_tensors(self, tensors: Mapping[str, torch.Tensor]) -> None:
        """The inverse of `state_tensors`."""
        parts: dict[str, dict[str, torch.Tensor]] = {"actor": {}, "critic": {}, "optimizer": {}}
        for name, value in tensors.items():
            head, _, rest = name.partition("/")
            if head in parts:
                parts[head][rest] = value
        self.ppo.actor.load_state_dict(parts["actor"])
        self.ppo.critic.load_state_dict(parts["critic"])
        OptimizerState(self.ppo.optimizer).load_state_tensors(parts["optimizer"])
        self.ppo.learning_rate = float(tensors["learning_rate"])


def _plain_network(model: MLPModel) -> dict[str, np.ndarray]:
    tensors: dict[str, Any] = {"obs_mean": model.obs_normalizer.mean, "obs_std": model.obs_normalizer.std}
    weights = {name: value for name, value in model.state_dict().items() if name.startswith("mlp.")}
    tensors |= {f"layers.{name.removeprefix('mlp.')}": value for name, value in weights.items()}
    return {name: value.detach().cpu().numpy() for name, value in tensors.items()}


def _take_statistics(
    model: MLPModel, tensors: Mapping[str, np.ndarray], columns: Sequence[tuple[slice, slice]]
) -> None:
    statistics = dict(model.obs_normalizer.named_buffers())
    given = {name: torch.from_numpy(np.array(tensors[name])) for name in ("obs_mean", "obs_std")}
    for theirs, ours in columns:
        mean, std = given["obs_mean"][theirs], given["obs_std"][theirs]
        for name, value in (("_mean", mean), ("_std", std), ("_var", std**2)):
            statistics[name][:, ours] = value
    statistics["count"].fill_(WARM_COUNT)


def _take_over(model: MLPModel, tensors: Mapping[str, np.ndarray], columns: Sequence[tuple[slice, slice]]) -> None:
    """Weights and statistics of a TrackerNetwork, whose inputs are those columns. Raises MimicbenchError."""
    own = {f"layers.{n.removeprefix('mlp.')}": v for n, v in model.named_parameters() if n.startswith("mlp.")}
    taken = {n: torch.from_numpy(np.array(value)) for n, value in tensors.items() if n.startswith("layers.")}
    if set(own) != set(taken) or any(
        own[name].shape[0] < value.shape[0] or ("0." not in name and own[name].shape[-1] < value.shape[-1])
        for name, value in taken.items()
    ):
        raise MimicbenchError(
            "the network to begin from has another number of layers than track.ppo.hidden, or wider ones; give "
            f"{len(taken) // 2 - 1} layers at least as wide as its own"
        )
    _take_statistics(model, tensors, columns)
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


def _wrap(obs: torch.Tensor) -> TensorDict:
    return TensorDict({"obs": obs}, batch_size=[len(obs)])
