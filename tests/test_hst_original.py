"""Original HST: what it is told, what it is rewarded for, when it has failed, and its own network, which remembers."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from mimicbench.core import rotations as rot
from mimicbench.core.checkpoint import BadCheckpoint
from mimicbench.core.errors import MimicbenchError
from mimicbench.envs.reference import ReferenceBank
from mimicbench.envs.vec_env import VecEnv
from mimicbench.sensors.observations import TERMS
from mimicbench.sim.physics import PhysicsConfig
from mimicbench.sim.rows import Rows
from mimicbench.track.checkpoint import TrackerConfig, build_tracker, load_critic, load_tracker, save_tracker
from mimicbench.track.history import Follower, History
from mimicbench.track.learning.ppo import PPOConfig, PPOLearner
from mimicbench.track.registry import TRACKERS
from mimicbench.track.rollout import RolloutConfig, track_clips
from mimicbench.track.settings import EndConfig, TrackConfig
from mimicbench.track.tracker import Layout
from mimicbench.track.trackers.hst_original import TransformerConfig, pitched, rolled, sank, touched
from mimicbench.track.tracking import TrackingEnv
from mimicbench.track.train import train_tracker
from stool import H1, place, put, seated, standing
from tracked import (
    CALM,
    CLIPS,
    ONE_THREAD,
    SIT_CHAIR,
    STOOL,
    TINY,
    FakePhysics,
    clip_set,
    context_of,
    moved_on,
    observed,
    state_of,
    swing,
)

SPEC = TRACKERS.get("hst-original")
SETTINGS = SPEC.settings()
LAYOUT = Layout.of(SPEC, H1, [SIT_CHAIR])
SMALL = TransformerConfig(tokens=8, heads=2, blocks=2)
LOOSE = replace(CALM, ends=EndConfig(max_pos_error=1e3, max_angle_error=1e3, max_drop=1e3, max_ankle_error=1e3))


def turned(yaw, pitch, roll):
    """A quaternion of turns about z, then the new y, then the new x [rad]."""
    turns = [rot.from_rotvec(np.array(v, float)) for v in ([0, 0, yaw], [0, pitch, 0], [roll, 0, 0])]
    quat = rot.multiply(rot.multiply(turns[0], turns[1]), turns[2])
    return torch.tensor(quat, dtype=torch.float32)[None]


def test_it_is_told_84_numbers_in_eight_frames():
    assert (LAYOUT.size, LAYOUT.frames, LAYOUT.blueprint(SMALL).inputs) == (84, 8, 672)
    bank = ReferenceBank([swing()], H1)
    context = context_of(bank, 20, last_action=0.25)
    state = replace(
        context.state,
        root_quat_w=turned(2.0, -0.3, 0.4),
        root_ang_vel_b=torch.tensor([[1.0, 2.0, 4.0]]),
        joint_vel=torch.full((1, 19), 2.0),
        joint_pos=torch.tensor([H1.rest_pose]) + 0.1,
    )
    terms = {name: TERMS[name].compute(replace(context, state=state)) for name in LAYOUT.names}
    found = LAYOUT.flat(terms)[0]
    np.testing.assert_allclose(found[:2], [0.4, -0.3], atol=1e-6, err_msg="roll and pitch, whatever the heading")
    np.testing.assert_allclose(found[2:5], [0.25, 0.5, 1.0], atol=1e-6, err_msg="a quarter of the turn rate")
    # on a circle of 1 m at 0.5 rad/s that begins along +y: to its own left, and turning
    np.testing.assert_allclose(found[5:8], [0.0, 0.5, 0.5], atol=2e-3)
    np.testing.assert_allclose(found[8:27], 0.1, atol=1e-6)
    np.testing.assert_allclose(found[27:46], 0.05 * 2.0, atol=1e-6)
    np.testing.assert_allclose(found[46:65], 0.25, atol=1e-6)
    np.testing.assert_allclose(found[65:], context.reference(1).joint_pos[0], atol=1e-6)


def test_it_does_not_know_where_it_is():
    bank = ReferenceBank([swing()], H1)
    context = context_of(bank, 20)
    moved = replace(context.state, root_pos_w=context.state.root_pos_w + torch.tensor([1.0, 2.0, 0.3]))
    assert torch.equal(observed(SPEC, context), observed(SPEC, replace(context, state=moved)))


def test_its_actions_are_added_to_the_rest_pose():
    action = torch.zeros(1, 19)
    np.testing.assert_allclose(SPEC.target(H1, action, action, SETTINGS)[0], H1.rest_pose, atol=1e-6)
    np.testing.assert_allclose(SPEC.target(H1, action, action + 9.0, SETTINGS)[0], H1.joint_range[:, 1], atol=1e-6)


def test_its_reward_by_hand():
    bank = ReferenceBank([swing()], H1)
    context = context_of(bank, 10)
    assert SPEC.reward(context, moved_on(bank, context), SETTINGS)[0] == pytest.approx(0.02 * 1.2, abs=1e-5)
    state = context.state
    off = state.joint_pos.clone()
    off[:, 0] += 1.9  # 0.1 in the mean of 19
    for changes, expected in (
        ({"joint_pos": off}, np.exp(-0.4) + 0.2),
        ({"root_lin_vel_w": state.root_lin_vel_w + torch.tensor([0.3, 0.4, 9.0])}, 1.1 + 0.1 * np.exp(-1.0)),
        ({"root_ang_vel_b": state.root_ang_vel_b + torch.tensor([9.0, 9.0, 0.5])}, 1.1 + 0.1 * np.exp(-1.0)),
    ):
        there = replace(context, state=replace(state, **changes))
        found = SPEC.reward(there, moved_on(bank, there), SETTINGS)[0]
        assert found == pytest.approx(0.02 * expected, abs=1e-5), changes


def test_when_it_has_failed_by_hand():
    bank = ReferenceBank([CLIPS[0]], H1)
    context = context_of(bank, 0)
    state = state_of(bank.frame(torch.zeros(1, dtype=torch.long), torch.zeros(1, dtype=torch.long)))

    def at(**changes):
        return replace(context, state=replace(state, **changes))

    for angle, fails in ((0.49, False), (0.51, True), (-0.51, True)):
        assert bool(rolled(at(root_quat_w=turned(1.0, 0.2, angle)), SETTINGS)) is fails
        assert bool(pitched(at(root_quat_w=turned(1.0, angle, 0.2)), SETTINGS)) is fails
    for height, fails in ((0.86, False), (0.84, True)):
        assert bool(sank(at(root_pos_w=torch.tensor([[0.0, 0.0, height]])), SETTINGS)) is fails
    for link, newtons, fails in (
        ("pelvis", 1.1, True),
        ("pelvis", 0.9, False),
        ("left_knee_link", 1.1, True),
        ("right_elbow_link", 1.1, True),
        ("left_hip_yaw_link", 1.1, True),
        ("right_shoulder_roll_link", 1.1, True),
        ("left_ankle_link", 500.0, False),
        ("torso_link", 500.0, False),
    ):
        forces = torch.zeros(1, len(H1.links), 3)
        forces[0, H1.link_names.index(link), 1] = newtons
        physics = FakePhysics(context.physics.links(), context.object, forces)
        assert bool(touched(replace(context, physics=physics), SETTINGS)) is fails, (link, newtons)


def test_forces_of_contact_are_measured():
    config = replace(ONE_THREAD, physics=PhysicsConfig(measure_contact=True))
    env = VecEnv(SIT_CHAIR, H1, [STOOL], config)
    place(env.physics, *seated(0.42))
    for _ in range(100):  # held in the pose in which it was put: the stool bears a part of it, the feet the rest
        env.physics.step(torch.tensor(seated(0.42)[1])[None])
    forces = env.physics.contact_force()[0]
    weight = 9.81 * sum(link.mass for link in H1.links)
    feet = [H1.link_names.index(f"{side}_ankle_link") for side in ("left", "right")]
    assert forces[:, 2].sum() == pytest.approx(weight, rel=0.1), "all that bears it, upwards"
    assert forces[feet, 2].sum() < 0.6 * weight and forces[H1.link_names.index("pelvis"), 2] > 50.0
    kept = env.physics.state_tensors()
    place(env.physics, *standing())
    assert not env.physics.contact_force().any(), "nothing has been measured yet"
    env.physics.load_state_tensors(kept)
    assert torch.equal(env.physics.contact_force()[0], forces)
    with pytest.raises(MimicbenchError, match="measure_contact"):
        VecEnv(SIT_CHAIR, H1, [STOOL], ONE_THREAD).physics.contact_force()


def test_whoever_sits_has_failed():
    env = TrackingEnv(SPEC, clip_set(*CLIPS), 2, LOOSE, 3, ONE_THREAD)
    env.env.clip[:] = torch.tensor([0, 1])
    env.env.reset(Rows.every(2), env.starts.at(torch.tensor([0, 1]), torch.zeros(2, dtype=torch.long)))
    (_, upright), (pos, sitting) = standing(), seated(0.42)
    pressed = (pos - [0.0, 0.0, 0.005], rot.IDENTITY, sitting)  # the stool gives way by 3 mm
    put(env.env.physics, [1], *(part[None] for part in pressed))
    hold = torch.tensor(np.stack([upright, sitting]), dtype=torch.float32)
    _, _, done, time_out = env.step(hold - torch.tensor(H1.rest_pose), SETTINGS)
    assert done.tolist() == [False, True] and not time_out.any()
    counts = dict(zip(env.ends, env.ended.tolist(), strict=True))
    assert counts["touched"] == 1 and counts["sank"] == 1 and not counts["rolled"] and not counts["position"]


def test_frames_of_one_episode_are_remembered_and_no_others():
    layout = Layout(("a",), (2,), 3)
    history = History(layout, 2)
    frames = [torch.tensor([[k, 1.0], [10.0 * k, 2.0]]) for k in range(1, 5)]
    assert history.seen(frames[0]).tolist() == [[0, 0, 0, 0, 1, 1], [0, 0, 0, 0, 10, 2]]
    history.add(frames[0])
    history.add(frames[1])
    assert history.seen(frames[2]).tolist() == [[1, 1, 2, 1, 3, 1], [10, 2, 20, 2, 30, 2]]
    history.add(frames[2])
    history.begin(Rows.of([1], 2))
    assert history.seen(frames[3]).tolist() == [[2, 1, 3, 1, 4, 1], [0, 0, 0, 0, 40, 2]]
    kept, history.past = history.state_tensors(), torch.zeros(2, 4)
    history.load_state_tensors(kept)
    assert history.seen(frames[3]).tolist() == [[2, 1, 3, 1, 4, 1], [0, 0, 0, 0, 40, 2]]
    assert not History(Layout(("a",), (2,)), 2).remembers


def test_an_environment_remembers_frames_and_is_taken_up_with_them():
    def make():
        return TrackingEnv(SPEC, clip_set(swing()), 3, replace(LOOSE, push=0.5, push_interval=0.1), 0, ONE_THREAD)

    first, second = make(), make()
    seen = [first.observe(), *(first.step(torch.zeros(3, 19), SETTINGS)[0] for _ in range(4))]
    assert torch.equal(first.observe(), seen[-1]), "to look changes nothing"
    for env in range(3):
        steps = int(first.env.steps[env])
        for back in range(8):
            frame = seen[-1][env].view(8, 84)[7 - back]
            then = seen[-1 - back][env, -84:] if back <= steps and back < len(seen) else torch.zeros(84)
            assert torch.equal(frame, then), "zeros before the episode began"
    second.load_state_tensors(first.state_tensors())
    for _ in range(6):
        ours, theirs = (env.step(torch.full((3, 19), 0.1), SETTINGS) for env in (first, second))
        for mine, other in zip(ours, theirs, strict=True):
            assert mine.numpy().tobytes() == other.numpy().tobytes()


def training(rounds):
    return TrackConfig(
        "hst-original",
        network=SMALL,
        samples=rounds * 4 * 4,
        num_envs=4,
        evaluate_clips=1,
        ppo=replace(TINY, steps=4),
        save_every=0.0,
        evaluate_every=10**9,
        tracking=replace(LOOSE, push=0.5),
    )


def test_its_training_goes_on_to_the_same_bytes_and_acts_as_it_was_saved(tmp_path):
    clips = [clip_set(swing())]
    whole = train_tracker(tmp_path / "whole", clips, [], training(4), 0, ONE_THREAD)
    train_tracker(tmp_path / "halves", clips, [], training(2), 0, ONE_THREAD)
    halves = train_tracker(tmp_path / "halves", clips, [], training(4), 0, ONE_THREAD)
    for name in ("model.safetensors", "critic/model.safetensors"):
        assert (whole / name).read_bytes() == (halves / name).read_bytes()
    tracker, again = load_tracker(whole, H1), load_tracker(halves, H1)
    assert tracker.layout == LAYOUT and tracker.deviation != (1.0,) * 19
    assert "layers.blocks.1.attention.in_proj_weight" in (load_critic(whole, H1) or {})
    first, second = Follower(tracker, 2), Follower(again, 2)
    terms = {name: torch.randn(2, width) for name, width in zip(LAYOUT.names, LAYOUT.widths, strict=True)}
    actions = [first.action(terms) for _ in range(3)]
    assert torch.equal(actions[0], second.action(terms)) and not torch.equal(actions[0], actions[1]), "it remembers"
    given = LAYOUT.flat(terms)
    past = torch.cat([torch.zeros(2, 5 * 84), given, given], -1)
    np.testing.assert_allclose(tracker.action(terms, past).detach(), actions[2].detach(), atol=1e-6)
    rollout = track_clips(tracker, clips[0], RolloutConfig(leave_fallen=True), ONE_THREAD)
    assert rollout.verdict.success.tolist() == [False]
    with pytest.raises(MimicbenchError, match="other sizes or inputs"):
        other = replace(training(4), network=replace(SMALL, tokens=16), begin_from=str(whole))
        train_tracker(tmp_path / "warm", clips, [], other, 0, ONE_THREAD)
    warm = replace(training(1), begin_from=str(whole), ppo=replace(TINY, steps=4, learning_rate=0.0, schedule="fixed"))
    kept = train_tracker(tmp_path / "warm", clips, [], warm, 0, ONE_THREAD)
    for name, value in load_tracker(kept, H1).network.tensors().items():
        np.testing.assert_array_equal(value, tracker.network.tensors()[name], err_msg=name)


def test_checkpoints_say_which_network_they_hold(tmp_path):
    torch.manual_seed(0)
    plain = {"tokens": 8, "heads": 2, "blocks": 2, "dropout": 0.1}
    config = TrackerConfig("hst-original", LAYOUT.names, LAYOUT.widths, 19, (), frames=8, network=plain)
    network = config.blueprint().network(19)
    save_tracker(tmp_path, H1, config, network.tensors(), {})
    obs = torch.randn(3, 672)
    tracker = load_tracker(tmp_path, H1)
    assert torch.equal(tracker.network(obs), network.eval()(obs))
    assert torch.equal(build_tracker(config, network.tensors()).network(obs), network(obs))
    for wrong, said in (
        ({**plain, "tokens": "many"}, "no settings of tracker hst-original"),
        ({**plain, "heads": 3}, "describes no tracker"),
        ({**plain, "blocks": 1000}, "layers of a kind"),
        ({**plain, "blocks": 3}, "train it again"),
    ):
        save_tracker(tmp_path, H1, replace(config, network=wrong), network.tensors(), {})
        with pytest.raises(BadCheckpoint, match=said):
            load_tracker(tmp_path, H1)
    save_tracker(tmp_path, H1, replace(config, tracker="hst"), network.tensors(), {})
    with pytest.raises(BadCheckpoint, match="no kind of network of its own"):
        load_tracker(tmp_path, H1)


def test_its_first_actions_are_the_rest_pose_and_its_first_deviation_is_one():
    torch.manual_seed(0)
    blueprint = LAYOUT.blueprint(TransformerConfig())
    learner = PPOLearner(blueprint, 19, 4, PPOConfig(initial_std=1.0))
    np.testing.assert_allclose(learner.deviation, 1.0, atol=1e-6)
    network = blueprint.network(19).eval()
    network.load_tensors(learner.network_tensors())
    obs = torch.randn(16, 672)
    assert network(obs).abs().max() < 0.05
    # 84 x 128 + 128; 8 x 128; blocks of two norms, attention and four times as wide layers; a norm and 128 x 19 + 19
    block = 2 * 256 + (3 * 128 * 128 + 3 * 128 + 128 * 128 + 128) + (128 * 512 + 512 + 512 * 128 + 128)
    assert sum(p.numel() for p in network.parameters()) == 84 * 128 + 128 + 1024 + 4 * block + 256 + 128 * 19 + 19
    latest = obs.clone()
    latest[:, -84:] = 0.0
    assert not torch.allclose(network(obs), network(latest)), "it sees the present frame"
    earliest = obs.clone()
    earliest[:, :84] = 0.0
    assert not torch.equal(network(obs), network(earliest)), "and the first"
