"""What can be observed: every term has its shape at every task and robot, and nobody is judged by what robots cannot
sense.
"""

import math

import numpy as np
import pytest
import torch

from mimicbench.core import rotations as rot
from mimicbench.core.errors import MimicbenchError, UnknownName
from mimicbench.core.motion import RobotMotion
from mimicbench.drawing.opengl import NoPictures
from mimicbench.envs.clips import ClipSet
from mimicbench.envs.initial_states import InitialState, stacked
from mimicbench.envs.policy import refuse_privileged
from mimicbench.envs.reference import ReferenceBank
from mimicbench.envs.vec_env import EnvConfig, VecEnv
from mimicbench.evaluate.rollout import run_policy
from mimicbench.objects.registry import make_object
from mimicbench.robots.registry import ROBOTS
from mimicbench.sensors.observations import (
    TERMS,
    LazyObservations,
    Observations,
    Term,
    chosen_terms,
)
from mimicbench.sim.rows import Rows
from mimicbench.tasks.registry import TASKS
from stool import H1, block, standing

DRAWN = ("color", "labels")
POS, JOINTS = standing()


def standing_by(robot, task, count=3):
    """An environment of robots of a kind that stand before objects of a task's family, with a clip to follow."""
    objects = [make_object(f"{task.family}-0-{i:05d}") for i in range(count)]
    joints, frames, zeros = np.array(robot.rest_pose, float), 30, np.zeros(3)
    goal = np.array([[0.3, 0.2, 1.0], [0.3, -0.2, 1.0]]) if task.wrist_goals else np.zeros((0, 3))
    motion = RobotMotion(
        "rest",
        task.name,
        robot.name,
        robot.joint_names,
        50.0,
        np.tile([-1.5, 0.0, 1.0], (frames, 1)),
        np.tile(rot.IDENTITY, (frames, 1)),
        np.tile(joints, (frames, 1)),
        objects[0].id,
        "rest",
    )
    states = [
        InitialState(obj, np.array([-1.5, 0.1 * i, 1.05]), rot.IDENTITY, joints, zeros, zeros, 0 * joints, goal)
        for i, obj in enumerate(objects)
    ]
    env = VecEnv(task, robot, objects, EnvConfig(workers=1, camera_size=(16, 24)), bank=ReferenceBank([motion], robot))
    env.reset(Rows.every(count), stacked(states, env.physics))
    return env


@pytest.mark.parametrize("robot", list(ROBOTS))
@pytest.mark.parametrize("task", list(TASKS))
def test_every_term_has_its_shape(task, robot):
    task, robot = TASKS.get(task), ROBOTS.get(robot)
    env = standing_by(robot, task)
    terms = chosen_terms(list(TERMS), task)
    obs, ids = env.observe(terms), torch.tensor([2, 0])
    for term in terms:
        sizes = iter((16, 24))
        shape = tuple(next(sizes) if length < 0 else length for length in term.shape(robot, task))
        try:
            some = obs.of(term.name, ids)  # worked out alone, where that is cheaper
            found = obs[term.name]
        except NoPictures:
            assert term.name in DRAWN
            continue
        assert found.shape == (3, *shape) and found.dtype == term.dtype, term.name
        assert torch.equal(some, found[ids]), f"{term.name} of some is that of all"
        assert torch.equal(obs.of(term.name, ids), some)
        assert float(found.min()) >= term.low and float(found.max()) <= term.high, term.name
    names = ["proprio", "targets", "time"]
    numbers = sum(math.prod(term.shape(robot, task)) for term in chosen_terms(names, task))
    assert obs.flat([name for name in names if name in obs]).shape == (3, numbers)
    env.close()


def test_terms_that_a_task_does_not_have_are_left_out():
    names = ("proprio", "targets", "object+1")
    assert [term.name for term in chosen_terms(names, TASKS.get("sit-chair"))] == ["proprio"]
    assert [term.name for term in chosen_terms(names, TASKS.get("touch-points"))] == ["proprio", "targets"]
    assert [term.name for term in chosen_terms(names, TASKS.get("lift-box"))] == ["proprio", "object+1"]
    with pytest.raises(UnknownName, match="smell"):
        chosen_terms(["smell"], TASKS.get("sit-chair"))


def test_terms_are_computed_when_looked_up_and_once():
    calls = []

    def compute(context):
        calls.append(1)
        return torch.zeros(context.num_envs, 2)

    term = Term("own", lambda robot, task: (2,), compute)
    env = standing_by(H1, TASKS.get("sit-chair"))
    obs = env.observe([term, "time"])
    assert isinstance(obs, LazyObservations) and list(obs) == ["own", "time"] and not calls
    assert obs["own"].shape == (3, 2) and obs.of("own", torch.tensor([1])).shape == (1, 2)
    assert calls == [1]
    with pytest.raises(MimicbenchError, match="'state' was not asked for"):
        obs["state"]
    assert obs.get("targets") is None, "a policy for several tasks may ask"


def test_arrays_are_observed_as_running_episodes_are():
    env = standing_by(H1, TASKS.get("sit-chair"))
    names = ("proprio", "time", "odometry", "heightmap")
    running = env.observe(names)
    given = Observations.from_arrays({name: running[name].numpy() for name in names})
    assert list(given) == list(names) and given.num_envs == running.num_envs == 3 and len(given) == 4
    ids = torch.tensor([2, 1])
    for name in names:
        assert torch.equal(given[name], running[name])
        assert torch.equal(given.of(name, ids), running.of(name, ids))
    assert torch.equal(given.flat(["proprio", "time"]), running.flat(["proprio", "time"]))
    with pytest.raises(MimicbenchError, match="not asked for"):
        given["state"]


class Cheat:
    """A policy that wants to know what no robot knows."""

    gains = "improved"

    def __init__(self, *observations):
        self.observations = observations

    def to(self, device):
        pass

    def reset(self, ids, obs):
        pass

    def act(self, obs):
        raise AssertionError("it should never have been asked")


PRIVILEGED = [name for name, term in TERMS.items() if term.privileged]


def test_who_is_judged_senses_for_himself():
    assert {"root_pose", "object", "body_target", "reference+1", "reference+5", "object+1"} <= set(PRIVILEGED)
    assert not {"proprio", "state", "elevation", "odometry", "targets", "time"} & set(PRIVILEGED)
    clips = ClipSet(TASKS.get("sit-chair"), H1, [], {block().id: block()})
    for name in PRIVILEGED:
        with pytest.raises(MimicbenchError, match="no robot can sense"):
            run_policy(Cheat("proprio", name), clips)
    refuse_privileged([name for name in TERMS if name not in PRIVILEGED], "this policy")
