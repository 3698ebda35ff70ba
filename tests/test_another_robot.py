"""Learners on a robot with other joints, links and sizes than the one that they were made on."""

from dataclasses import replace

import pytest
import torch

import making
from learning import ONE, clip_of, shape_of, tracker
from mimicbench.evaluate.rollout import run_policy
from mimicbench.imitate import cloning
from mimicbench.imitate.demos import demonstrations, scene_terms
from mimicbench.imitate.learn_planner import train_planner
from mimicbench.imitate.learners.act import ACTImitation
from mimicbench.imitate.learners.bc import BCImitation
from mimicbench.imitate.learners.planner import PlannerConfig
from mimicbench.imitate.planner import save_planner
from mimicbench.imitate.settings.cloning import TrainConfig
from mimicbench.imitate.settings.encoder import EncoderConfig
from mimicbench.imitate.spec import Given
from mimicbench.imitate.stored.demo_writer import DemoWriter
from mimicbench.policies.loading import load_policy
from mimicbench.robots.registry import ROBOTS
from mimicbench.sensors.scene import PICTURE
from mimicbench.tasks.registry import TASKS
from mimicbench.track.checkpoint import save_tracker
from mimicbench.track.rollout import RolloutConfig, track_clips

G1, TASK = ROBOTS.get("g1"), TASKS.get("touch-points")
SHAPE = shape_of("residual", TASK, robot=G1)
TINY = EncoderConfig(pool=4, widths=(8, 8, 8, 8), blocks=(1, 1, 1, 1))
NETWORKS = {
    ACTImitation: {"hidden": 32, "feedforward": 32, "heads": 2, "chunk": 5, "latent": 4},
    BCImitation: {"hidden": 64, "reduce": (8,)},
}


@pytest.fixture(scope="module")
def clips():
    return clip_of(TASK, robot=G1)


@pytest.fixture(scope="module")
def demos(clips, tmp_path_factory):
    """What a tracker that has learned nothing did along the clip, kept as if it had done it."""
    shown = (*scene_terms(TASK), PICTURE)
    rollout = track_clips(tracker(SHAPE), clips, RolloutConfig(record=True, settle=0.1, observe=shown), ONE)
    done = torch.ones_like(rollout.verdict.success)
    rollout = replace(rollout, verdict=replace(rollout.verdict, success=done, stays=done))
    folder = tmp_path_factory.mktemp("demos")
    writer = DemoWriter(folder, G1.name, TASK.title, G1.joint_names)
    for demo in demonstrations(rollout, clips, 0):
        writer.add(demo)
    writer.finish()
    return folder


def acts(folder, clips):
    """The policy of a folder drives the robot for a tenth of a second, with as many targets as it has joints."""
    policy = load_policy(folder, G1, TASK)
    (run,) = run_policy(policy, replace(clips, task=replace(TASK, time_limit=0.1)), env_config=ONE)
    assert not run.errors and run.verdict.steps.tolist() == [5] and not run.verdict.diverged.any()


@pytest.mark.parametrize("imitation", NETWORKS, ids=lambda kind: kind().learner)
def test_demonstrations_are_cloned(imitation, clips, demos, tmp_path):
    network = replace(imitation().network, encoder=TINY, **NETWORKS[imitation])
    config = imitation(network=network, train=TrainConfig(steps=2, batch=8))
    cloning.clone(tmp_path / "policy", Given(clips, demos, 0, "improved", making.QUIET), config)
    acts(tmp_path / "policy", clips)


def test_plans_are_learned(clips, tmp_path):
    config = PlannerConfig(hidden=(16,), samples=32, num_envs=4, steps=4, batches=1, batch=8, memory=64)
    network = train_planner(tmp_path / "training", tracker(SHAPE), [clips], config, 0, ONE)
    save_planner(tmp_path / "planner", G1, network, config, {})
    save_tracker(tmp_path / "tracker", G1, SHAPE, tracker(SHAPE).network.tensors(), {})
    acts(tmp_path / "planner", clips)
