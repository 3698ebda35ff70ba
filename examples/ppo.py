"""Train Stable-Baselines3's PPO in a Gymnasium environment for some minutes, and have it judged by mimicbench.

    pip install stable-baselines3 python examples/ppo.py --minutes 3 mimicbench evaluate --task touch-points
    --evaluate.policy examples/ppo.py --evaluate.episodes 20

The second command reads what the first wrote, `ppo.zip` in the working folder or wherever MIMICBENCH_PPO points. PPO
starts from the robot's rest pose (`action="residual"`), and a few minutes teach it to stand for
longer with its hands up, and no more.
"""

import argparse
import os
import time
from pathlib import Path

import gymnasium
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv

import mimicbench  # noqa: F401 makes the environments known
from mimicbench.robots.registry import ROBOTS
from mimicbench.sensors.observations import Observations

OBSERVED = ("proprio", "targets", "time")
SAVED = Path(os.environ.get("MIMICBENCH_PPO", "ppo.zip"))


class Batched(VecEnv):
    """mimicbench's vector environment as Stable-Baselines3 wants it: one that restarts at once."""

    def __init__(self, count: int) -> None:
        self.envs = gymnasium.make_vec(
            "mimicbench/TouchPoints-v0",
            num_envs=count,
            observe=OBSERVED,
            action="residual",
            reward="dense",
            max_episode_steps=75,  # of 500: who has fallen starts again soon
            autoreset_mode="SameStep",
        )
        super().__init__(count, self.envs.single_observation_space, self.envs.single_action_space)

    def reset(self) -> dict[str, np.ndarray]:
        """Begin everywhere."""
        return self.envs.reset(seed=self._seeds[0] or 0)[0]

    def step_async(self, actions: np.ndarray) -> None:
        """Take the actions of the next step."""
        self.actions = actions

    def step_wait(self) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray, list[dict]]:
        """Do it; what ended begins anew, and its last observation is in its info."""
        seen, reward, terminated, truncated, info = self.envs.step(self.actions)
        infos: list[dict] = [{} for _ in range(self.num_envs)]
        for env in np.flatnonzero(terminated | truncated).tolist():
            infos[env] = {
                "terminal_observation": info["final_obs"][env],
                "TimeLimit.truncated": bool(truncated[env]),
                "is_success": bool(info["final_info"]["is_success"][env]),
            }
        return seen, reward.astype(np.float32), terminated | truncated, infos

    def close(self) -> None:
        """Nothing is drawn."""
        self.envs.close()

    def get_attr(self, attr_name: str, indices: object = None) -> list:
        """The same of all."""
        return [getattr(self.envs, attr_name, None)] * self.num_envs

    def set_attr(self, attr_name: str, value: object, indices: object = None) -> None:
        """There is nothing to set."""
        raise NotImplementedError

    def env_method(self, method_name: str, *args: object, indices: object = None, **kwargs: object) -> list:
        """There is nothing to call."""
        raise NotImplementedError

    def env_is_wrapped(self, wrapper_class: type, indices: object = None) -> list[bool]:
        """No."""
        return [False] * self.num_envs


class ForMinutes(BaseCallback):
    """Ends training after some minutes, and keeps the mean reward of each round."""

    def __init__(self, minutes: float) -> None:
        super().__init__()
        self.until = time.monotonic() + 60 * minutes
        self.rewards: list[float] = []

    def _on_step(self) -> bool:
        return time.monotonic() < self.until

    def _on_rollout_end(self) -> None:
        self.rewards.append(float(self.model.rollout_buffer.rewards.mean()))
        print(f"{self.num_timesteps:8d} steps  reward {self.rewards[-1]:.4f}", flush=True)


def train(minutes: float, count: int = 32) -> list[float]:
    """Train, save, and return the mean reward of each round."""
    torch.set_num_threads(1)
    model = PPO(
        "MultiInputPolicy",
        Batched(count),
        n_steps=75,
        batch_size=400,
        n_epochs=8,
        gamma=0.97,
        learning_rate=3e-4,
        policy_kwargs={"log_std_init": -2.0, "net_arch": [256, 128]},
        device="cpu",
        seed=0,
    )
    watch = ForMinutes(minutes)
    model.learn(10**9, callback=watch)
    model.save(SAVED)
    return watch.rewards


class PPOPolicy:
    """The trained network as mimicbench judges it."""

    observations = OBSERVED
    gains = "improved"

    def __init__(self) -> None:
        self.model = PPO.load(SAVED, device="cpu")
        self.middle = torch.tensor(ROBOTS.get("h1").rest_pose)

    def to(self, device: str) -> None:
        """Targets go to where the physics is; the network stays on the CPU."""
        self.device = device

    def reset(self, ids: torch.Tensor, obs: Observations) -> None:
        """It remembers nothing."""

    def act(self, obs: Observations) -> torch.Tensor:
        """Joint targets (N, J) [rad]."""
        seen = {name: obs[name].cpu().numpy() for name in self.observations}
        action = self.model.predict(seen, deterministic=True)[0]
        return (torch.from_numpy(action) + self.middle).float().to(self.device)


def make_policy() -> PPOPolicy:
    """What `mimicbench evaluate --evaluate.policy examples/ppo.py` asks for."""
    return PPOPolicy()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=3.0)
    train(parser.parse_args().minutes)
