"""How PPO learns. Who only uses what was learned needs none of what it learns with (extra `[train]`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

from mimicbench.core.errors import MimicbenchError
from mimicbench.core.settings import BadSetting, Later, Positive, Share, Sizes, Within

if TYPE_CHECKING:
    from mimicbench.track.learning.ppo import PPOLearner


DEVIATIONS = (0.02, 1.0)
"""Least and largest standard deviation of a number of the action."""


@dataclass(frozen=True)
class PPOConfig:
    """Proximal policy optimization (Schulman et al. 2017)."""

    hidden: Sizes = (256, 192)
    """Widths of the hidden layers of actor and critic, where they are such layers: a design may have other networks."""
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
    optimizer: Literal["adam", "adamw", "muon"] = "adam"
    """AdamW decays weights by torch's default of 0.01; Muon is for the weights of layers, with Adam for the rest."""
    average: Annotated[float, Within(0, 1), Later()] = 0.0
    """Decay, per update, of the moving average of the actor's weights, which is what is judged and kept; 0: the last
    weights."""
    value_weight: float = 1.0
    """Of the value loss."""
    max_grad_norm: float = 1.0
    """Longest gradient."""
    scale_rewards: bool = True
    """Multiply rewards by 1 - gamma, so that returns are of the size of one reward: the clipped value loss lets a value
    move by 0.2 per update, no more."""
    initial_std: Annotated[float, Within(*DEVIATIONS)] = 0.5
    """Standard deviation of the first actions. With 0.25 the allowed divergence makes every step so small that nothing
    is learned for millions of samples."""


def check_rounds(config: PPOConfig, num_envs: int) -> None:
    """Raises BadSetting if a round of so many robots has not a sample for each minibatch."""
    if num_envs * config.steps < config.minibatches:
        raise BadSetting(
            f"{num_envs} robots and {config.steps} steps are less than one sample for each of ppo.minibatches "
            f"{config.minibatches}; give more robots or steps, or fewer minibatches"
        )


def ppo_learner() -> type[PPOLearner]:
    """The class that learns. Raises MimicbenchError if what it needs is not installed."""
    try:
        from mimicbench.track.learning.ppo import PPOLearner
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in ("rsl_rl", "tensordict"):
            raise
        raise MimicbenchError(
            f"training by PPO needs {error.name}, which is not installed; run `pip install 'mimicbench[train]'`"
        ) from None
    return PPOLearner
