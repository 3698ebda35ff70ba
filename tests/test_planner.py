"""The planner: what it sees, how it learns, and that a kill loses nothing."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from mimicbench.core.errors import MimicbenchError
from mimicbench.envs.clip_starts import ClipStartConfig
from mimicbench.envs.clips import ClipSet
from mimicbench.envs.vec_env import EnvConfig
from mimicbench.imitate.learn_planner import _Episodes, train_planner
from mimicbench.imitate.perception import Perception, PerceptionConfig, save_perception, seat_memory
from mimicbench.imitate.planner import PlannerConfig, load_planner, save_planner
from mimicbench.objects.families.chair import make_chair
from mimicbench.references.synthesis.registry import synthesize
from mimicbench.retarget.clip import Clip
from mimicbench.retarget.methods.optimization import optimize
from mimicbench.robots.registry import ROBOTS
from mimicbench.tasks.registry import TASKS
from mimicbench.track.checkpoint import TrackerConfig, build_tracker, save_tracker
from mimicbench.track.network import TrackerNetwork
from mimicbench.track.registry import TRACKERS
from mimicbench.track.spec import Layout, Tracker
from mimicbench.track.trackers.residual import ResidualConfig
from mimicbench.track.tracking import TrackingConfig, TrackingEnv

ROBOT, TASK = ROBOTS.get("h1"), TASKS.get("sit-chair")
SMALL = PlannerConfig(
    hidden=(16,), samples=8 * 4 * 3, num_envs=8, steps=4, batches=2, batch=16, memory=256, save_every=0.0
)


@pytest.fixture(scope="module")
def clips():
    chairs = [make_chair(index) for index in range(2)]
    motions = [
        optimize(Clip(synthesize("sit-chair", index, chair, 0), chair, ROBOT)) for index, chair in enumerate(chairs)
    ]
    return ClipSet(TASK, ROBOT, motions, {chair.id: chair for chair in chairs})


LAYOUT = Layout.of(TRACKERS.get("residual"), ROBOT, [TASK])
SHAPE = TrackerConfig("residual", LAYOUT.names, LAYOUT.widths, 19, (16,))


def tracker() -> Tracker:
    torch.manual_seed(0)
    return build_tracker(SHAPE, TrackerNetwork(167, 19, (16,)).tensors())


def test_training_is_the_same_again_whatever_the_threads(clips, tmp_path):
    first = train_planner(tmp_path / "a", tracker(), clips, SMALL, 0, EnvConfig(workers=1))
    again = train_planner(tmp_path / "b", tracker(), clips, SMALL, 0, EnvConfig(workers=2))
    for name, value in first.state_dict().items():
        assert torch.equal(value, again.state_dict()[name]), name
    finished = train_planner(tmp_path / "a", tracker(), clips, SMALL, 0, EnvConfig(workers=1))
    assert all(torch.equal(value, finished.state_dict()[name]) for name, value in first.state_dict().items())


class Killed(Exception):
    """As by a signal, between two rounds."""


def test_a_training_killed_in_the_middle_ends_in_the_same_bytes(clips, tmp_path):
    longer = replace(SMALL, samples=8 * 4 * 30, save_every=0.0)
    whole = train_planner(tmp_path / "whole", tracker(), clips, longer, 0, EnvConfig(workers=1))

    def kill(row):
        if row["round"] == 20:
            raise Killed

    with pytest.raises(Killed):
        train_planner(tmp_path / "killed", tracker(), clips, longer, 0, EnvConfig(workers=1), kill)
    resumed = train_planner(tmp_path / "killed", tracker(), clips, longer, 0, EnvConfig(workers=1))
    for name, value in whole.state_dict().items():
        assert torch.equal(value, resumed.state_dict()[name]), name


def test_another_training_is_not_taken_up(clips, tmp_path):
    train_planner(tmp_path, tracker(), clips, SMALL, 0, EnvConfig(workers=1))
    with pytest.raises(MimicbenchError, match="another seed"):
        train_planner(tmp_path, tracker(), clips, SMALL, 1, EnvConfig(workers=1))


def test_refuses_a_tracker_that_it_cannot_plan_for(clips, tmp_path):
    layout = Layout.of(TRACKERS.get("hst"), ROBOT, [TASK])
    shape = TrackerConfig("hst", layout.names, layout.widths, 19, (16,))
    other = build_tracker(shape, TrackerNetwork(578, 19, (16,)).tensors())
    with pytest.raises(MimicbenchError, match="observes 'body'"):
        train_planner(tmp_path, other, clips, SMALL, 0, EnvConfig(workers=1))
    assert not list(tmp_path.iterdir()), "a refused call leaves nothing behind"


def test_checkpoint_round_trip(clips, tmp_path):
    network = train_planner(tmp_path / "training", tracker(), clips, SMALL, 0, EnvConfig(workers=1))
    save_planner(tmp_path / "planner", ROBOT, network, SMALL, {})
    save_tracker(tmp_path / "tracker", ROBOT, SHAPE, tracker().network.tensors(), {})
    eyes = Perception(PerceptionConfig(widths=(4, 4, 4), hidden=8), TASKS.get("sit-chair"))
    save_perception(tmp_path / "perception", eyes, ROBOT.name)
    policy = load_planner(tmp_path / "planner", ROBOT, TASK)
    inputs = torch.randn(3, network.input_mean.numel())
    assert torch.equal(policy._network.plan(inputs), network.plan(inputs))
    assert network.plan(inputs).shape == (3, 2 * (12 + 2 * 19))


def test_memory_in_training_is_what_the_robot_would_carry(clips):
    """The seat that a training robot remembers is where odometry from the start of the clip says it is."""
    quiet = TrackingConfig(ClipStartConfig(1.0, 0.0, 0.0, 0.0), push=0.0)
    env = TrackingEnv(TRACKERS.get("residual"), clips, 4, quiet, 0, EnvConfig(workers=1))
    episodes = _Episodes(env, torch.zeros(2, 0), 0)
    for _ in range(25):
        env.step(torch.zeros(4, 19), ResidualConfig())
    carried = seat_memory(episodes._seen, env.context.odometry_pos, env.context.odometry_yaw)
    np.testing.assert_allclose(episodes.inputs()[:, -10:].numpy(), carried.numpy(), atol=5e-3)
