"""PPO by rsl-rl. The only file that imports it, since its interface changes often."""

import math
from collections.abc import Mapping, Sequence
from copy import deepcopy
from typing import Any

import numpy as np
import torch
from rsl_rl.algorithms import PPO
from rsl_rl.models import MLPModel
from rsl_rl.storage import RolloutStorage
from tensordict import TensorDict

from mimicbench.core.training import MovingAverage, OptimizerState
from mimicbench.track.learning.muon import MuonAndAdam
from mimicbench.track.learning.ppo_config import DEVIATIONS, PPOConfig, check_rounds
from mimicbench.track.learning.warm_start import plain_network, take_over, take_statistics
from mimicbench.track.network import Blueprint

_GROUPS = {"actor": ["obs"], "critic": ["obs"]}


class _Model(MLPModel):
    """Layers of a blueprint as rsl-rl knows models: with statistics of what they see, and a distribution around what
    they give.
    """

    def __init__(self, example: TensorDict, role: str, outputs: int, blueprint: Blueprint, **more: Any) -> None:
        with torch.random.fork_rng(devices=[]):  # the layers that rsl-rl draws are not kept
            super().__init__(
                example, _GROUPS, role, outputs, (1,), obs_normalization=blueprint.config.normalizes, **more
            )
        self.mlp = blueprint.layers(outputs)
        if blueprint.config.normalizes:  # each input by itself: some may be new to a network to begin from
            self.obs_normalizer.register_buffer("count", torch.zeros(1, blueprint.inputs, dtype=torch.long))


class PPOLearner:
    """Actor, critic, and their updates."""

    def __init__(
        self, blueprint: Blueprint, actions: int, num_envs: int, config: PPOConfig, device: str = "cpu"
    ) -> None:
        self.config, self.blueprint = config, blueprint
        check_rounds(config, num_envs)
        example = _wrap(torch.zeros(num_envs, blueprint.inputs, device=device))
        distribution = {
            "class_name": "GaussianDistribution",
            "init_std": config.initial_std,
            "std_type": "log",
            "std_range": DEVIATIONS,
        }
        actor = _Model(example, "actor", actions, blueprint, distribution_cfg=distribution)
        critic = _Model(example, "critic", 1, blueprint)
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
            optimizer="adam" if config.optimizer == "muon" else config.optimizer,
            device=device,
        )
        if config.optimizer == "muon":
            self.ppo.optimizer = MuonAndAdam((self.ppo.actor, self.ppo.critic), config.learning_rate)
        if config.critic_rate is not None:
            self._let_critic_learn_at(config.critic_rate)
        self.ppo.train_mode()
        self._begin_averaging()

    def _begin_averaging(self) -> None:
        self.average, self.averaged = MovingAverage(self.ppo.actor.mlp, self.config.average), 0

    def _let_critic_learn_at(self, rate: float) -> None:
        """At its own rate, though rsl-rl gives every group of parameters the actor's."""
        if self.config.optimizer != "muon":
            groups = [{"params": list(model.parameters())} for model in (self.ppo.actor, self.ppo.critic)]
            self.ppo.optimizer = type(self.ppo.optimizer)(groups, lr=self.config.learning_rate)

        def correct(optimizer: torch.optim.Optimizer, *_: Any) -> None:
            groups = optimizer.param_groups  # the actor's, then the critic's
            for group in groups[len(groups) // 2 :]:
                group["lr"] = rate

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
        kept = self._actors_state() if critic_alone else []
        rate = self.ppo.learning_rate
        losses = self.ppo.update()
        with torch.no_grad():
            # beyond an end the deviation has no gradient any more, and would stay there
            self._log_deviation.clamp_(*(math.log(end) for end in DEVIATIONS))
        if critic_alone:
            self._put_back(kept, rate)
        else:
            self.averaged += 1
            self.average.follow(self.ppo.actor.mlp, self.averaged)
        return {
            **losses,
            "learning_rate": self.ppo.learning_rate,
            "std": float(self.ppo.actor.output_std.detach().mean()),
        }

    def _actors_state(self) -> list[tuple[torch.nn.Parameter, torch.Tensor, Any]]:
        """Each of the actor's parameters, a copy, and the optimizer's moments of it; None before its first step."""
        moments = self.ppo.optimizer.state
        return [(p, p.detach().clone(), deepcopy(moments.get(p))) for p in self.ppo.actor.parameters()]

    @torch.no_grad()
    def _put_back(self, kept: list[tuple[torch.nn.Parameter, torch.Tensor, Any]], rate: float) -> None:
        """What was kept, and the learning rate, which goes by how far the actor moves."""
        for parameter, value, moments in kept:
            parameter.copy_(value)
            if moments is None:
                self.ppo.optimizer.state.pop(parameter, None)
            else:
                self.ppo.optimizer.state[parameter] = moments
        self.ppo.learning_rate = rate
        for group in self.ppo.optimizer.param_groups:
            group["lr"] = rate

    def network_tensors(self) -> dict[str, np.ndarray]:
        """The actor's mean, by the moving average of its weights, as tensors of a TrackerNetwork."""
        averages = {f"layers.{name}": value.cpu().numpy() for name, value in self.average.values.items()}
        return plain_network(self.ppo.actor) | averages

    def critic_tensors(self) -> dict[str, np.ndarray]:
        """The critic as tensors of a TrackerNetwork of one number, the value."""
        return plain_network(self.ppo.critic)

    @torch.no_grad()
    def begin_from(
        self,
        tensors: Mapping[str, np.ndarray],
        columns: Sequence[tuple[slice, slice]],
        deviation: Sequence[float] = (),
        critic: Mapping[str, np.ndarray] | None = None,
    ) -> None:
        """Take over a trained network: wider layers of an MLP keep what it does.

        Args:
            tensors: Of a TrackerNetwork with as many layers, none of them wider; of any other kind than an MLP, with
                the same layers and inputs.
            columns: Which of its inputs are which of ours.
            deviation: Of its actions; the configuration's if empty.
            critic: Of a TrackerNetwork that told the values of what it did; without, the critic begins anew, but sees
                what it observes by the statistics of `tensors`.

        Raises:
            MimicbenchError: It has other layers, or wider ones.
        """
        widens = self.blueprint.config.widens
        take_over(self.ppo.actor, tensors, columns, widens)
        if critic is None:
            take_statistics(self.ppo.critic, tensors, columns)
        else:
            take_over(self.ppo.critic, critic, columns, widens)
        if len(deviation):
            self._log_deviation.copy_(torch.tensor(deviation).clamp(*DEVIATIONS).log())
        self._begin_averaging()

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
        tensors |= {f"average/{name}": value for name, value in self.average.state_tensors().items()}
        rate = torch.tensor(self.ppo.learning_rate, dtype=torch.float64)
        told = {"learning_rate": rate, "averaged": torch.tensor(self.averaged)}
        return {**{name: value.detach().clone() for name, value in tensors.items()}, **told}

    def load_state_tensors(self, tensors: Mapping[str, torch.Tensor]) -> None:
        """The inverse of `state_tensors`."""
        parts: dict[str, dict[str, torch.Tensor]] = {name: {} for name in ("actor", "critic", "optimizer", "average")}
        for name, value in tensors.items():
            head, _, rest = name.partition("/")
            if head in parts:
                parts[head][rest] = value
        self.ppo.actor.load_state_dict(parts["actor"])
        self.ppo.critic.load_state_dict(parts["critic"])
        OptimizerState(self.ppo.optimizer).load_state_tensors(parts["optimizer"])
        self.average.load_state_tensors(parts["average"])
        self.averaged = int(tensors.get("averaged", 0))  # a training that began before there were averages has none
        self.ppo.learning_rate = float(tensors["learning_rate"])


def _wrap(obs: torch.Tensor) -> TensorDict:
    return TensorDict({"obs": obs}, batch_size=[len(obs)])
