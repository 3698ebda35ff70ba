"""Train Stable-Baselines3's PPO in a Gymnasium environment, and have it judged by mimicbench.

    pip install stable-baselines3
    python examples/ppo.py --minutes 60
    python examples/ppo.py --try 200
    mimicbench evaluate --task touch-points --policy examples/ppo.py --episodes 100

The third command tries it in episodes of Gymnasium beside unseen objects, the last in those of the benchmark. Both read
what the second wrote, `ppo.zip` in the working folder or wherever MIMICBENCH_PPO points. runs/ppo-sb3/README.md tells
what an hour teaches.
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

OBSERVED = ("proprio", "targets")
SAVED = Path(os.environ.get("MIMICBENCH_PPO", "ppo.zip"))


def environments(count: int, **more: object) -> gymnasium.vector.VectorEnv:
    """Robots that stand in front of household objects, and what they have to touch."""
    return gymnasium.make_vec(
        "mimicbench/TouchPoints-v0",
        num_envs=count,
        observe=OBSERVED,
        action="residual",
        reward="dense",
        autoreset_mode="Disabled",
        **more,
    )


class Batched(VecEnv):
    """mimicbench's vector environment as Stable-Baselines3 wants it: what ends begins anew at once.

    Here a fall ends an episode too: who lies on the floor learns nothing any more.
    """

    def __init__(self, count: int, workers: int = 0) -> None:
        self.envs = environments(count, workers=workers)
        self.steps, self.rewards = np.zeros((2, count))
        super().__init__(count, self.envs.single_observation_space, self.envs.single_action_space)

    def reset(self) -> dict[str, np.ndarray]:
        """Begin everywhere."""
        return self.envs.reset(seed=self._seeds[0] or 0)[0]

    def step_async(self, actions: np.ndarray) -> None:
        """Take the actions of the next step."""
        self.actions = actions

    def step_wait(self) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray, list[dict]]:
        """Do it; what is over begins anew, and its last observation is in its info."""
        seen, reward, terminated, truncated, facts = self.envs.step(self.actions)
        failed = terminated | facts["fell"]
        over = failed | truncated
        self.steps, self.rewards = self.steps + 1, self.rewards + reward
        infos: list[dict] = [{} for _ in range(self.num_envs)]
        for env in np.flatnonzero(over).tolist():
            infos[env] = {
                "terminal_observation": {name: values[env] for name, values in seen.items()},
                "TimeLimit.truncated": not failed[env],
                "is_success": bool(facts["is_success"][env]),
                "episode": {"r": float(self.rewards[env]), "l": int(self.steps[env])},
            }
        if over.any():
            self.steps[over] = self.rewards[over] = 0.0
            seen = self.envs.reset(options={"reset_mask": over})[0]
        return seen, reward.astype(np.float32), over, infos

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
    """Ends training after some minutes; saves it every half a minute, and says how the last hundred episodes went."""

    def __init__(self, minutes: float) -> None:
        super().__init__()
        self.began = self.said = time.monotonic()
        self.until = self.began + 60 * minutes
        self.rewards: list[float] = []

    def _on_step(self) -> bool:
        return time.monotonic() < self.until

    def _on_rollout_end(self) -> None:
        self.rewards.append(float(self.model.rollout_buffer.rewards.mean()))
        now, last = time.monotonic(), self.model.ep_info_buffer
        if last and (now - self.said >= 30 or now >= self.until):
            self.said = now
            self.model.save(SAVED)
            print(
                f"{(now - self.began) / 60:5.1f} min {self.num_timesteps:8d} steps, reward {self.rewards[-1]:.3f};"
                f" episodes: {np.mean([one['l'] for one in last]) / 50:5.2f} s,"
                f" return {np.mean([one['r'] for one in last]):6.1f}, K {np.mean(self.model.ep_success_buffer):.2f}",
                flush=True,
            )


def train(minutes: float, count: int = 128, workers: int = 0, go_on: bool = False) -> list[float]:
    """Train, save, and return the mean reward of each round; `go_on` takes up what was saved."""
    torch.set_num_threads(1)
    envs = Batched(count, workers)
    model = PPO.load(SAVED, envs, device="cpu") if go_on else beginner(envs)
    watch = ForMinutes(minutes)
    model.learn(10**9, callback=watch, reset_num_timesteps=not go_on)
    model.save(SAVED)
    return watch.rewards


def beginner(envs: VecEnv) -> PPO:
    """PPO that has learned nothing yet."""
    return PPO(
        "MultiInputPolicy",
        envs,
        n_steps=32,
        batch_size=1024,
        n_epochs=5,
        gamma=0.99,  # what comes in two seconds counts a third: a fall takes one
        learning_rate=1e-4,
        target_kl=0.02,
        policy_kwargs={"log_std_init": -2.5, "net_arch": [256, 128], "activation_fn": torch.nn.ELU},
        device="cpu",
        seed=0,
    )


def attempt(count: int, learned: bool) -> str:
    """What N whole episodes beside unseen objects come to: of the trained network, or of who holds the rest pose."""
    envs = environments(count, split="test")
    seen = envs.reset(seed=0)[0]
    model = PPO.load(SAVED, device="cpu") if learned else None
    over, reward = np.zeros(count, bool), np.zeros(count)
    while not over.all():
        actions = model.predict(seen, deterministic=True)[0] if model else np.zeros(envs.action_space.shape)
        seen, gained, terminated, truncated, facts = envs.step(actions)
        reward, over = reward + gained, terminated | truncated
    envs.close()
    return (
        f"K {facts['success'].sum()} of {count}, stays {facts['stays'].sum()},"
        f" falls {facts['fell'].sum()}, return {reward.mean():.1f}"
    )


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
    """What `mimicbench evaluate --policy examples/ppo.py` asks for."""
    return PPOPolicy()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--workers", type=int, default=0, help="threads that step the physics; 0: all processors")
    parser.add_argument("--go-on", action="store_true", help="take up what was saved")
    parser.add_argument("--try", type=int, dest="tried", help="train nothing: try what was trained in N episodes")
    chosen = parser.parse_args()
    if chosen.tried:
        print("trained:  ", attempt(chosen.tried, learned=True))
        print("rest pose:", attempt(chosen.tried, learned=False))
    else:
        train(chosen.minutes, workers=chosen.workers, go_on=chosen.go_on)
