"""The environment for the Hub of LeRobot: the function that it calls, and what that has to give."""

import importlib.util
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from mimicbench.core import rotations as rot
from mimicbench.core.errors import UnknownName
from mimicbench.envs.lerobot.seen import make_one
from mimicbench.robots.registry import ROBOTS
from mimicbench.tasks.registry import TASKS

FILE = Path(__file__).parents[1] / "examples" / "envhub" / "env.py"


@dataclass(frozen=True)
class Config:
    """As far as the function looks at LeRobot's."""

    task: str | None = None


@pytest.fixture(scope="module")
def hub():
    """The file as LeRobot loads it: run, and not known to Python by any name."""
    spec = importlib.util.spec_from_file_location("hub_env", FILE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def stepped(envs, steps=2):
    seen, info = envs.reset(seed=3)
    actions = np.tile(np.float32(ROBOTS.get("h1").rest_pose), (2, 1))
    for _ in range(steps):
        seen, reward, terminated, truncated, info = envs.step(actions)
        assert reward.shape == terminated.shape == truncated.shape == (2,)
    assert envs.observation_space.contains(seen)
    assert not info["is_success"].any()
    return seen


def test_every_task_for_two_environments(hub):
    suites = hub.make_env(n_envs=2)
    assert list(suites) == ["mimicbench"]
    envs = suites["mimicbench"]
    assert list(envs) == list(range(6))
    names = [envs[i].call("task_description") for i in envs]
    assert names == [(TASKS.get(task).title,) * 2 for task in TASKS if task in TASKS.first]
    for i, size in ((0, 12), (4, 18)):
        seen = stepped(envs[i])
        assert seen["agent_pos"].shape == (2, 300) and seen["environment_state"].shape == (2, size)
        picture = seen["pixels"]["elevation"]
        assert picture.shape == (2, 128, 128, 3) and picture.dtype == np.uint8
        assert 0 < picture.min() < 60 < picture.max() < 255, "the floor and the object are within the picture's range"
        assert envs[i].call("_max_episode_steps")[0] in (500, 1000)
    for each in envs.values():
        each.close()


def test_the_same_in_processes_of_their_own(hub):
    (here,) = hub.make_env(n_envs=2, cfg=Config("sit-chair"))["mimicbench"].values()
    (there,) = hub.make_env(n_envs=2, use_async_envs=True, cfg=Config("sit-chair"))["mimicbench"].values()
    own, other = stepped(here), stepped(there)
    for name in ("agent_pos", "environment_state"):
        assert np.array_equal(own[name], other[name])
    assert np.array_equal(own["pixels"]["elevation"], other["pixels"]["elevation"])
    here.close()
    there.close()


def test_a_task_that_there_is_not_is_refused(hub):
    with pytest.raises(UnknownName, match="fly"):
        hub.make_env(cfg=Config("fly"))
    with pytest.raises(UnknownName, match="fly"):
        make_one("fly")


def test_who_stands_before_a_chair_sees_where_it_is():
    """By hand: the middle of the box around it, turned into the frame of a root that looks at it, and its half size."""
    env = make_one("sit-chair", split="train")
    seen, _ = env.reset(seed=5)
    episodes = env.unwrapped.episodes
    low, high = episodes.starts[0].obj.bounds()
    pos, quat = np.split(episodes.qpos()[0, :7], [3])
    center, turned, half = np.split(seen["environment_state"], [3, 9])
    np.testing.assert_allclose(rot.rotate(quat, center) + pos, (low + high) / 2, atol=1e-5)
    np.testing.assert_allclose(half, (high - low) / 2, atol=1e-6)
    x_axis = rot.rotate(quat, turned[:3])
    np.testing.assert_allclose(x_axis, [1, 0, 0], atol=1e-5)  # it faces +x, and stands still
    assert seen["agent_pos"].dtype == seen["environment_state"].dtype == np.float32 and "pixels" not in seen
    env.close()
