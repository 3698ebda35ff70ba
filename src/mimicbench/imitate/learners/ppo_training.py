"""PPO from nothing: collect, update, save, go on where it stopped."""

import time
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import torch
from torch import Tensor

from mimicbench.core.checkpoint import beside
from mimicbench.core.progress import Pulse
from mimicbench.core.seeds import digest
from mimicbench.core.training import TorchRandom, append_metrics, check_losses, resume_training, save_training
from mimicbench.envs.vec_env import EnvConfig
from mimicbench.imitate.exploring.episodes import Exploration
from mimicbench.imitate.goals import known_goal
from mimicbench.imitate.learned import save_learner
from mimicbench.imitate.learners.ppo import PPOImitation, PPONetworkConfig
from mimicbench.imitate.networks.ppo import Explorer
from mimicbench.imitate.policy import Senses
from mimicbench.imitate.spec import Given
from mimicbench.track.learning.ppo_config import ppo_learner

if TYPE_CHECKING:
    from mimicbench.track.learning.ppo import PPOLearner

REPORT_EVERY = 10
"""Updates between the lines of `metrics.jsonl`."""


def explore(folder: Path, given: Given, config: PPOImitation) -> dict[str, Any]:
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
