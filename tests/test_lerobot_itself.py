"""LeRobot itself, where it is installed: it reads our demonstrations, learns from them, and drives our environment."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from mimicbench.imitate.stored.demo_writer import SCENE
from mimicbench.robots.registry import ROBOTS
from mimicbench.sensors.heightmap import CELLS
from test_lerobot import demo, writer

pytest.importorskip("lerobot", reason="lerobot is not installed; docs/lerobot.md says how")

from lerobot.configs.types import FeatureType  # noqa: E402
from lerobot.datasets.lerobot_dataset import LeRobotDataset  # noqa: E402
from lerobot.envs.factory import make_env, make_env_pre_post_processors  # noqa: E402
from lerobot.policies.act.configuration_act import ACTConfig  # noqa: E402
from lerobot.policies.diffusion.configuration_diffusion import DiffusionConfig  # noqa: E402
from lerobot.policies.factory import make_policy, make_pre_post_processors  # noqa: E402
from lerobot.scripts.lerobot_eval import rollout  # noqa: E402

from mimicbench.envs.lerobot.config import MimicbenchEnv  # noqa: E402

STEP = 1 / 50
SMALL = {
    "act": lambda: ACTConfig(
        device="cpu", push_to_hub=False, chunk_size=4, n_action_steps=4, dim_model=32, n_heads=2, dim_feedforward=32,
        n_encoder_layers=1, n_decoder_layers=1, n_vae_encoder_layers=1, pretrained_backbone_weights=None,
    ),
    "diffusion": lambda: DiffusionConfig(
        device="cpu", push_to_hub=False, horizon=8, n_action_steps=4, down_dims=(16, 32), num_inference_steps=2,
        num_train_timesteps=10, n_groups=4,
    ),
}  # fmt: skip


@pytest.fixture(scope="module", params=[False, True], ids=["numbers", "images"])
def folder(request, tmp_path_factory):
    """A data set, with images or without."""
    random, out = np.random.default_rng(0), tmp_path_factory.mktemp("demos")
    joints = ROBOTS.get("h1").joint_names
    made = writer(out, joint_names=joints, names={SCENE: [f"n{i}" for i in range(12)]}, gains="paper")
    for number in range(3):
        scene = random.normal(size=(20, 12)).astype(np.float32)
        picture = random.integers(0, 256, (20, CELLS, CELLS)).astype(np.uint8) if request.param else None
        made.add(replace(demo(number, 20), scene=scene, picture=picture))
    made.finish()
    return out


def features(folder):
    """What the data set has for a policy."""
    dataset = LeRobotDataset("local/demos", root=folder)
    return dataset, "observation.images.elevation" in dataset.features


def test_lerobot_reads_them(folder):
    dataset, images = features(folder)
    assert (len(dataset), dataset.num_episodes, dataset.fps) == (60, 3, 50)
    item = dataset[25]
    assert item["observation.state"].shape == (300,) and item["observation.environment_state"].shape == (12,)
    np.testing.assert_array_equal(item["action"], demo(1, 20).action[5])
    assert item["task"] == "sit-chair" and int(item["episode_index"]) == 1
    if images:
        assert item["observation.images.elevation"].shape == (3, CELLS, CELLS)
        assert 0 <= item["observation.images.elevation"].min() < item["observation.images.elevation"].max() <= 1


@pytest.mark.parametrize("kind", SMALL)
def test_its_policies_learn_from_them_and_drive_our_environment(kind, folder):
    meta, images = features(folder)
    config = SMALL[kind]()
    policy = make_policy(config, meta.meta)
    before, after = make_pre_post_processors(config, dataset_stats=meta.meta.stats)
    ahead = {"action": [i * STEP for i in config.action_delta_indices]}
    if config.observation_delta_indices is not None:
        seen = [i * STEP for i in config.observation_delta_indices]
        ahead |= {name: seen for name in config.input_features}
    dataset = LeRobotDataset("local/demos", root=folder, delta_timestamps=ahead)
    batch = before(next(iter(torch.utils.data.DataLoader(dataset, batch_size=2))))
    loss, _ = policy.forward(batch)
    loss.backward()
    assert torch.isfinite(loss) and any(p.grad is not None and p.grad.abs().sum() > 0 for p in policy.parameters())

    env_config = MimicbenchEnv(task="sit-chair", images=images, max_steps=3)
    assert env_config.features["action"].type is FeatureType.ACTION
    (env,) = make_env(env_config, n_envs=2)["mimicbench"].values()
    assert (env.envs[0].task, env.call("_max_episode_steps")) == ("Sit on a chair", (3, 3))
    policy.eval()
    pre, post = make_env_pre_post_processors(env_config, config)
    done = rollout(env, policy, pre, post, before, after, seeds=[0, 1])
    assert done["action"].shape == (2, 3, 19) and done["done"][:, -1].all() and not done["success"].any()
    env.close()
