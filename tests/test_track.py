"""Learning to track: checkpoints, PPO, and trainings that are stopped, killed and taken up again."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
import torch

from mimicbench.benchmark.recipe import read_recipe
from mimicbench.core.checkpoint import BadCheckpoint
from mimicbench.core.errors import MimicbenchError, UnknownName
from mimicbench.core.progress import Pulse
from mimicbench.core.settings import BadSetting
from mimicbench.core.training import METRICS, TorchRandom, read_metrics
from mimicbench.envs.clips import ClipSet
from mimicbench.envs.vec_env import EnvConfig
from mimicbench.track.checkpoint import CRITIC, TrackerConfig, load_critic, load_tracker, save_tracker, tracker_digest
from mimicbench.track.evaluation import good_enough
from mimicbench.track.learning.ppo import PPOConfig, PPOLearner
from mimicbench.track.network import Blueprint, MLPConfig
from mimicbench.track.parts import TrackingParts
from mimicbench.track.rollout import RolloutConfig, track_clips
from mimicbench.track.settings import EndConfig, TrackConfig, TrackingConfig
from mimicbench.track.tracker import Layout
from mimicbench.track.tracking import TrackingEnv
from mimicbench.track.train import begin_from, robots_of, train_tracker
from stool import H1, block
from tracked import (
    CALM,
    CLIPS,
    LAYOUT,
    LIFT_BOX,
    ONE_THREAD,
    OURS,
    RESIDUAL,
    SIT_CHAIR,
    TINY,
    clip_set,
    lifted,
    tiny,
)

SMALL = Blueprint(MLPConfig(TINY.hidden), 6)


def test_checkpoint(tmp_path):
    config = TrackerConfig("residual", LAYOUT.names, LAYOUT.widths, 19, (8, 4))
    network = LAYOUT.blueprint(MLPConfig((8, 4))).network(19)
    network.obs_mean.normal_()
    save_tracker(tmp_path, H1, config, network.tensors(), {"samples": 7})
    tracker = load_tracker(tmp_path, H1)
    obs = torch.randn(3, 167)
    assert torch.equal(tracker.network(obs), network(obs))
    assert tracker.spec is RESIDUAL and tracker.layout == LAYOUT
    with pytest.raises(BadCheckpoint, match="another robot, 'h1'"):
        load_tracker(tmp_path, replace(H1, name="g1"))
    save_tracker(tmp_path, H1, replace(config, hidden=(8, 5)), network.tensors(), {})
    with pytest.raises(BadCheckpoint, match="train it again"):
        load_tracker(tmp_path, H1)
    save_tracker(tmp_path, H1, replace(config, tracker="quick"), network.tensors(), {})
    with pytest.raises(UnknownName, match="quick"):
        load_tracker(tmp_path, H1)


def collect(learner, random, critic_alone=False):
    """One round of made-up experience, and the update on it."""
    obs = torch.tensor(random.normal(size=(4, 6)), dtype=torch.float32)
    for _ in range(TINY.steps):
        action = learner.act(obs)
        reward, done = action.pow(2).sum(-1).neg(), torch.tensor(random.random(4) < 0.2)
        obs = torch.tensor(random.normal(size=(4, 6)), dtype=torch.float32)
        learner.record(obs, reward, done, done & False)
    return learner.update(obs, critic_alone)


def test_learning_is_taken_up_as_if_it_had_never_stopped():
    torch.manual_seed(0)
    config = replace(TINY, average=0.9)
    first, second = PPOLearner(SMALL, 2, 4, config), PPOLearner(SMALL, 2, 4, config)
    collect(first, np.random.default_rng(0))
    saved, random = first.state_tensors(), TorchRandom().state_tensors()
    losses = collect(first, np.random.default_rng(1))
    second.load_state_tensors(saved)
    TorchRandom().load_state_tensors(random)
    again = collect(second, np.random.default_rng(1))
    assert again == losses
    for name, value in first.state_tensors().items():
        np.testing.assert_array_equal(second.state_tensors()[name], value, err_msg=name)
    for name, value in first.network_tensors().items():
        np.testing.assert_array_equal(second.network_tensors()[name], value, err_msg=name)


def test_the_exported_network_is_the_actors_mean():
    torch.manual_seed(0)
    learner = PPOLearner(SMALL, 2, 4, TINY)
    for seed in range(3):
        collect(learner, np.random.default_rng(seed))
    network = SMALL.network(2)
    network.load_tensors(learner.network_tensors())
    obs = torch.randn(4, 6)
    torch.manual_seed(1)
    actions = torch.stack([learner.act(obs) for _ in range(400)])
    std = learner.ppo.actor.output_std.detach().reshape(-1)[:2].numpy()
    np.testing.assert_allclose(actions.mean(0), network(obs).detach(), atol=5 * float(std.max()) / 20)


def test_what_is_kept_is_an_average_of_the_weights_after_each_update():
    """By hand: 2/11 and 3/12 of the average before stay of young ones, then 0.25. Updates of the critic alone do not
    count, for the actor is what it was.
    """
    torch.manual_seed(0)
    learner, last = PPOLearner(SMALL, 2, 4, replace(TINY, average=0.25)), "layers.0.weight"
    average, random = learner.network_tensors()[last].copy(), np.random.default_rng(0)
    for kept in (2 / 11, 3 / 12, 0.25, 0.25):
        collect(learner, random)
        now = learner.ppo.actor.mlp[0].weight.detach().numpy().copy()
        average = kept * average + (1 - kept) * now
        np.testing.assert_allclose(learner.network_tensors()[last], average, atol=1e-6)
        assert np.abs(now - average).max() > 1e-5
    before = learner.network_tensors()[last].copy()
    collect(learner, random, critic_alone=True)
    np.testing.assert_array_equal(learner.network_tensors()[last], before)


@pytest.mark.parametrize("optimizer", ["adam", "muon"])
def test_a_critic_that_learns_alone_leaves_nothing_of_the_actors_behind(optimizer):
    """Neither weights, moments nor rate: the first update of the actor is as if there had been none before. And with an
    update of the actor before.
    """
    torch.manual_seed(0)
    learner, random = PPOLearner(SMALL, 2, 4, replace(TINY, optimizer=optimizer)), np.random.default_rng(0)
    for _ in range(2):
        before = learner.state_tensors()
        had = sum(parameter in learner.ppo.optimizer.state for parameter in learner.ppo.actor.parameters())
        collect(learner, random, critic_alone=True)
        after = learner.state_tensors()
        stays = [name for name in before if name.startswith("actor/mlp") or name == "learning_rate"]
        assert stays and all(torch.equal(after[name], before[name]) for name in stays)
        assert sum(parameter in learner.ppo.optimizer.state for parameter in learner.ppo.actor.parameters()) == had
        assert any(not torch.equal(after[n], before[n]) for n in before if n.startswith("critic/mlp"))
        collect(learner, random)
        assert any(parameter in learner.ppo.optimizer.state for parameter in learner.ppo.actor.parameters())


def test_first_actions_leave_the_reference_alone():
    torch.manual_seed(0)
    blueprint = LAYOUT.blueprint(MLPConfig(PPOConfig().hidden))
    network = blueprint.network(19)
    network.load_tensors(PPOLearner(blueprint, 19, 4, PPOConfig()).network_tensors())
    assert network(torch.randn(16, 167)).abs().max() < 0.05


def test_training_end_to_end_and_again(tmp_path):
    rows = []
    folder = train_tracker(tmp_path, [clip_set()], [clip_set(CLIPS[1])], tiny(3), 0, ONE_THREAD, rows.append)
    assert rows[-1]["samples"] == tiny(3).samples and rows[-1]["iterations"] == 3
    assert rows[-1]["k_held_out"] == rows[-1]["stays_held_out"] == 1.0, "who is placed seated and left alone stays so"
    tracker = load_tracker(folder, H1)
    rollout = track_clips(tracker, clip_set(), RolloutConfig(record=True), ONE_THREAD)
    assert rollout.verdict.success.tolist() == [False, True]
    assert [track.shape for track in rollout.recording.qpos] == [(int(steps), 26) for steps in rollout.steps]
    assert [track.shape for track in rollout.recording.targets] == [(int(steps), 19) for steps in rollout.steps]
    # taken up with twice as many samples it goes on from there
    train_tracker(tmp_path, [clip_set()], [clip_set(CLIPS[1])], tiny(6), 0, ONE_THREAD, rows.append)
    assert rows[-1]["samples"] == tiny(6).samples and rows[-1]["iterations"] == 6
    assert read_metrics(tmp_path / METRICS) == rows, "what it had learned by then is still told"


def test_what_it_says_on_the_way_tells_how_many_fail(tmp_path, monkeypatch):
    monkeypatch.setattr(Pulse.__init__, "__defaults__", (0.0,))
    said = []
    for name, allowed in (("nobody", 1e3), ("everybody", -1e3)):
        ends = EndConfig(max_pos_error=1e3, max_angle_error=1e3, max_drop=allowed)
        config = replace(tiny(1), tracking=TrackingConfig(ends=ends))
        train_tracker(tmp_path / name, [clip_set()], [], config, 0, ONE_THREAD, say=said.append)
    assert [line.partition("  reward ")[2].split()[1] for line in said] == ["0.0", "1000.0"], said


def test_training_is_over_when_every_task_is_good_enough(tmp_path):
    """Of the two who are placed, one sits and stays so, and the other stands, and falls."""

    def samples(until, clips, held_out=()):
        rows, config = [], replace(tiny(3), evaluate_every=1, until=until)
        folder = tmp_path / str(len(list(tmp_path.iterdir())))
        train_tracker(folder, [clips], held_out, config, 0, ONE_THREAD, rows.append)
        return rows[-1]["samples"]

    assert samples(0.9, clip_set(CLIPS[1]), [clip_set()]) == tiny(1).samples, "who only judges does not count"
    assert samples(1.0, clip_set(CLIPS[1])) == tiny(3).samples
    assert samples(0.9, clip_set(), [clip_set(CLIPS[1])]) == tiny(3).samples
    assert samples(0.4, clip_set()) == tiny(1).samples


def test_every_task_has_to_be_good_enough():
    row = {"stays_held_out_of": {"sit-chair": 0.95}, "stays_train_of": {"sit-chair": 0.95, "lie-bed": 0.0}}
    assert not good_enough(row, 0.9)
    assert good_enough({**row, "stays_train_of": {"sit-chair": 0.95, "lie-bed": 0.9}}, 0.9)


def test_who_was_good_enough_and_is_called_again_does_not_train_on(tmp_path):
    """A command can be killed after its training is over and before it says so."""
    config = replace(tiny(3), evaluate_every=1, until=0.4)
    for until, samples in ((0.4, tiny(1).samples), (0.4, tiny(1).samples), (1.0, tiny(3).samples)):
        train_tracker(tmp_path, [clip_set()], [], replace(config, until=until), 0, ONE_THREAD)
        assert read_metrics(tmp_path / METRICS)[-1]["samples"] == samples


BOX = block(0.4, 0.2, movable=True, mass=2.0)
LIFTS = ClipSet(LIFT_BOX, H1, [replace(lifted(), object_id=BOX.id)], {BOX.id: BOX})


def test_one_network_follows_clips_of_several_tasks(tmp_path):
    sets, rows = [clip_set(), LIFTS], []
    folder = train_tracker(tmp_path, sets, [clip_set(CLIPS[1])], tiny(2), 0, ONE_THREAD, rows.append)
    tracker = load_tracker(folder, H1)
    assert set(tracker.observed) - set(LAYOUT.names) == {"object", "object+1", "object+5"}
    assert set(rows[-1]["k_train_of"]) == {"sit-chair", "lift-box"} == set(rows[-1]["ended"])
    assert set(rows[-1]["k_held_out_of"]) == {"sit-chair"} and rows[-1]["k_held_out"] == 1.0
    for clips in sets:
        assert track_clips(tracker, clips, RolloutConfig(leave_fallen=True), ONE_THREAD).verdict.success.shape


def test_robots_are_shared_out_among_tasks():
    assert robots_of(TrackConfig(num_envs=10), 3) == [3, 4, 3]
    assert robots_of(TrackConfig(num_envs=16, shares=(1, 2, 1)), 3) == [4, 8, 4]


def test_terms_that_a_task_does_not_have_are_zero():
    layout = Layout.of(RESIDUAL, H1, [SIT_CHAIR, LIFT_BOX])
    assert layout.size == LAYOUT.size + 36
    obs = TrackingEnv(RESIDUAL, clip_set(), 2, CALM, 0, ONE_THREAD, layout).observe()
    alone = TrackingEnv(RESIDUAL, clip_set(), 2, CALM, 0, ONE_THREAD).observe()
    assert torch.equal(obs[:, :167], alone) and not obs[:, 167:].any()


@pytest.mark.parametrize("parts", [1, 3])
def test_parts_are_the_same_whatever_the_threads(parts):
    def steps(workers):
        env = TrackingParts(
            RESIDUAL, [clip_set(), LIFTS], [5, 3], parts, TrackingConfig(), 5, EnvConfig(workers=workers)
        )
        assert [part.num_envs for part in env.parts] == ([5, 3] if parts == 1 else [3, 2, 2, 1])
        found = [torch.cat([value.flatten() for value in env.step(torch.zeros(8, 19), OURS)]) for _ in range(8)]
        env.close()
        return torch.stack(found).numpy().tobytes()

    assert steps(1) == steps(2)


def test_no_part_is_without_a_robot():
    with pytest.raises(MimicbenchError, match="3 robots are too few for 4 parts"):
        TrackingParts(RESIDUAL, [clip_set(), LIFTS], [2, 1], 3, TrackingConfig(), 5, ONE_THREAD)


def test_a_training_begins_from_a_tracker_and_keeps_what_it_does(tmp_path):
    torch.manual_seed(0)
    network = LAYOUT.blueprint(MLPConfig((6, 5))).network(19)
    network.obs_mean[:], network.obs_std[:] = torch.randn(167), torch.rand(167) + 0.5
    deviation = tuple(np.linspace(0.1, 0.3, 19).tolist())
    given = TrackerConfig("residual", LAYOUT.names, LAYOUT.widths, 19, (6, 5), deviation=deviation)
    save_tracker(tmp_path, H1, given, network.tensors(), {})
    layout = Layout.of(RESIDUAL, H1, [SIT_CHAIR, LIFT_BOX])
    learner = PPOLearner(layout.blueprint(MLPConfig((9, 7))), 19, 4, PPOConfig())
    begin_from(tmp_path, H1, learner, layout)
    wider = layout.blueprint(MLPConfig((9, 7))).network(19)
    wider.load_tensors(learner.network_tensors())
    obs = torch.randn(5, layout.size)
    np.testing.assert_allclose(wider(obs).detach(), network(obs[:, :167]).detach(), atol=1e-5)
    np.testing.assert_allclose(learner.deviation, deviation, rtol=1e-5)
    explorer = PPOLearner(layout.blueprint(MLPConfig((9, 7))), 19, 4, PPOConfig(initial_std=0.4))
    begin_from(tmp_path, H1, explorer, layout, anew=True)
    np.testing.assert_allclose(explorer.deviation, np.full(19, 0.4), rtol=1e-5)
    np.testing.assert_allclose(explorer.network_tensors()["layers.0.bias"][:6], network.tensors()["layers.0.bias"])
    with pytest.raises(MimicbenchError, match="2 layers at least as wide"):
        begin_from(tmp_path, H1, PPOLearner(layout.blueprint(MLPConfig((5, 5))), 19, 4, PPOConfig()), layout)


def test_who_goes_on_takes_over_the_critic_too(tmp_path):
    first = train_tracker(tmp_path, [clip_set()], [], tiny(2), 0, ONE_THREAD)
    critic = load_critic(first, H1)
    assert critic is not None and critic["layers.2.weight"].shape == (1, 16)
    learner = PPOLearner(LAYOUT.blueprint(MLPConfig(TINY.hidden)), 19, 4, TINY)
    assert not np.array_equal(learner.critic_tensors()["layers.0.weight"], critic["layers.0.weight"])
    begin_from(first, H1, learner, LAYOUT)
    for name, value in learner.critic_tensors().items():
        np.testing.assert_allclose(value, critic[name], rtol=1e-6, err_msg=name)
    whole = tracker_digest(first)
    shutil.rmtree(first / CRITIC)
    assert load_critic(first, H1) is None
    assert tracker_digest(first) != whole, "who goes on from it without its critic learns something else"


def test_the_critic_learns_at_its_own_rate():
    torch.manual_seed(0)
    learner = PPOLearner(
        LAYOUT.blueprint(MLPConfig(TINY.hidden)), 19, 4, replace(TINY, critic_rate=0.0, learning_rate=1e-3)
    )
    actor, critic = (
        learner.network_tensors()["layers.2.bias"].copy(),
        learner.critic_tensors()["layers.2.bias"].copy(),
    )
    for _ in range(TINY.steps):
        learner.act(torch.randn(4, LAYOUT.size))
        learner.record(torch.randn(4, LAYOUT.size), torch.randn(4), torch.zeros(4).bool(), torch.zeros(4).bool())
    learner.update(torch.randn(4, LAYOUT.size))
    assert np.array_equal(learner.critic_tensors()["layers.2.bias"], critic)
    assert not np.array_equal(learner.network_tensors()["layers.2.bias"], actor)


def test_a_new_critic_learns_before_the_actor_does(tmp_path):
    def trained(name, **more):
        config = replace(tiny(3), begin_from=str(tmp_path / "first" / "checkpoint"), **more)
        folder = train_tracker(tmp_path / name, [clip_set()], [], config, 0, ONE_THREAD)
        return load_tracker(folder, H1).network.tensors()

    first = train_tracker(tmp_path / "first", [clip_set()], [], tiny(2), 0, ONE_THREAD)
    before = load_tracker(first, H1)
    assert len(before.deviation) == 19
    waits, learns = trained("waits", critic_first=3), trained("learns", critic_first=2)
    weights = [name for name in waits if name.startswith("layers.")]
    assert all(np.array_equal(waits[name], before.network.tensors()[name]) for name in weights)
    assert not any(np.array_equal(learns[name], before.network.tensors()[name]) for name in weights)


class Killed(Exception):
    """As by a signal."""


def test_a_training_killed_in_the_middle_ends_in_the_same_bytes(tmp_path, monkeypatch):
    whole = train_tracker(tmp_path / "whole", [clip_set()], [clip_set(CLIPS[1])], tiny(6), 0, ONE_THREAD)
    updates = 0
    update = PPOLearner.update

    def killed_at_the_fourth(self, *given):
        nonlocal updates
        updates += 1
        if updates == 4:
            raise Killed
        return update(self, *given)

    monkeypatch.setattr(PPOLearner, "update", killed_at_the_fourth)
    with pytest.raises(Killed):
        train_tracker(tmp_path / "killed", [clip_set()], [clip_set(CLIPS[1])], tiny(6), 0, ONE_THREAD)
    monkeypatch.setattr(PPOLearner, "update", update)
    resumed = train_tracker(tmp_path / "killed", [clip_set()], [clip_set(CLIPS[1])], tiny(6), 0, ONE_THREAD)
    assert (resumed / "model.safetensors").read_bytes() == (whole / "model.safetensors").read_bytes()


def test_a_training_killed_between_its_state_and_its_checkpoint_has_both_alike(tmp_path):
    made = train_tracker(tmp_path / "a", [clip_set()], [clip_set(CLIPS[1])], tiny(2), 0, ONE_THREAD)
    whole = (made / "model.safetensors").read_bytes()
    old = train_tracker(tmp_path / "b", [clip_set()], [clip_set(CLIPS[1])], tiny(1), 0, ONE_THREAD)
    for name in ("model.safetensors", "config.json"):
        (made / name).write_bytes((old / name).read_bytes())  # what had been saved before
    again = train_tracker(tmp_path / "a", [clip_set()], [clip_set(CLIPS[1])], tiny(2), 0, ONE_THREAD)
    assert (again / "model.safetensors").read_bytes() == whole


def test_a_deviation_comes_back_from_its_ends():
    """Noise alone pushes it to the largest there is; then less is better."""
    torch.manual_seed(0)
    config = replace(TINY, initial_std=1.0, schedule="fixed", learning_rate=3e-3, entropy=0.1)
    learner, random = PPOLearner(SMALL, 2, 4, config), np.random.default_rng(0)
    for _ in range(10):
        collect(learner, random)
    assert max(learner.deviation) <= 1.0
    learner.ppo.entropy_coef = -0.1
    for _ in range(10):
        collect(learner, random)
    assert max(learner.deviation) < 0.98
    with pytest.raises(BadSetting, match="initial.std"):
        read_recipe({"track": {"ppo": {"initial_std": 2.0}}})


def test_inputs_that_are_new_to_a_network_are_normalized_by_what_they_are():
    torch.manual_seed(0)
    old, new = PPOLearner(SMALL, 2, 4, TINY), PPOLearner(replace(SMALL, width=8), 2, 4, TINY)
    kept = dict(old.network_tensors()) | {
        "obs_mean": np.full(6, 2.0, np.float32),
        "obs_std": np.full(6, 3.0, np.float32),
    }
    new.begin_from(kept, [(slice(0, 6), slice(0, 6))])
    for _ in range(50):
        obs = torch.randn(4, 8) * 10 + 30
        for _ in range(TINY.steps):
            new.act(obs)
            new.record(obs, torch.zeros(4), torch.zeros(4, dtype=torch.bool), torch.zeros(4, dtype=torch.bool))
        new.update(obs)
    found = new.network_tensors()
    np.testing.assert_allclose(found["obs_mean"][:6], 2.0, atol=1e-3)
    np.testing.assert_allclose(found["obs_mean"][6:], 30.0, atol=4.0)
    np.testing.assert_allclose(found["obs_std"][6:], 10.0, atol=3.0)


def test_fewer_samples_than_minibatches_are_refused():
    with pytest.raises(BadSetting, match="minibatches"):
        PPOLearner(SMALL, 2, 1, replace(TINY, steps=1, minibatches=4))
