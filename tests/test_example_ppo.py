"""The example that trains Stable-Baselines3's PPO: a few rounds of it, and the judge's verdict on what it made."""

import importlib.util
from pathlib import Path

import pytest
import torch

from mimicbench.core import rotations as rot
from mimicbench.core.motion import RobotMotion
from mimicbench.envs.clips import ClipSet
from mimicbench.envs.vec_env import EnvConfig
from mimicbench.evaluate.rollout import run_policy
from mimicbench.objects.registry import make_object
from mimicbench.policies.loading import load_policy
from mimicbench.tasks.registry import TASKS
from stool import H1, standing

pytest.importorskip("stable_baselines3", reason="Stable-Baselines3 is not installed")
EXAMPLE = Path(__file__).parents[1] / "examples" / "ppo.py"
TOUCH = TASKS.get("touch-points")


def test_ppo_trained_in_gymnasium_is_judged(tmp_path, monkeypatch):
    monkeypatch.setenv("MIMICBENCH_PPO", str(tmp_path / "ppo.zip"))
    spec = importlib.util.spec_from_file_location("ppo_example", EXAMPLE)
    example = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(example)
    rewards = example.train(minutes=0.1, count=8)
    assert len(rewards) >= 1 and all(0 <= reward <= 1 for reward in rewards)
    pos, joints = standing()
    obj = make_object("household-0-00001")
    goal = torch.tensor([[0.0, 0.1, 1.0], [0.0, -0.1, 1.0]]).double().numpy()
    motion = RobotMotion(
        "start", "touch-points", "h1", H1.joint_names, 50.0, *(part[None].repeat(5, 0) for part in (pos, rot.IDENTITY)),
        joints[None].repeat(5, 0), obj.id, "start", wrist_goal_w=goal,
    )  # fmt: skip
    clips = ClipSet(TOUCH, H1, [motion], {obj.id: obj})
    run = run_policy(load_policy(EXAMPLE, H1, TOUCH), clips, env_config=EnvConfig(workers=1))[0]
    assert run.verdict.steps.tolist() == [500] and not run.errors
