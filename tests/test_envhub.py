"""The environment for the Hub of LeRobot: the function that it calls, and what that has to give."""

import importlib.util
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

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
    actions = np.zeros(envs.action_space.shape, np.float32)
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
    assert names == [(task.replace("-", " "),) * 2 for task in TASKS if task in TASKS.first]
    for i, size in ((0, 49), (4, 55)):
        seen = stepped(envs[i])
        assert seen["agent_pos"].shape == (2, size)
        picture = seen["pixels"]["elevation"]
        assert picture.shape == (2, 128, 128, 3) and picture.dtype == np.uint8
        assert 0 < picture.min() < 60 < picture.max() < 255, "the floor and the object are within the picture's range"
        assert envs[i].single_action_space.low.min() == -1 and envs[i].call("_max_episode_steps")[0] in (500, 1000)
    for each in envs.values():
        each.close()


def test_the_same_in_processes_of_their_own(hub):
    (here,) = hub.make_env(n_envs=2, cfg=Config("sit-chair"))["mimicbench"].values()
    (there,) = hub.make_env(n_envs=2, use_async_envs=True, cfg=Config("sit-chair"))["mimicbench"].values()
    own, other = stepped(here), stepped(there)
    assert np.array_equal(own["agent_pos"], other["agent_pos"])
    assert np.array_equal(own["pixels"]["elevation"], other["pixels"]["elevation"])
    here.close()
    there.close()


def test_a_task_that_there_is_not_is_refused(hub):
    with pytest.raises(ValueError, match="no task 'fly'; choose from sit-chair"):
        hub.make_env(cfg=Config("fly"))
