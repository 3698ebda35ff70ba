"""Tracking: the reference's derivatives, sizes of what trackers see, rewards and endings by hand, and learning that
can be taken up again.
"""

from dataclasses import replace

import numpy as np
import pytest
import torch

from mimicbench.core import rotations as rot
from mimicbench.core.checkpoint import BadCheckpoint
from mimicbench.core.errors import BadMotion, UnknownName
from mimicbench.core.motion import RobotMotion
from mimicbench.sensors.proprioception import body_state
from mimicbench.sim.physics import RobotState
from mimicbench.tasks.sit_chair import TASK as SIT_CHAIR
from mimicbench.track import hst, residual
from mimicbench.track.checkpoint import Tracker, TrackerConfig, load_tracker, save_tracker
from mimicbench.track.env import TrackingConfig, TrackingEnv, deviations
from mimicbench.track.network import TrackerNetwork
from mimicbench.track.ppo import PPOConfig, PPOLearner
from mimicbench.track.reference import ReferenceBank
from mimicbench.track.rollout import track_clips
from mimicbench.track.tracker import Moment, Step, get_kind
from mimicbench.track.train import TrackConfig, train_tracker
from stool import H1, block, seated, standing

STOOL = block()
OBJECTS = {STOOL.id: STOOL}
CALM = TrackingConfig(first_frame=1.0, start_pos_noise=0.0, start_angle_noise=0.0, start_vel_noise=0.0, push=0.0)
TINY = PPOConfig(hidden=(16,), steps=8, epochs=1, minibatches=2)
RATES = np.linspace(-0.4, 0.4, 19)


def swing(name="swing", frames=41, fps=30.0):
    """A motion with known derivatives: the root on a circle of 1 m at 0.5 rad/s, turning as it goes.

    Joints swing about the rest pose.
    """
    t = np.arange(frames) / fps
    pos = np.stack([np.cos(0.5 * t) - 2.5, np.sin(0.5 * t), 1.0 + 0 * t], -1)
    joints = np.array(H1.rest_pose) + 0.05 * np.sin(t[:, None] * 2 + RATES)
    quat = rot.from_yaw(0.5 * t)
    quat[::2] *= -1  # the same turns, written the other way round
    return RobotMotion(name, "sit-chair", "h1", H1.joint_names, fps, pos, quat, joints, STOOL.id, name)


def still(posture, name, frames=40):
    """A motion that stays as it is."""
    pos, joints = posture
    return RobotMotion(
        name,
        "sit-chair",
        "h1",
        H1.joint_names,
        50.0,
        np.tile(pos, (frames, 1)),
        np.tile(rot.IDENTITY, (frames, 1)),
        np.tile(joints, (frames, 1)),
        STOOL.id,
        name,
    )


CLIPS = [still(standing(), "stands"), still(seated(0.42), "sits")]


def state_of(frame):
    """A robot that is exactly where its reference is."""
    spin = rot.rotate_inverse(frame.root_quat_w, frame.root_ang_vel_w)
    return RobotState(frame.root_pos_w, frame.root_quat_w, frame.root_lin_vel_w, spin, frame.joint_pos, frame.joint_vel)


def moment_of(bank, index, state=None):
    """A robot at a frame of the bank's first clip."""
    clip, at = torch.zeros(1, dtype=torch.long), torch.tensor([index])
    state = state or state_of(bank.frame(clip, at))
    links = hst.reference_links(H1, bank.frame(clip, at))
    return Moment(H1, state, lambda: links, lambda k: bank.frame(clip, at + k), torch.zeros(1, 19))


def test_reference_against_the_analytic_motion():
    bank = ReferenceBank([swing()], H1)
    count = int(bank.lengths[0])
    assert count == int(40 / 30 * 50 + 1e-6) + 1
    frame = bank.frame(torch.zeros(count, dtype=torch.long), torch.arange(count))
    t = np.arange(count) / 50
    inner = slice(1, -1)
    np.testing.assert_allclose(
        frame.root_pos_w, np.stack([np.cos(0.5 * t) - 2.5, np.sin(0.5 * t), 1 + 0 * t], -1), atol=1e-5
    )
    np.testing.assert_allclose(
        frame.root_lin_vel_w[:-1, :2], 0.5 * np.stack([-np.sin(0.5 * t), np.cos(0.5 * t)], -1)[:-1], atol=1e-3
    )
    np.testing.assert_allclose(frame.root_ang_vel_w[inner], np.broadcast_to([0, 0, 0.5], (count - 2, 3)), atol=1e-3)
    np.testing.assert_allclose(
        rot.angle_between(frame.root_quat_w.numpy(), rot.from_yaw(0.5 * t).astype(np.float32)), 0, atol=2e-3
    )
    np.testing.assert_allclose(
        frame.joint_pos, np.array(H1.rest_pose) + 0.05 * np.sin(2 * t[:, None] + RATES), atol=1e-4
    )
    np.testing.assert_allclose(frame.joint_vel[inner], 0.1 * np.cos(2 * t[:, None] + RATES)[inner], atol=3e-3)


def test_a_clip_that_is_over_rests_at_its_last_frame():
    bank = ReferenceBank([CLIPS[0], swing()], H1)
    last = int(bank.lengths[1]) - 1
    after = bank.frame(torch.tensor([1, 1]), torch.tensor([last, last + 50]))
    for part in (after.root_lin_vel_w, after.root_ang_vel_w, after.joint_vel):
        assert (part == 0).all()
    assert torch.equal(after.root_pos_w[0], after.root_pos_w[1])
    np.testing.assert_allclose(after.root_pos_w[0, :2], swing().root_pos_w[-1, :2], atol=0.02)


def test_clips_that_cannot_be_tracked():
    with pytest.raises(BadMotion, match="no clips"):
        ReferenceBank([], H1)
    with pytest.raises(BadMotion, match="other joints"):
        ReferenceBank([replace(swing(), joint_names=H1.joint_names[::-1])], H1)


def test_link_velocities_of_a_reference_are_derivatives():
    bank = ReferenceBank([swing(frames=91)], H1)
    clip = torch.zeros(3, dtype=torch.long)
    links = hst.reference_links(H1, bank.frame(clip, torch.tensor([49, 50, 51])))
    np.testing.assert_allclose(links.lin_vel_w[1], (links.pos_w[2] - links.pos_w[0]) * 25, atol=5e-3)
    np.testing.assert_allclose(
        links.ang_vel_w[1], rot.to_rotvec(rot.multiply(links.quat_w[2], rot.conjugate(links.quat_w[0]))) * 25, atol=5e-3
    )
    frame = bank.frame(clip, torch.tensor([49, 50, 51]))
    pos, quat = H1.forward_kinematics(
        *(part.numpy().astype(float) for part in (frame.root_pos_w, frame.root_quat_w, frame.joint_pos))
    )
    np.testing.assert_allclose(links.pos_w, pos, atol=1e-5)
    np.testing.assert_allclose(rot.angle_between(links.quat_w.numpy(), quat), 0, atol=2e-3)


def test_what_trackers_see():
    bank = ReferenceBank([swing()], H1)
    moment = moment_of(bank, 10)
    assert residual.observe(moment).shape == (1, 167)
    assert hst.observe(moment).shape == (1, 578)
    assert body_state(moment.state).shape == (1, 48)


def test_observations_do_not_know_where_the_world_is():
    # the same situation, turned about the vertical and moved along the floor
    bank = ReferenceBank([swing()], H1)
    yaw, shift = 1.1, np.array([3.0, -2.0, 0.0])
    turn = rot.from_yaw(np.array(yaw))
    motion = swing()
    moved = ReferenceBank(
        [
            replace(
                motion,
                root_pos_w=rot.rotate(turn, motion.root_pos_w) + shift,
                root_quat_w=rot.multiply(turn, motion.root_quat_w),
            )
        ],
        H1,
    )
    for kind in (residual.RESIDUAL, hst.HST_PAPER):
        np.testing.assert_allclose(kind.observe(moment_of(bank, 20)), kind.observe(moment_of(moved, 20)), atol=1e-3)


def test_at_its_next_frame_the_reference_is_nowhere_else():
    # a robot already at the next frame sees no difference in position, orientation and joints
    bank = ReferenceBank([swing()], H1)
    ahead = state_of(bank.frame(torch.zeros(1, dtype=torch.long), torch.tensor([11])))
    plan = residual.plan_observation(moment_of(bank, 10, ahead))[0]
    np.testing.assert_allclose(plan[:9], [0, 0, 0, 1, 0, 0, 0, 1, 0], atol=1e-6)
    np.testing.assert_allclose(plan[12:31], 0, atol=1e-6)


def no_change(moment, action=0.0, previous=0.0):
    ref = moment.reference(0)
    return Step(
        torch.full((1, 19), action),
        torch.full((1, 19), previous),
        moment.state.joint_vel,
        ref.joint_vel,
        torch.zeros(1),
    )


def test_reward_of_perfect_tracking():
    moment = moment_of(ReferenceBank([swing()], H1), 10)
    assert residual.reward(moment, no_change(moment))[0] == pytest.approx(1.0, abs=1e-6)
    assert residual.reward(moment, no_change(moment, 0.5, 0.3))[0] == pytest.approx(1 - 0.005 * 19 * 0.04, abs=1e-6)
    # F.3: 1 for the positions, 1 for each of 20 orientations, 5 for the root
    assert hst.reward(moment, no_change(moment))[0] == pytest.approx(26, abs=1e-2)


def test_reward_by_hand():
    bank = ReferenceBank([CLIPS[0]], H1)
    frame = bank.frame(torch.zeros(1, dtype=torch.long), torch.tensor([5]))
    off = state_of(frame)
    off = replace(
        off,
        root_pos_w=off.root_pos_w + torch.tensor([0.3, 0, 0]),
        joint_pos=off.joint_pos + 0.1,
        root_lin_vel_w=torch.tensor([[0, 0.5, 0]]),
        root_quat_w=torch.tensor(rot.from_yaw(np.array([0.2])), dtype=torch.float32),
        joint_vel=torch.full((1, 19), 2.0),
    )
    expected = (
        0.35 * np.exp(-10 * 0.09)
        + 0.2 * np.exp(-5 * 0.04)
        + 0.25 * np.exp(-19 * 0.01)
        + 0.1 * np.exp(-2 * 0.25)
        + 0.1 * np.exp(-0.02 * 19 * 4)
    )
    moment = moment_of(bank, 5, off)
    assert residual.reward(moment, no_change(moment))[0] == pytest.approx(expected, abs=1e-5)


def test_papers_reward_penalizes_effort_and_height():
    bank = ReferenceBank([CLIPS[0]], H1)
    moment = moment_of(bank, 5)
    step = no_change(moment)
    assert hst.reward(moment, step)[0] - hst.reward(moment, replace(step, effort=torch.tensor([1e6])))[
        0
    ] == pytest.approx(1.0, abs=1e-4)
    low = replace(moment.state, root_pos_w=moment.state.root_pos_w - torch.tensor([0, 0, 0.1]))
    fall = hst.reward(moment, step)[0] - hst.reward(moment_of(bank, 5, low), step)[0]
    assert fall == pytest.approx(100 * 0.01 + 5 * (1 - np.exp(-1.0)), abs=1e-3)


def test_what_actions_mean():
    frame = ReferenceBank([CLIPS[0]], H1).frame(torch.zeros(1, dtype=torch.long), torch.tensor([1]))
    moved = residual.target(H1, frame, torch.ones(1, 19)) - frame.joint_pos
    np.testing.assert_allclose(moved[0], H1.gains["improved"].action_scale, atol=1e-6)
    absolute = hst.target(H1, frame, torch.full((1, 19), 9.0))
    np.testing.assert_allclose(absolute[0], H1.joint_range[:, 1], atol=1e-6)
    with pytest.raises(UnknownName, match="known are: improved, paper"):
        get_kind("quick")


def test_when_an_episode_ends():
    frame = ReferenceBank([CLIPS[0]], H1).frame(torch.zeros(6, dtype=torch.long), torch.zeros(6, dtype=torch.long))
    shift = torch.tensor([[0.49, 0, 0], [0.51, 0, 0], [0, 0, -0.24], [0, 0, -0.26], [0, 0, 0.3], [0, 0, 0]])
    turn = torch.tensor(rot.from_yaw(np.array([0.99, 0, 0, 0, 0, 1.01])), dtype=torch.float32)
    state = replace(state_of(frame), root_pos_w=frame.root_pos_w + shift, root_quat_w=turn)
    far, turned, dropped = deviations(
        state,
        frame.root_pos_w,
        frame.root_quat_w,
        TrackingConfig(max_pos_error=0.5, max_angle_error=1.0, max_drop=0.25),
    )
    assert far.tolist() == [False, True, False, False, False, False]
    assert turned.tolist() == [False, False, False, False, False, True]
    assert dropped.tolist() == [False, False, False, True, False, False]


@pytest.mark.parametrize("preset", ["improved", "paper"])
def test_environment(preset):
    env = TrackingEnv(get_kind(preset), H1, CLIPS, OBJECTS, 4, CALM, seed=0, workers=1)
    obs = env.observe()
    assert obs.shape == (4, 167 if preset == "improved" else 578) and obs.dtype == torch.float32
    length = int(env.bank.lengths[0])
    for step in range(length):
        hold = env.moment.reference(1).joint_pos if preset == "paper" else torch.zeros(4, 19)
        obs, reward, done, time_out = env.step(hold)
        assert torch.isfinite(obs).all() and torch.isfinite(reward).all()
        sits = env.clip == 1
        if preset == "improved" and step < length - 2:
            assert not done[sits].any() and (reward[sits] > 0.8).all(), "who sits stays seated"
        if step == length - 2:
            assert time_out.any() and (done | ~time_out).all(), (
                "a clip that is over ends an episode, and the learner is told"
            )
    assert env.ended["clip over"] >= 1


def test_environment_ends_and_restarts_who_falls():
    env = TrackingEnv(residual.RESIDUAL, H1, CLIPS, OBJECTS, 4, CALM, seed=0, workers=1)
    env.physics.push(np.array([1]), np.array([[40.0, 0, 0]]))
    _, _, done, time_out = env.step(torch.zeros(4, 19))
    assert done.tolist() == [False, True, False, False] and not time_out.any()
    assert env.ended["position"] == 1 and env.index[1] == 0 and env.index[0] == 1
    assert (env.moment.state.root_pos_w[1] - env.moment.reference(0).root_pos_w[1]).norm() < 1e-5, (
        "it starts again on its reference"
    )


def run(seed, workers):
    env = TrackingEnv(
        residual.RESIDUAL, H1, [swing(), *CLIPS], OBJECTS, 6, TrackingConfig(push_interval=0.1), seed, workers
    )
    total = []
    for _ in range(12):
        env.disturb()
        total.append(env.step(torch.zeros(6, 19))[0].numpy().tobytes())
    return total


def test_the_same_seed_gives_the_same_bits_whatever_the_threads():
    assert run(3, 1) == run(3, 2) != run(4, 1)


def test_checkpoint(tmp_path):
    config = TrackerConfig("improved", 167, 19, (8, 4))
    network = TrackerNetwork(167, 19, (8, 4))
    network.obs_mean.normal_()
    save_tracker(tmp_path, H1, config, network.tensors(), {"samples": 7})
    tracker = load_tracker(tmp_path, H1)
    obs = torch.randn(3, 167)
    assert torch.equal(tracker.network(obs), network(obs))
    assert tracker.kind is residual.RESIDUAL and tracker.config == config
    with pytest.raises(BadCheckpoint, match="another robot, 'h1'"):
        load_tracker(tmp_path, replace(H1, name="g1"))
    save_tracker(tmp_path, H1, replace(config, hidden=(8, 5)), network.tensors(), {})
    with pytest.raises(BadCheckpoint, match="train it again"):
        load_tracker(tmp_path, H1)
    save_tracker(tmp_path, H1, replace(config, preset="quick"), network.tensors(), {})
    with pytest.raises(UnknownName, match="quick"):
        load_tracker(tmp_path, H1)


def collect(learner, random):
    """One round of made-up experience, and the update on it."""
    obs = torch.tensor(random.normal(size=(4, 6)), dtype=torch.float32)
    for _ in range(TINY.steps):
        action = learner.act(obs)
        reward, done = action.pow(2).sum(-1).neg(), torch.tensor(random.random(4) < 0.2)
        obs = torch.tensor(random.normal(size=(4, 6)), dtype=torch.float32)
        learner.record(obs, reward, done, done & False)
    return learner.update(obs)


def test_learning_is_taken_up_as_if_it_had_never_stopped():
    torch.manual_seed(0)
    first, second = PPOLearner(6, 2, 4, TINY), PPOLearner(6, 2, 4, TINY)
    collect(first, np.random.default_rng(0))
    saved = first.state_tensors()
    losses = collect(first, np.random.default_rng(1))
    second.load_state_tensors(saved)
    again = collect(second, np.random.default_rng(1))
    assert again == losses
    for name, value in first.state_tensors().items():
        np.testing.assert_array_equal(second.state_tensors()[name], value, err_msg=name)


def test_the_exported_network_is_the_actors_mean():
    torch.manual_seed(0)
    learner = PPOLearner(6, 2, 4, TINY)
    for seed in range(3):
        collect(learner, np.random.default_rng(seed))
    network = TrackerNetwork(6, 2, TINY.hidden)
    network.load_tensors(learner.network_tensors())
    obs = torch.randn(4, 6)
    torch.manual_seed(1)
    actions = torch.stack([learner.act(obs) for _ in range(400)])
    std = learner.ppo.actor.output_std.detach().reshape(-1)[:2].numpy()
    np.testing.assert_allclose(actions.mean(0), network(obs).detach(), atol=5 * float(std.max()) / 20)


def test_first_actions_leave_the_reference_alone():
    torch.manual_seed(0)
    network = TrackerNetwork(167, 19, PPOConfig().hidden)
    network.load_tensors(PPOLearner(167, 19, 4, PPOConfig()).network_tensors())
    assert network(torch.randn(16, 167)).abs().max() < 0.05


def test_training_end_to_end_and_again(tmp_path):
    config = TrackConfig(samples=3 * 8 * TINY.steps, num_envs=8, evaluate_clips=2, threads=1, ppo=TINY)
    rows = []
    folder = train_tracker(
        tmp_path, H1, SIT_CHAIR, CLIPS, CLIPS[1:], OBJECTS, config, seed=0, workers=1, report=rows.append
    )
    assert rows[-1]["samples"] == config.samples and rows[-1]["iterations"] == 3
    assert rows[-1]["k_held_out"] == 1.0, "who is placed seated and left alone stays so"
    tracker = load_tracker(folder, H1)
    rollout = track_clips(tracker, H1, SIT_CHAIR, CLIPS, OBJECTS, workers=1, record=True)
    assert rollout.judge.success.tolist() == [False, True]
    assert [track.shape for track in rollout.qpos] == [(int(steps), 26) for steps in rollout.steps]
    assert [track.shape for track in rollout.targets] == [(int(steps), 19) for steps in rollout.steps]
    # taken up with twice as many samples it goes on from there
    longer = replace(config, samples=2 * config.samples)
    train_tracker(tmp_path, H1, SIT_CHAIR, CLIPS, CLIPS[1:], OBJECTS, longer, seed=0, workers=1, report=rows.append)
    assert rows[-1]["samples"] == longer.samples and rows[-1]["iterations"] == 6


def test_recorded_targets_stay_clean():
    network = TrackerNetwork(167, 19, (4,))
    for parameter in network.parameters():
        parameter.data.zero_()
    tracker = Tracker(residual.RESIDUAL, TrackerConfig("improved", 167, 19, (4,)), network)
    calm, noisy = (
        track_clips(tracker, H1, SIT_CHAIR, CLIPS[1:], OBJECTS, 1, record=True, action_noise=noise, seed=1)
        for noise in (0.0, 0.05)
    )
    reference = torch.tensor(seated(0.42)[1], dtype=torch.float32)
    np.testing.assert_allclose(noisy.targets[0], np.tile(reference, (len(noisy.targets[0]), 1)), atol=1e-6)
    np.testing.assert_array_equal(calm.executed[0], calm.targets[0])
    assert 0.04 < (noisy.executed[0] - noisy.targets[0]).std() < 0.06
    assert not np.array_equal(calm.qpos[0], noisy.qpos[0])
