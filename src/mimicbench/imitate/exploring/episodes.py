"""N robots that try a task, over and over: each episode is beside a training object drawn anew, from a start by rule.

With d the length [m] that the condition of K still lacks (`Task.shortfalls`), and a the action, a step is worth

    r = exp(-d) + approach (d_before - d) - change |a - a_before|^2,

the dense reward of the Gymnasium environments, what a step came nearer (Ng et al. 1999: it changes no policy's rank as
long as nobody falls), and a price of haste. A fall is worth nothing, and ends the episode; time ends it, too, but there
is a value beyond. K ends none, so that holding on pays.
"""

from collections.abc import Mapping
from dataclasses import replace

import torch
from torch import Tensor

from mimicbench.core.seeds import digest
from mimicbench.envs.clips import ClipSet
from mimicbench.envs.initial_states import InitialStates, stacked
from mimicbench.envs.nearness import nearness
from mimicbench.envs.rule_starts import Starts
from mimicbench.envs.vec_env import EnvConfig, VecEnv
from mimicbench.imitate.learners.ppo import ExploreConfig
from mimicbench.imitate.policy import Senses
from mimicbench.sensors.observations import Observations
from mimicbench.sim.physics import PhysicsConfig, RobotState
from mimicbench.sim.rows import Rows
from mimicbench.sim.timing import CONTROL_DT

TOLD = ("episodes", "fell", "success", "frames", "reward", "near", "steps")
"""What is counted of training: episodes that ended, falls and K among them, their frames; and the sums of mean reward
and mean nearness over control steps, with the number of these."""


class Exploration:
    """Steps all robots together; episodes that end start again at once."""

    def __init__(
        self, clips: ClipSet, senses: Senses, gains: str, config: ExploreConfig, seed: int, env_config: EnvConfig
    ) -> None:
        """`clips` has the task, the robot and the objects; `senses` are the robots' own; `env_config` says which device
        and how many threads.
        """
        task, robot, objects = clips.task, clips.robot, list(clips.objects.values())
        drawn = Starts(task, robot, "train", objects, len(objects), None)
        states = [drawn.draw(digest(seed, "start", number) % (1 << 63))[0] for number in range(config.starts)]
        physics = PhysicsConfig(gains=gains, meshes=any(obj.hulls for obj in objects))
        env_config = replace(env_config, physics=physics, judged=True, measure_effort=False)
        first = torch.arange(config.num_envs) % len(states)
        self.env = VecEnv(task, robot, [states[number].obj for number in first.tolist()], env_config, seed)
        self.device, self.senses, self.config = self.env.device, senses, config
        self.senses.to(self.device)
        self._starts = stacked(states, self.env.physics)
        self._limit = round(task.time_limit / CONTROL_DT)
        self.random = torch.Generator(self.device).manual_seed(digest(seed, "exploration") % (1 << 63))
        every = Rows.every(config.num_envs, self.device)
        self.env.reset(every, _chosen(self._starts, first.to(self.device)))
        self._near = self._nearness()
        self._told = torch.zeros(len(TOLD), dtype=torch.float64, device=self.device)
        obs = self._sense(every.ids)
        self.seen = self.senses.see(obs)
        """What all robots see now: vectors (N, size) and maps (N, channels, 128, 128), see Senses."""

    def step(self, target: Tensor, action: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Apply joint targets (N, J) [rad], which were made of an action (N, A), and see what comes of it.

        Returns reward (N,), done (N,) bool, and time_out (N,) bool: done because time is over.
        """
        env, metrics, before = self.env, self.env.metrics, self.env.last_action
        assert metrics is not None
        env.step(target, action)
        near = self._nearness()
        failed = metrics.fell | metrics.diverged
        time_out = (env.steps >= self._limit) & ~failed
        done = failed | time_out
        approached = torch.log(near.clamp(min=1e-6)) - torch.log(self._near.clamp(min=1e-6))  # d_before - d
        haste = (action - before).square().sum(-1) * (env.steps > 1)
        reward = near + self.config.approach * approached - self.config.change * haste
        reward = torch.where(failed, 0.0, reward)
        counts = (done, done & failed, done & metrics.success, env.steps * done)
        means = (reward.mean(), near.mean(), near.new_ones(()))
        self._told += torch.stack([*(count.sum().double() for count in counts), *(mean.double() for mean in means)])
        self._near = near
        self._begin_again(done)
        return reward, done, time_out

    def told(self) -> dict[str, float]:
        """Of the training since this was asked last: what a step is worth, and what episodes come to."""
        told = dict(zip(TOLD, self._told.tolist(), strict=True))
        self._told = torch.zeros_like(self._told)
        episodes, steps = max(told["episodes"], 1.0), max(told["steps"], 1.0)
        shares = {name: told[name] / episodes for name in ("fell", "success")}
        means = {name: told[name] / steps for name in ("reward", "near")}
        return {**means, "episodes": told["episodes"], **shares, "seconds_each": CONTROL_DT * told["frames"] / episodes}

    def _begin_again(self, done: Tensor) -> None:
        """Put robots whose episodes are over on other starts; then all look around."""
        rows = self.env.rows(done)
        if len(rows):
            chosen = torch.randint(len(self._starts.clip), (len(rows),), generator=self.random, device=self.device)
            self.env.reset(rows, _chosen(self._starts, chosen))
            self._near = torch.where(done, self._nearness(), self._near)
        self.seen = self.senses.see(self._sense(done.nonzero()[:, 0]))

    def _sense(self, begun: Tensor) -> Observations:
        """What all robots observe now, of which `begun` (n,) have just begun an episode."""
        obs = self.env.observe(self.senses.observations)
        if len(begun):
            self.senses.begin(begun, obs)
        return obs

    def _nearness(self) -> Tensor:
        """(N,) how near the condition of K is to holding."""
        return torch.from_numpy(nearness(self.env)).float().to(self.device)

    def state_tensors(self) -> dict[str, Tensor]:
        """All that decides how the episodes go on, between steps."""
        vector, maps = self.seen
        found = {"near": self._near.clone(), "told": self._told.clone(), "starts": self.random.get_state()}
        found |= {"vector": vector.clone(), **({} if maps is None else {"maps": maps.clone()})}
        parts = {"env": self.env.state_tensors(), "senses": self.senses.memory()}
        return found | {f"{part}/{name}": value for part, held in parts.items() for name, value in held.items()}

    def load_state_tensors(self, tensors: Mapping[str, Tensor]) -> None:
        """The inverse of `state_tensors`, in episodes made alike."""
        held: dict[str, dict[str, Tensor]] = {"env": {}, "senses": {}}
        for name, value in tensors.items():
            part, _, rest = name.partition("/")
            if part in held:
                held[part][rest] = value
        self.env.load_state_tensors(held["env"])
        self.senses.remember({name: value.to(self.device) for name, value in held["senses"].items()})
        self._near, self._told = tensors["near"].to(self.device), tensors["told"].to(self.device)
        self.random.set_state(tensors["starts"].cpu())
        maps = tensors["maps"].to(self.device) if "maps" in tensors else None
        self.seen = tensors["vector"].to(self.device), maps

    def close(self) -> None:
        """Give everything back."""
        self.env.close()


def _chosen(states: InitialStates, ids: Tensor) -> InitialStates:
    """Some of many initial states, in the order of `ids` (n,)."""
    robot = RobotState(**{name: value[ids] for name, value in vars(states.robot).items()})
    return InitialStates(
        states.object_index[ids], robot, None, states.wrist_goal_w[ids], states.clip[ids], states.frame[ids]
    )
