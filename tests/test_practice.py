"""Planners that practise: what straying and power cost, that practice begins as the planner that was shown how, what
robots remember meanwhile, and the same bytes after it was stopped.
"""

from dataclasses import replace

import numpy as np
import pytest
import torch

import making
from learning import clip_of, shape_of, tracker
from mimicbench.envs.vec_env import EnvConfig
from mimicbench.evaluate.rollout import run_policy
from mimicbench.imitate.exploring.episodes import Exploration, ExploreConfig
from mimicbench.imitate.goals import known_goal
from mimicbench.imitate.learners.reinforced import (
    SHOWN,
    PlannedTargets,
    Planner,
    PlannerSenses,
    ReinforcedImitation,
    learn,
)
from mimicbench.imitate.perception import Perception, PerceptionConfig, save_perception
from mimicbench.imitate.planner import PlannerConfig, load_planner, read_planner
from mimicbench.imitate.spec import Given
from mimicbench.policies.loading import load_policy
from mimicbench.robots.registry import ROBOTS
from mimicbench.tasks.registry import TASKS
from mimicbench.track.checkpoint import save_tracker
from mimicbench.track.ppo_config import PPOConfig
from test_exploring import COUNT, REST, ROUND, STEPS, exploration

H1, ONE = ROBOTS.get("h1"), EnvConfig(workers=1)


def tiny(rounds, **explore):
    """The smallest planner, and so many rounds of practice."""
    return ReinforcedImitation(
        planner=PlannerConfig(hidden=(16,), samples=32, num_envs=4, steps=4, batches=1, batch=8, memory=64),
        ppo=PPOConfig(hidden=(8,), steps=STEPS, epochs=1, minibatches=2),
        explore=ExploreConfig(**{"num_envs": COUNT, "starts": 6, "stray": 0.1, "power": 0.1, **explore}),
        samples=rounds * ROUND,
        threads=1,
    )


def given(folder, name):
    """Clips of a task, and what is beside where the policy is to be."""
    task = TASKS.get(name)
    shape = shape_of("residual", task)
    save_tracker(folder / "tracker", H1, shape, tracker(shape).network.tensors(), {})
    if not task.goal.given:
        eyes = Perception(PerceptionConfig(widths=(4, 4, 4), hidden=8), task)
        save_perception(folder / "perception", eyes, H1.name)
    return Given(clip_of(task), None, 0, "improved", making.QUIET)


def test_power_and_straying_have_a_price():
    free, dear = exploration(change=0.0), exploration(change=0.0, power=0.5, stray=0.1)
    action, shown = torch.full((COUNT, 19), 0.3), torch.full((COUNT, 19), 0.1)
    reward, _, _ = free.step(REST + action, action)
    other, _, _ = dear.step(REST + action, action, shown)
    effort = dear.env.physics.effort.numpy()
    assert (effort > 0).all()
    expected = reward.numpy() - 0.5 * np.log1p(effort / 1e6) - 0.1 * 19 * 0.2**2
    np.testing.assert_allclose(other.numpy(), expected, atol=1e-4)


@pytest.mark.parametrize("name", list(TASKS))
def test_practice_begins_as_the_planner(name, tmp_path):
    """The one network gives the joint targets of the planner over its tracker, in every frame."""
    whole, task = given(tmp_path, name), TASKS.get(name)
    told = learn(tmp_path / "policy", whole, tiny(0))
    assert told["clips"] == len(whole.clips) and told["samples"] == 0
    policies = [load_planner(tmp_path / folder, H1, task) for folder in ("policy", SHOWN)]
    shape = shape_of("residual", task)
    following = tracker(shape)
    network = PlannedTargets(H1, task, read_planner(tmp_path / SHOWN, H1, task, following.spec), following)
    senses = PlannerSenses(network, following, known_goal(tmp_path / "perception", H1, task))
    student = Planner(H1, network, senses, tiny(0))
    env = Exploration(whole.clips, senses, "improved", ExploreConfig(COUNT, 4), 0, ONE)
    for policy in policies:
        policy.to("cpu")
    for step in range(4):
        obs = env.env.observe(policies[0].observations)
        if step == 0:
            for policy in policies:
                policy.reset(torch.arange(COUNT), obs)
        with torch.no_grad():
            action = network(env.seen[0])
        target = student.targets(action, env.env.context.state.joint_pos)
        for policy in policies:
            torch.testing.assert_close(policy.act(obs), target, atol=1e-4, rtol=0)
        env.step(target, action)
    assert (student.shown()(env.seen[0]) == network(env.seen[0])).all()


def test_what_practised_is_judged_as_all_are(tmp_path):
    whole = given(tmp_path, "touch-points")
    learn(tmp_path / "policy", whole, tiny(1))
    policy = load_policy(tmp_path / "policy", H1, whole.clips.task)
    short = replace(whole.clips, task=replace(whole.clips.task, time_limit=0.1))
    assert not run_policy(policy, short, env_config=ONE)[0].errors


@pytest.mark.parametrize("stray", [0.0, 0.1])
def test_a_practice_that_was_stopped_ends_in_the_same_bytes(stray, tmp_path):
    found = []
    for name, rounds in (("whole", (12,)), ("stopped", (3, 12))):
        folder = tmp_path / name
        folder.mkdir()
        for count in rounds:
            learn(folder / "policy", given(folder, "sit-chair"), tiny(count, stray=stray))
        found.append((folder / "policy" / "model.safetensors").read_bytes())
        begun = (folder / SHOWN / "model.safetensors").read_bytes()
        assert found[-1] != begun, "the critic learns alone for ten rounds, then all do"
    assert found[0] == found[1]
    trackers = [(tmp_path / name / "tracker" / "model.safetensors").read_bytes() for name in ("whole", "stopped")]
    assert trackers[0] == trackers[1]
