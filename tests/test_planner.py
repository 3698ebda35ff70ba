"""The planner: what it sees, how it learns, and that a kill loses nothing."""

import numpy as np
import pytest
import torch

from mimicbench.core.errors import MimicbenchError
from mimicbench.imitate.learn_planner import _Episodes, train_planner
from mimicbench.imitate.perception import Perception, PerceptionConfig, save_perception, seat_memory
from mimicbench.imitate.planner import PlannerConfig, load_planner, plan_size, save_planner
from mimicbench.objects.families.chair import make_chair
from mimicbench.references.synthesis.registry import synthesize
from mimicbench.retarget.clip import Clip
from mimicbench.retarget.methods.optimization import optimize
from mimicbench.robots.registry import ROBOTS
from mimicbench.sensors.proprioception import Odometry
from mimicbench.sim.scene import CONTROL_DT
from mimicbench.tasks.registry import TASKS
from mimicbench.track.checkpoint import Tracker, TrackerConfig, save_tracker
from mimicbench.track.env import TrackingConfig, TrackingEnv
from mimicbench.track.network import TrackerNetwork
from mimicbench.track.residual import RESIDUAL
from mimicbench.track.tracker import get_kind

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
    return motions, {chair.id: chair for chair in chairs}


def tracker() -> Tracker:
    torch.manual_seed(0)
    config = TrackerConfig("improved", 167, 19, (16,))
    return Tracker(RESIDUAL, config, TrackerNetwork(167, 19, (16,)))


def test_training_is_the_same_again_and_resumes(clips, tmp_path):
    motions, objects = clips
    first = train_planner(tmp_path / "a", ROBOT, tracker(), motions, objects, SMALL, 0, 1)
    again = train_planner(tmp_path / "b", ROBOT, tracker(), motions, objects, SMALL, 0, 2)
    for name, value in first.state_dict().items():
        assert torch.equal(value, again.state_dict()[name]), name
    resumed = train_planner(tmp_path / "a", ROBOT, tracker(), motions, objects, SMALL, 0, 1)
    assert all(torch.equal(value, resumed.state_dict()[name]) for name, value in first.state_dict().items())


def test_refuses_a_tracker_that_it_cannot_plan_for(clips, tmp_path):
    motions, objects = clips
    other = Tracker(get_kind("paper"), TrackerConfig("paper", 578, 19, (16,)), TrackerNetwork(578, 19, (16,)))
    with pytest.raises(MimicbenchError, match="preset 'improved'"):
        train_planner(tmp_path, ROBOT, other, motions, objects, SMALL, 0, 1)


def test_checkpoint_round_trip(clips, tmp_path):
    motions, objects = clips
    network = train_planner(tmp_path / "training", ROBOT, tracker(), motions, objects, SMALL, 0, 1)
    save_planner(tmp_path / "planner", ROBOT, network, SMALL, {})
    save_tracker(tmp_path / "tracker", ROBOT, tracker().config, tracker().network.tensors(), {})
    save_perception(tmp_path / "perception", Perception(PerceptionConfig(widths=(4, 4, 4), hidden=8)), ROBOT.name)
    policy = load_planner(tmp_path / "planner", ROBOT)
    inputs = torch.randn(3, network.input_mean.numel())
    assert torch.equal(policy._network.plan(inputs), network.plan(inputs))
    assert network.plan(inputs).shape == (3, plan_size(19))


def test_memory_in_training_is_what_the_robot_would_carry(clips):
    """The seat that a training robot remembers is where odometry from the start of the clip says it is."""
    motions, objects = clips
    quiet = TrackingConfig(first_frame=1.0, start_pos_noise=0, start_angle_noise=0, start_vel_noise=0, push=0)
    env = TrackingEnv(RESIDUAL, ROBOT, motions, objects, 4, quiet, 0, 1)
    episodes = _Episodes(env, objects, torch.zeros(2, 0), 0)
    odometry = Odometry(4)
    odometry.reset(torch.arange(4), env.moment.state)
    for _ in range(25):
        env.step(torch.zeros(4, 19))
        odometry.update(env.moment.state, CONTROL_DT)
    carried = seat_memory(episodes._seen, odometry.pos, odometry.yaw)
    np.testing.assert_allclose(episodes.inputs()[:, -10:].numpy(), carried.numpy(), atol=5e-3)
