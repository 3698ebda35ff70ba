"""Learning without references: what episodes are worth and when they end, PPO at every task, and the same bytes after
it was stopped.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

import making
from mimicbench.benchmark import keys, run_stage
from mimicbench.benchmark.graph import start
from mimicbench.benchmark.presets import PRESETS, Chosen
from mimicbench.benchmark.recipe import read_recipe
from mimicbench.benchmark.who import who_of
from mimicbench.core.errors import MimicbenchError, UnknownName
from mimicbench.envs.clips import ClipSet
from mimicbench.envs.nearness import nearness
from mimicbench.envs.vec_env import EnvConfig
from mimicbench.evaluate.rollout import run_policy
from mimicbench.imitate.exploring.episodes import Exploration
from mimicbench.imitate.learners.ppo import ExploreConfig, PPOImitation, PPONetworkConfig, learn
from mimicbench.imitate.policy import Senses, VisionPolicy
from mimicbench.imitate.settings.encoder import EncoderConfig
from mimicbench.imitate.settings.inputs import InputConfig
from mimicbench.imitate.spec import Given
from mimicbench.objects.registry import FAMILIES
from mimicbench.policies.loading import load_policy
from mimicbench.robots.registry import ROBOTS
from mimicbench.sim.timing import CONTROL_DT
from mimicbench.tasks.registry import TASKS
from mimicbench.track.learning.ppo import PPOConfig

ROBOT, ONE, SIT = ROBOTS.get("h1"), EnvConfig(workers=1), TASKS.get("sit-chair")
TINY_MAP = EncoderConfig(pool=8, widths=(4,), blocks=(1,), strides=(1,))
COUNT, STEPS = 4, 4
ROUND = COUNT * STEPS
"""Samples of a round of the smallest training."""


def objects_of(task, count=4):
    """Training objects and no clips."""
    made = (FAMILIES.get(task.family).make(index, 0) for index in range(4 * count))
    return ClipSet(task, ROBOT, [], {obj.id: obj for obj in [obj for obj in made if obj.split == "train"][:count]})


def tiny(rounds, convolves=False, inputs=None):
    """The smallest training."""
    network = PPONetworkConfig(
        inputs=inputs or InputConfig(), encoder=TINY_MAP, convolves=convolves, features=4, hidden=(8,)
    )
    ppo = PPOConfig(steps=STEPS, epochs=1, minibatches=2, gamma=0.99)
    explore = ExploreConfig(num_envs=COUNT, starts=6)
    return PPOImitation(network=network, ppo=ppo, explore=explore, samples=rounds * ROUND, threads=1)


def exploration(task=SIT, **config):
    """Episodes, whose robots see no maps."""
    senses = Senses(InputConfig(elevation=False).on(ROBOT))
    explore = ExploreConfig(**{"num_envs": COUNT, "starts": 6, **config})
    return Exploration(objects_of(task), senses, "improved", explore, 0, ONE)


REST = torch.tensor(ROBOT.rest_pose).repeat(COUNT, 1)


def test_a_step_is_worth_what_is_near_and_came_nearer():
    episodes = exploration(approach=3.0, change=0.5)
    assert episodes.env.metrics is not None
    near = [nearness(episodes.env)]
    actions = [torch.zeros(COUNT, 19), torch.full((COUNT, 19), 0.2)]
    rewards = []
    for action in actions:
        reward, done, time_out = episodes.step(REST + action, action)
        assert not done.any() and not time_out.any()
        rewards.append(reward.numpy())
        near.append(nearness(episodes.env))
    for step, haste in enumerate((0.0, 19 * 0.2**2)):
        expected = near[step + 1] + 3.0 * np.log(near[step + 1] / near[step]) - 0.5 * haste
        np.testing.assert_allclose(rewards[step], expected, atol=1e-4)
    told = episodes.told()
    assert told["near"] == pytest.approx(np.mean(near[1:]), abs=1e-4) and told["episodes"] == 0
    assert episodes.told()["reward"] == 0, "it is told once"


def test_who_falls_begins_again_elsewhere_for_nothing():
    episodes, collapse = exploration(), REST + torch.linspace(-1.5, 1.5, 19)
    ended = torch.zeros(COUNT, dtype=torch.bool)
    for _ in range(150):
        before = episodes.env.steps.clone()
        reward, done, time_out = episodes.step(collapse, torch.zeros(COUNT, 19))
        assert not time_out.any() and (reward[done] == 0).all()
        assert (episodes.env.steps == torch.where(done, 0, before + 1)).all()
        upright = episodes.env.context.state.root_pos_w[done, 2]
        assert (upright > 0.9).all(), "it stands again"
        ended |= done
    told = episodes.told()
    assert ended.all() and told["fell"] == 1 and told["episodes"] >= COUNT and told["success"] == 0
    assert 0.2 < told["seconds_each"] < 3


def test_time_ends_episodes_and_is_no_failure():
    episodes = exploration()
    episodes.env.steps += round(SIT.time_limit / CONTROL_DT) - 1
    _, done, time_out = episodes.step(REST, torch.zeros(COUNT, 19))
    assert done.all() and time_out.all() and episodes.told()["fell"] == 0


@pytest.mark.parametrize("name", list(TASKS))
def test_every_task_can_be_tried(name, tmp_path):
    """From objects to a policy that runs, without a clip or a tracker."""
    recipe = making.small(name, objects=8, imitate=tiny(2, convolves=name == "touch-points"))
    stage = run_stage("imitate", recipe, tmp_path, making.QUIET)
    assert {path.name for path in (tmp_path / name).iterdir()} == {"objects", "imitate"}, "nothing else was made"
    assert stage.summary["samples"] == 2 * ROUND and not (stage.folder / keys.TRACKER).exists()
    task = TASKS.get(name)
    found = who_of(start(recipe, tmp_path, making.QUIET), "ppo")
    policy = load_policy(found.folder, ROBOT, task)
    assert isinstance(policy, VisionPolicy)
    assert ("target_elevation" in policy.observations) == task.goal.given and policy.gains == "improved"
    clips = objects_of(task)
    env = Exploration(clips, Senses(policy.learner.inputs), "improved", ExploreConfig(4, 4), 0, ONE)
    target = policy.learner.predict(*env.seen)
    assert target.shape == (4, 19) and torch.isfinite(target).all()
    assert (target - REST).abs().max() < 1.0, "around the rest pose"


@pytest.mark.parametrize("inputs", [InputConfig(), InputConfig(body="proprio", clock=True, history=2)])
def test_a_training_that_was_stopped_ends_in_the_same_bytes(inputs, tmp_path):
    given = Given(objects_of(SIT), None, 0, "improved", making.QUIET)

    def train(folder: Path, *rounds: int) -> tuple[bytes, list[dict]]:
        for count in rounds:
            learn(folder / "policy", given, tiny(count, inputs=inputs))
        lines = (folder / "policy" / "metrics.jsonl").read_text().splitlines()
        rows = [json.loads(line) for line in lines]
        return (folder / "policy" / "model.safetensors").read_bytes(), [{**row, "seconds": 0} for row in rows]

    whole, rows = train(tmp_path / "whole", 11)
    stopped, other = train(tmp_path / "stopped", 4, 11)
    assert whole == stopped and rows[-1]["surrogate"] == other[-1]["surrogate"]
    assert train(tmp_path / "whole", 11)[0] == whole, "there is nothing left to learn"
    with pytest.raises(MimicbenchError, match="another config"):
        learn(tmp_path / "whole" / "policy", given, replace(tiny(12, inputs=inputs), threads=2))


def test_it_is_judged_as_all_are(tmp_path):
    given = Given(objects_of(SIT), None, 0, "improved", making.QUIET)
    learn(tmp_path / "policy", given, tiny(1))
    from test_policies import clip_set

    clips = clip_set(2, 0.1)
    (run,) = run_policy(load_policy(tmp_path / "policy", ROBOT, SIT), clips, env_config=ONE)
    assert not run.errors and not run.verdict.success.any()


def test_gains_are_the_robots_and_said(tmp_path):
    with pytest.raises(UnknownName, match="improved, paper"):
        read_recipe({"imitate": {"learner": "ppo", "gains": "soft"}})
    tree = PRESETS["paper"](Chosen("sit-sofa", "ppo"))
    imitate = read_recipe({"task": "sit-sofa", **tree}).imitate
    assert isinstance(imitate, PPOImitation) and imitate.gains == "paper" and imitate.network.convolves
    assert imitate.network.blueprint.inputs > 128 * 128 and not imitate.references
