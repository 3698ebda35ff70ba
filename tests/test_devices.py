"""`--device`: whole episodes of environments, trackers and policies on both physics backends, and what is said where
there is no such device.

What needs Warp runs only where MuJoCo Warp is installed and `MIMICBENCH_WARP=1` is set, as in test_warp.py; on a GPU
too, if torch finds one.
"""

import importlib.util
import os
import sys
from dataclasses import replace

import numpy as np
import pytest
import torch

import stool
from mimicbench import cli
from mimicbench.benchmark import Recipe
from mimicbench.benchmark.graph import start
from mimicbench.benchmark.shipped import SHIPPED
from mimicbench.core import rotations as rot
from mimicbench.core.errors import MimicbenchError, UnknownName
from mimicbench.core.run import RunContext
from mimicbench.envs.clips import ClipSet
from mimicbench.envs.gym import TaskEnv
from mimicbench.envs.gym_vector import TaskVectorEnv
from mimicbench.envs.vec_env import EnvConfig
from mimicbench.evaluate.rollout import run_policy
from mimicbench.imitate.demos import observed_states
from mimicbench.imitate.learners.planner import PlannerConfig
from mimicbench.policies.loading import load_policy
from mimicbench.sensors import arrays
from mimicbench.sensors.proprioception import s_current
from mimicbench.sim.backends import make_physics
from mimicbench.sim.devices import tensor_device
from mimicbench.tasks.sit_chair import TASK as SIT_CHAIR
from mimicbench.track.checkpoint import load_tracker
from mimicbench.track.learning.ppo import PPOConfig
from mimicbench.track.registry import TRACKERS
from mimicbench.track.rollout import RolloutConfig, track_clips
from mimicbench.track.settings import TrackConfig, TrackingConfig
from mimicbench.track.tracking import TrackingEnv
from mimicbench.track.train import train_tracker
from stool import H1, block, seated, standing
from tracked import still

HAS_WARP = importlib.util.find_spec("mujoco_warp") is not None
DEVICES = ["warp-cpu", *(["cuda"] if torch.cuda.is_available() else [])]
on_warp = pytest.mark.skipif(
    not HAS_WARP or os.environ.get("MIMICBENCH_WARP") != "1",
    reason="set MIMICBENCH_WARP=1 to test the Warp backend (minutes)",
)
on_every_device = pytest.mark.parametrize("device", DEVICES)
STOOL = block()
TOLERANCE = 2e-4
"""[m, rad, m/s, rad/s] Measured within the 0.3 to 0.6 s of these episodes: 3e-5 of velocities, 2e-6 of positions;
effort 8e-5 of itself."""
SHIPPED_TRACKER = SHIPPED / "sit-chair" / "tracker"


CLIPS = ClipSet(SIT_CHAIR, H1, [still(standing(), "stands", 12), still(seated(0.42), "sits", 12)], {STOOL.id: STOOL})


def sits():
    return replace(CLIPS, motions=CLIPS.motions[1:])


@pytest.mark.parametrize(
    ("device", "tensors"), [("cpu", "cpu"), ("warp-cpu", "cpu"), ("cuda", "cuda"), ("cuda:1", "cuda:1")]
)
def test_where_tensors_live(device, tensors):
    assert tensor_device(device) == tensors


@pytest.mark.parametrize("stage", ["track", "demos", "imitate", "evaluate", "run", "bench", "bench world"])
def test_an_unknown_device_is_told_at_once(stage, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["mimicbench", *stage.split(), "--device", "tpu"])
    with pytest.raises(SystemExit) as left:
        cli.main()
    told = capsys.readouterr()
    assert left.value.code == 2 and told.out == ""
    assert "mimicbench: unknown device 'tpu'" in told.err and "cuda:1" in told.err and "warp-cpu" in told.err
    assert not list(tmp_path.iterdir())


def test_an_environment_knows_its_devices():
    for make in (lambda: TaskEnv("sit-chair", device="tpu"), lambda: TaskVectorEnv("sit-chair", 2, device="cuda:x")):
        with pytest.raises(UnknownName, match="warp-cpu"):
            make()


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_a_missing_gpu_is_told_at_once(tmp_path):
    for make in (
        lambda: TaskEnv("sit-chair", device="cuda"),
        lambda: start(Recipe(), tmp_path, RunContext(device="cuda:1")),
    ):
        with pytest.raises(MimicbenchError, match="--device cpu"):
            make()


def test_recorded_states_are_those_that_were_felt():
    physics = make_physics("cpu", H1, [STOOL] * 3, workers=1)
    random = np.random.default_rng(0)
    pos, joints = standing()
    targets = joints + 0.1 * random.normal(size=(3, 19)).astype(np.float32)
    stool.put(
        physics,
        np.arange(3),
        np.tile(pos, (3, 1)),
        rot.from_yaw(random.normal(size=3)),
        targets,
        random.normal(size=(3, 3)),
        random.normal(size=(3, 3)),
        random.normal(size=(3, 19)),
    )
    last = torch.zeros(3, 19)
    last[1:] = torch.as_tensor(targets[:-1])
    felt = s_current(physics.state(), physics.links(), last)
    np.testing.assert_array_equal(observed_states(H1, physics.qpos(), physics.qvel(), targets), felt.numpy())


def episode(env, steps):
    """Observations, ends and infos of a batch that holds its rest pose, swaying."""
    robot = env.episodes.robot
    seen = [(*env.reset(seed=3), 0)]
    for step in range(steps):
        action = np.array(robot.rest_pose) + 0.1 * np.sin(step / 5 + np.arange(19))
        observation, _, terminated, truncated, info = env.step(np.tile(action, (env.num_envs, 1)).astype(np.float32))
        seen.append((observation, info, terminated + 2 * truncated))
    return seen


@on_warp
@on_every_device
@pytest.mark.parametrize("task", ["sit-chair", "touch-points", "lift-box"])
def test_an_environment_is_the_same_on_both(task, device):
    arguments = {
        "observe": ("proprio", "state", "time", "elevation"),
        "time_limit": 0.2,
        "autoreset_mode": "SameStep",
        "pool": 12,
    }
    both = [episode(TaskVectorEnv(task, 3, device=name, **arguments), 15) for name in ("cpu", device)]
    ends = 0
    for (ours, our_info, our_end), (theirs, their_info, their_end) in zip(*both, strict=True):
        assert list(ours) == list(theirs)
        np.testing.assert_array_equal(our_end, their_end)
        ends += int(np.sum(our_end) > 0)
        for name in ("start", "seed", "success", "fell", "diverged"):
            np.testing.assert_array_equal(our_info[name], their_info[name])
        np.testing.assert_allclose(our_info["effort"], their_info["effort"], rtol=1e-3, atol=1e-3)
        for name, values in ours.items():
            assert theirs[name].dtype == values.dtype == np.float32
            differs = abs(values - theirs[name]) > TOLERANCE
            # a ray along an edge may meet what is behind it, and a point on the border of two cells be in the other
            assert differs.mean() <= (0.001 if name == "elevation" else 0), name
    assert ends == 1, "the time was over once, and other objects came"


@on_warp
@on_every_device
def test_a_single_environment_is_the_same_on_both(device):
    both = [TaskEnv("sit-chair", device=name, split="test", pool=12) for name in ("cpu", device)]
    for seed in (0, 1):
        (ours, our_info), (theirs, their_info) = (env.reset(seed=seed) for env in both)
        assert our_info == their_info
        for _ in range(5):
            ours, theirs = (env.step(np.array(H1.rest_pose, np.float32))[0] for env in both)
        for name, values in ours.items():
            np.testing.assert_allclose(theirs[name], values, atol=TOLERANCE)


@on_warp
@on_every_device
def test_a_tracker_follows_the_same_way_on_both(device):
    tracker, config = load_tracker(SHIPPED_TRACKER, H1), RolloutConfig(record=True, settle=0.4)
    ours, theirs = (track_clips(tracker, CLIPS, config, EnvConfig(name, 1)) for name in ("cpu", device))
    assert ours.verdict.success.tolist() == theirs.verdict.success.tolist() == [False, True]
    np.testing.assert_array_equal(ours.steps, theirs.steps)
    np.testing.assert_allclose(theirs.verdict.effort, ours.verdict.effort, rtol=1e-3)
    for clip in range(2):
        np.testing.assert_allclose(theirs.recording.qpos[clip], ours.recording.qpos[clip], atol=TOLERANCE)
        np.testing.assert_allclose(theirs.recording.targets[clip], ours.recording.targets[clip], atol=TOLERANCE)


@on_warp
@on_every_device
def test_a_policy_is_judged_alike_on_both(device):
    clips = replace(CLIPS, task=replace(SIT_CHAIR, time_limit=0.4))
    planner = SHIPPED / "sit-chair" / "planner"
    ours, theirs = (
        run_policy(load_policy(planner, H1, SIT_CHAIR), clips, record=[0, 1], env_config=EnvConfig(name, 1))[0]
        for name in ("cpu", device)
    )
    np.testing.assert_array_equal(ours.verdict.success, theirs.verdict.success)
    np.testing.assert_allclose(theirs.start_distance, ours.start_distance, atol=1e-6)
    for clip in range(2):
        np.testing.assert_allclose(theirs.recordings[clip], ours.recordings[clip], atol=TOLERANCE)


@on_warp
@on_every_device
def test_a_tracker_and_a_planner_learn_on_warp(device, tmp_path):
    from mimicbench.imitate.learn_planner import train_planner

    tiny = PPOConfig(hidden=(16,), steps=8, epochs=1, minibatches=2)
    config = TrackConfig(samples=2 * 8 * tiny.steps, num_envs=8, evaluate_clips=2, ppo=tiny)
    rows, there = [], EnvConfig(device, 1)
    folder = train_tracker(tmp_path / "track", [CLIPS], [sits()], config, 0, there, rows.append)
    assert rows[-1]["samples"] == config.samples and rows[-1]["k_held_out"] == 1.0
    small = PlannerConfig(
        hidden=(16,), samples=4 * 8 * 2, num_envs=8, steps=4, batches=2, batch=16, memory=64, threads=1
    )
    train_planner(tmp_path / "planner", load_tracker(folder, H1), [CLIPS], small, 0, there)
    assert (tmp_path / "planner" / "training.safetensors").exists()


class Asked(AssertionError):
    """Somebody waited for the device."""


@pytest.fixture
def nobody_asks(monkeypatch):
    """Every way to read a tensor on the host raises, as each would stop a GPU."""

    def refuse(name):
        def asked(self, *args, **kwargs):
            raise Asked(f"Tensor.{name} on the way of a step")

        return asked

    for name in ("cpu", "numpy", "item", "tolist", "nonzero", "__bool__", "__int__", "__float__", "__array__"):
        monkeypatch.setattr(torch.Tensor, name, refuse(name))


@on_warp
def test_no_step_of_training_asks_the_device(monkeypatch, request):
    # tensors that live on the CPU may be looked at as arrays for nothing; on a GPU the same terms work on tensors
    using = [module for module in sys.modules.values() if getattr(module, "own", None) is arrays.own]
    assert len(using) > 3
    for module in using:
        monkeypatch.setattr(module, "own", lambda *tensors: (torch, list(tensors)))
    env = TrackingEnv(TRACKERS.get("residual"), CLIPS, 4, TrackingConfig(), 0, EnvConfig("warp-cpu"))
    action = torch.zeros(4, len(H1.joints))
    settings = TrackConfig().resolved().settings
    env.step(action, settings)
    request.getfixturevalue("nobody_asks")
    for _ in range(3):
        env.step(action, settings)
