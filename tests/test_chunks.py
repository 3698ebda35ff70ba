"""What becomes of the chunks that a learner predicts: ensembles of them, and targets said from where the joints are."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from mimicbench.core.settings import BadSetting
from mimicbench.imitate.dataset import DemoFrames
from mimicbench.imitate.learned import load_learner, save_learner
from mimicbench.imitate.lerobot import Demos
from mimicbench.imitate.policy import Ensemble, VisionPolicy
from mimicbench.imitate.registry import LEARNERS
from mimicbench.imitate.settings.encoder import EncoderConfig
from mimicbench.imitate.settings.inputs import InputConfig
from mimicbench.imitate.stored.scenery import Scenery
from mimicbench.objects.families.chair import make_chair
from mimicbench.robots.registry import ROBOTS
from mimicbench.sensors.observations import Observations
from mimicbench.tasks.sit_chair import TASK as SIT_CHAIR

H1 = ROBOTS.get("h1")
BODY = InputConfig(body="proprio", clock=True, elevation=False)
SMALL = {
    "act": {"hidden": 16, "feedforward": 16, "heads": 2, "chunk": 3, "latent": 4, "dropout": 0.0},
    "bc": {"hidden": 16},
}


def network(kind, **settings):
    """A small network of a learner, which sees the body and a clock."""
    config = LEARNERS.get(kind).config().network
    return replace(config, inputs=BODY, **SMALL.get(kind, {}), **settings).of(H1, SIT_CHAIR)


def senses(proprio):
    return Observations({"proprio": proprio, "time": torch.zeros(2, 1), "odometry": torch.zeros(2, 3)})


def test_an_ensemble_counts_older_chunks_more():
    ensemble, chunks = Ensemble(), [torch.randn(2, 3, 1) for _ in range(4)]
    ensemble.begin(torch.arange(2), 2, chunks[0])
    found = [ensemble.mean(chunk) for chunk in chunks[:3]]
    torch.testing.assert_close(found[0], chunks[0][:, 0])
    w = math.exp(-0.01)
    torch.testing.assert_close(found[1], (chunks[0][:, 1] + w * chunks[1][:, 0]) / (1 + w))
    by_hand = (chunks[0][:, 2] + w * chunks[1][:, 1] + w * w * chunks[2][:, 0]) / (1 + w + w * w)
    torch.testing.assert_close(found[2], by_hand)
    # who begins anew has no older chunks, and the first one reaches no farther than three frames
    ensemble.begin(torch.tensor([1]), 2, chunks[0])
    last = ensemble.mean(chunks[3])
    torch.testing.assert_close(last[1], chunks[3][1, 0])
    older = chunks[1][0, 2] + w * chunks[2][0, 1] + w * w * chunks[3][0, 0]
    torch.testing.assert_close(last[0], older / (1 + w + w * w))


def test_a_policy_carries_out_the_ensemble_of_its_chunks():
    torch.manual_seed(0)
    policy = VisionPolicy(network("act", ensembles=True).build())
    seen, memory = [torch.randn(2, 48) for _ in range(3)], {}
    policy.reset(torch.arange(2), senses(seen[0]))
    targets = []
    for proprio in seen:
        targets.append(policy.act(senses(proprio)))
        memory = {name: value.clone() for name, value in policy.memory().items()}
        policy.remember(memory)
    with torch.no_grad():
        chunks = [policy.learner.plan(policy.senses.see(senses(proprio))[0], None) for proprio in seen]
    alone = Ensemble()
    alone.begin(torch.arange(2), 2, chunks[0])
    for target, chunk in zip(targets, chunks, strict=True):
        torch.testing.assert_close(target, alone.mean(chunk))
    assert memory["ensemble.count"].shape == (2, 3)


def glide(frames=30):
    """One demonstration whose joint targets are half a radian ahead of its joints, the more the later."""
    random = np.random.default_rng(0)
    qpos = np.zeros((frames, 26))
    qpos[:, 3] = 1.0
    qpos[:, 7:] = np.cumsum(random.normal(size=(frames, 19)) * 0.1, 0)
    action = (qpos[:, 7:] + 0.5 + 0.01 * np.arange(frames)[:, None]).astype(np.float32)
    return Demos(
        robot="h1",
        task="sit-chair",
        fps=50.0,
        joint_names=tuple(map(str, range(19))),
        starts=np.array([0, frames]),
        state=None,
        action=action,
        executed_action=action,
        qpos=qpos,
        qvel=np.zeros((frames, 25)),
        object_ids=("chair",),
        reference_ids=("clip",),
        success=np.ones(1, bool),
    )


@pytest.mark.parametrize("kind", sorted(SMALL))
def test_relative_targets_are_said_from_where_the_joints_are(kind, tmp_path):
    config = network(kind, relative=True)
    torch.manual_seed(0)
    learner, demos = config.build(), glide()
    plans = replace(LEARNERS.get(kind).config(), network=config).plans(demos, None)
    chair = make_chair(0)
    scenery = Scenery.of([chair], SIT_CHAIR, config.inputs)
    data = DemoFrames(demos, {"chair": chair}, config.inputs, config.window, scenery, plans=plans, validation=0.0)
    at = torch.arange(20)
    label = data.batch(at).actions
    torch.testing.assert_close(label[:, 0], (0.5 + 0.01 * at)[:, None].expand(-1, 19))
    for later in range(1, config.window.chunk):
        moved = torch.from_numpy(demos.qpos[later : 20 + later, 7:] - demos.qpos[:20, 7:]).float()
        torch.testing.assert_close(label[:, later], moved + (0.5 + 0.01 * (at + later))[:, None])
    learner.normalize_by(data.vector(torch.arange(30)), data.samples(torch.arange(30)), data.ends())
    save_learner(tmp_path, learner, "h1")
    policy, proprio = VisionPolicy(load_learner(tmp_path, H1, type(config))[0]), torch.randn(2, 48)
    policy.reset(torch.arange(2), senses(proprio))
    with torch.no_grad():
        said = policy.learner.predict(policy.senses.see(senses(proprio))[0], None)
    torch.testing.assert_close(policy.act(senses(proprio)), said + proprio[:, 10:29])


@pytest.mark.parametrize("steps", [1, 8, 16, 34, 51, 100])
def test_noise_is_taken_back_from_the_last_level_on(steps, monkeypatch):
    """By who knows that actions are 0.5 +- 0.1, whatever the number of steps."""
    config = replace(network("diffusion"), sample_steps=steps, noise_steps=100, action_size=200, widths=(16, 32))
    torch.manual_seed(0)
    learner = config.build()

    def ideal(actions, step, seen):
        kept = learner.kept[step][:, None, None]
        clean = 0.5 + kept.sqrt() * 0.01 / (kept * 0.01 + 1 - kept) * (actions - kept.sqrt() * 0.5)
        return (actions - kept.sqrt() * clean) / (1 - kept).sqrt()

    monkeypatch.setattr(learner.unet, "forward", ideal)
    monkeypatch.setattr(learner, "_seen", lambda vector, picture: torch.zeros(1, 1))
    said = learner.plan(torch.zeros(1, 1), None)
    assert said.mean() == pytest.approx(0.5, abs=0.02)


def test_a_peak_of_one_frame_can_be_said():
    config = network("diffusion")
    demos = glide()
    demos.action[13] = 5.0
    chair = make_chair(0)
    scenery = Scenery.of([chair], SIT_CHAIR, config.inputs)
    data = DemoFrames(demos, {"chair": chair}, config.inputs, config.window, scenery, validation=0.0)
    learner, some = config.build(), torch.arange(0, 12)
    learner.normalize_by(data.vector(some), data.samples(some), data.ends())
    torch.testing.assert_close(learner.normalized_actions(torch.full((19,), 5.0)), torch.ones(19))


@pytest.mark.parametrize(
    ("kind", "change", "match"),
    [
        ("diffusion", {"kernel": 4}, "odd"),
        ("diffusion", {"widths": (36, 64)}, "groups"),
        ("diffusion", {"step_embedding": 2}, "even number"),
        ("diffusion", {"step_embedding": 65}, "even number"),
        ("act", {"hidden": 90, "heads": 3}, "multiple of 4"),
        ("hit", {"hidden": 90, "heads": 3}, "multiple of 4"),
        ("bc", {"encoder": EncoderConfig(cells=64)}, "128"),
    ],
)
def test_sizes_of_which_no_network_can_be_made_are_refused(kind, change, match):
    with pytest.raises(BadSetting, match=match):
        replace(network(kind), **change)


def test_channels_that_go_into_no_groups_are_refused():
    with pytest.raises(BadSetting, match="groups of 16"):
        EncoderConfig(widths=(16, 32, 50, 64))
