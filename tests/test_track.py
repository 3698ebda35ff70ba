"""Tracking: the reference's derivatives, sizes of what trackers see, rewards and endings by hand, and learning that
can be taken up again.
"""

import shutil
from dataclasses import replace

import numpy as np
import pytest
import torch

from mimicbench.core import rotations as rot
from mimicbench.core.checkpoint import BadCheckpoint
from mimicbench.core.errors import BadMotion, MimicbenchError, UnknownName
from mimicbench.core.training import TorchRandom
from mimicbench.envs.clip_starts import ClipStartConfig, ClipStarts
from mimicbench.envs.clips import ClipSet
from mimicbench.envs.disturbance import Disturbance
from mimicbench.envs.reference import ReferenceBank
from mimicbench.envs.vec_env import EnvConfig, VecEnv
from mimicbench.sensors.observations import TERMS
from mimicbench.sensors.proprioception import body_state
from mimicbench.sensors.reference import reference_in_root, reference_links
from mimicbench.sim.physics import ObjectState
from mimicbench.sim.rows import Rows
from mimicbench.tasks.registry import TASKS
from mimicbench.track.checkpoint import CRITIC, TrackerConfig, build_tracker, load_critic, load_tracker, save_tracker
from mimicbench.track.failures import PARTS, REWIND, Failures
from mimicbench.track.network import Blueprint, MLPConfig
from mimicbench.track.parts import TrackingParts
from mimicbench.track.ppo import PPOConfig, PPOLearner
from mimicbench.track.registry import TRACKERS
from mimicbench.track.rollout import RolloutConfig, track_clips
from mimicbench.track.spec import Layout
from mimicbench.track.trackers import hst, residual
from mimicbench.track.tracking import ENDS, EndConfig, TrackingConfig, TrackingEnv, deviations
from mimicbench.track.train import TrackConfig, begin_from, robots_of, train_tracker
from stool import H1, block, seated
from tracked import (
    CALM,
    CLIPS,
    LIFT_BOX,
    ONE_THREAD,
    RATES,
    SIT_CHAIR,
    STOOL,
    TINY,
    TOUCH,
    FakePhysics,
    clip_set,
    context_of,
    lifted,
    moved_on,
    observed,
    shifted,
    state_of,
    swing,
    tiny,
)

RESIDUAL, HST, PHC = (TRACKERS.get(name) for name in ("residual", "hst", "phc"))
OURS, PAPERS = residual.ResidualConfig(), hst.HSTConfig()
SMALL = Blueprint(MLPConfig(TINY.hidden), 6)


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
    links = reference_links(H1, bank.frame(clip, torch.tensor([49, 50, 51])))
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


def test_a_frame_has_the_object_and_the_goals():
    goals = np.array([[0.3, 0.2, 0.9], [0.3, -0.2, 0.8]])
    bank = ReferenceBank([swing(), lifted(), replace(swing(), wrist_goal_w=goals)], H1)
    clip, index = torch.tensor([0, 1, 2]), torch.tensor([20, 20, 20])
    frame = bank.frame(clip, index)
    at = 20 / 50
    np.testing.assert_allclose(frame.object.pos_w, [[0, 0, 0], [0.3, 0, 0.2 * at], [0, 0, 0]], atol=1e-6)
    np.testing.assert_allclose(frame.object.lin_vel_w, [[0, 0, 0], [0, 0, 0.2], [0, 0, 0]], atol=1e-5)
    np.testing.assert_allclose(frame.object.ang_vel_b, [[0, 0, 0], [0, 0, 0.3], [0, 0, 0]], atol=1e-5)
    np.testing.assert_allclose(frame.object.quat_w[1], rot.from_yaw(np.array(0.3 * at)), atol=1e-6)
    assert torch.isnan(frame.wrist_goal_w[:2]).all()
    np.testing.assert_allclose(frame.wrist_goal_w[2], goals, atol=1e-6)


def test_a_clip_is_entered_with_the_box_in_mid_air():
    box = block(0.4, 0.2, movable=True, mass=2.0)
    motion = replace(lifted(), object_id=box.id)
    bank = ReferenceBank([motion], H1)
    env = VecEnv(LIFT_BOX, H1, [box, box], ONE_THREAD, bank=bank)
    starts = ClipStarts(bank, env.physics.add_objects([box]), H1)
    clip, frame = torch.zeros(2, dtype=torch.long), torch.tensor([10, 45])
    env.reset(Rows.every(2), starts.at(clip, frame))
    wanted, found = bank.frame(clip, frame).object, env.context.object
    for name in ("pos_w", "quat_w", "lin_vel_w", "ang_vel_b"):
        np.testing.assert_allclose(getattr(found, name), getattr(wanted, name), atol=1e-6, err_msg=name)
    assert found.pos_w[1, 2] > 0.15, "it is in mid-air"
    assert TERMS["object"].compute(env.context).shape == (2, 12)


def test_what_trackers_see():
    context = context_of(ReferenceBank([swing()], H1), 10)
    assert observed(RESIDUAL, context).shape == (1, 167)
    assert observed(HST, context).shape == (1, 578)
    assert body_state(context.state).shape == (1, 48)
    carrying = context_of(ReferenceBank([lifted()], H1), 10, task=LIFT_BOX)
    assert observed(HST, carrying).shape == (1, 578 + 24), "the box's state and its target"
    goals = np.array([[0.3, 0.2, 0.9], [0.3, -0.2, 0.8]])
    touching = context_of(ReferenceBank([replace(swing(), wrist_goal_w=goals)], H1), 10, task=TOUCH)
    assert observed(HST, touching).shape == (1, 578 + 6), "both wrists' targets"


def test_simplified_phc_is_told_differences_and_pays_nothing_for_haste():
    bank = ReferenceBank([swing()], H1)
    context = context_of(bank, 10)
    obs = observed(PHC, context)
    assert obs.shape == (1, 698), "as many as the paper's (F.1)"
    body, wanted, difference = obs[:, :278], obs[:, 278:556], obs[:, 556:676]
    np.testing.assert_allclose(difference, (body - wanted)[:, 38:158], atol=1e-6)
    assert difference.abs().max() > 1e-3, "the next frame is another"
    hasty = moved_on(bank, context, action=3.0)
    fast = replace(context, state=replace(context.state, joint_vel=torch.full((1, 19), 9.0)))
    still_bank = ReferenceBank([CLIPS[0]], H1)
    rests = context_of(still_bank, 10)
    assert PHC.reward(rests, moved_on(still_bank, rests), PHC.settings())[0] == pytest.approx(26, abs=1e-2)
    ours = [float(PHC.reward(where, hasty, PHC.settings())[0]) for where in (context, fast)]
    assert ours[0] == ours[1], "only where its links are counts"


def test_observations_do_not_know_where_the_world_is():
    # the same situation, turned about the vertical and moved along the floor
    bank = ReferenceBank([swing()], H1)
    yaw, shift = 1.1, np.array([3.0, -2.0, 0.0])
    turn = rot.from_yaw(np.array(yaw))
    motion = swing()
    pos, quat = rot.rotate(turn, motion.root_pos_w) + shift, rot.multiply(turn, motion.root_quat_w)
    moved = ReferenceBank([replace(motion, root_pos_w=pos, root_quat_w=quat)], H1)
    for spec in (RESIDUAL, HST, PHC):
        ours, theirs = (observed(spec, context_of(some, 20)) for some in (bank, moved))
        np.testing.assert_allclose(ours, theirs, atol=1e-3)


def test_at_its_next_frame_the_reference_is_nowhere_else():
    # a robot already at the next frame sees no difference in position, orientation and joints
    bank = ReferenceBank([swing()], H1)
    frame = bank.frame(torch.zeros(1, dtype=torch.long), torch.tensor([11]))
    plan = reference_in_root(state_of(frame), frame)[0]
    np.testing.assert_allclose(plan[:9], [0, 0, 0, 1, 0, 0, 0, 1, 0], atol=1e-6)
    np.testing.assert_allclose(plan[12:31], 0, atol=1e-6)


def test_reward_of_perfect_tracking():
    bank = ReferenceBank([swing()], H1)
    context = context_of(bank, 10)
    assert RESIDUAL.reward(context, moved_on(bank, context), OURS)[0] == pytest.approx(1.4, abs=1e-5)
    away = RESIDUAL.reward(shifted(context, [0.06, 0.08, 0.0]), moved_on(bank, context), OURS)[0]
    assert away == pytest.approx(1.0 + 0.2 * (np.exp(-1) + np.exp(-0.5)), abs=1e-5), "wrists and ankles 10 cm off"
    changed = moved_on(bank, context, action=0.5, previous=0.3)
    assert RESIDUAL.reward(context, changed, OURS)[0] == pytest.approx(1.4 - 0.005 * 19 * 0.04, abs=1e-5)
    # F.3: 1 for the positions, 1 for each of 20 orientations, 5 for the root; joints as they are to be
    still_bank = ReferenceBank([CLIPS[0]], H1)
    rests = context_of(still_bank, 10)
    assert HST.reward(rests, moved_on(still_bank, rests), PAPERS)[0] == pytest.approx(26, abs=1e-2)


def test_reward_by_hand():
    bank = ReferenceBank([CLIPS[0]], H1)
    off = state_of(bank.frame(torch.zeros(1, dtype=torch.long), torch.tensor([5])))
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
        + 0.2 / (1 + 5 * 0.04)
        + 0.25 / (1 + 19 * 0.01)
        + 0.1 * np.exp(-2 * 0.25)
        + 0.1 * np.exp(-0.02 * 19 * 4)
        + 0.2
        + 0.2  # the links stand where they are to stand
    )
    context = context_of(bank, 5, off)
    assert RESIDUAL.reward(context, moved_on(bank, context, 4), OURS)[0] == pytest.approx(expected, abs=1e-5)


def test_our_reward_charges_for_power_by_its_logarithm():
    """0.3 of log(1 + e / 1e6 W^2): log 2 at 1 MW^2, log 4 at 3; nothing unless it is asked for."""
    bank = ReferenceBank([swing()], H1)
    at = context_of(bank, 10)
    for effort, logarithm in ((0.0, 0.0), (1e6, np.log(2.0)), (3e6, np.log(4.0))):
        step = replace(moved_on(bank, at), effort=torch.tensor([effort]))
        dear = RESIDUAL.reward(at, step, residual.ResidualConfig(power=0.3))[0]
        assert dear == pytest.approx(1.4 - 0.3 * logarithm, abs=1e-5)
        assert RESIDUAL.reward(at, step, OURS)[0] == pytest.approx(1.4, abs=1e-5)
    assert not RESIDUAL.measures_effort(OURS) and RESIDUAL.measures_effort(residual.ResidualConfig(power=0.3))


def test_one_arm_or_leg_that_is_off_counts_by_half():
    """The left wrist 0.1 m off costs half of what wrists are worth less exp(-1); the right ankle, less exp(-0.5)."""
    bank = ReferenceBank([swing()], H1)
    at = context_of(bank, 10)
    for name, kept in (("left_wrist", np.exp(-1.0)), ("right_ankle", np.exp(-0.5))):
        away = torch.zeros(1, len(H1.links), 3)
        away[0, H1.keypoints[name][0], 1] = 0.1
        found = RESIDUAL.reward(shifted(at, away.tolist()), moved_on(bank, at), OURS)[0]
        assert found == pytest.approx(1.4 - 0.2 * (1 - kept) / 2, abs=1e-5), name


def papers(bank, context, **changes):
    """The paper's reward at frame 5 of a clip at rest, after a step with these differences."""
    step = moved_on(bank, context, 4)
    return float(HST.reward(context, replace(step, **changes), PAPERS)[0])


def test_every_coefficient_of_the_papers_reward():
    """F.3: what each part is worth, worked out by hand for one deviation at a time."""
    bank = ReferenceBank([CLIPS[0]], H1)
    at = context_of(bank, 5)
    perfect = papers(bank, at)
    state = at.state
    assert perfect - papers(bank, at, effort=torch.tensor([1e6])) == pytest.approx(1.0, abs=1e-4), "1e-6 r_energy"
    assert perfect - papers(bank, at, action=torch.full((1, 19), 2.0)) == pytest.approx(1e-3 * 19 * 4, abs=1e-5)
    # joints that turn faster now and before: a price on velocity, none on acceleration
    fast = replace(at, state=replace(state, joint_vel=torch.full((1, 19), 3.0)))
    assert perfect - papers(bank, fast) == pytest.approx(2e-3 * 19 * 9, abs=1e-4)
    # and now alone: 3 rad/s more within 0.02 s is 150 rad/s^2
    jerk = moved_on(bank, at, 4)
    found = float(HST.reward(fast, jerk, PAPERS)[0])
    assert perfect - found == pytest.approx(2e-3 * 19 * 9 + 5e-7 * 19 * 150**2, abs=1e-4)


@pytest.mark.parametrize(("task", "weight"), [(SIT_CHAIR, 100), (TASKS.get("lie-bed"), 10)])
def test_papers_reward_weighs_positions_height_and_orientation(task, weight):
    bank = ReferenceBank([CLIPS[0]], H1)
    at = context_of(bank, 5, task=task)
    low = papers(bank, shifted(at, [0.0, 0.0, -0.1]))
    r_pos, r_root = np.exp(-5 * 20 * 0.01), 5 * np.exp(-10 * 0.1) - weight * 0.01
    assert low == pytest.approx(r_pos + 20 + r_root, abs=1e-3)
    links = at.physics.links()
    turned = rot.multiply(torch.tensor(rot.from_yaw(np.array(0.3)), dtype=torch.float32).expand(1, 20, 4), links.quat_w)
    physics = FakePhysics(replace(links, quat_w=turned), at.object)
    assert papers(bank, replace(at, physics=physics)) == pytest.approx(1 + 20 * np.exp(-0.3) + 5, abs=1e-3)


def test_papers_reward_multiplies_by_wrists_and_object():
    goals = np.array([[0.3, 0.2, 0.9], [0.3, -0.2, 0.8]])
    bank = ReferenceBank([replace(CLIPS[0], wrist_goal_w=goals)], H1)
    touching = context_of(bank, 5, task=TOUCH)
    assert papers(bank, touching) == pytest.approx(26 * 2, abs=1e-2), "r_human x r_wrist, 1 for each wrist"
    moved = papers(bank, shifted(touching, [0.1, 0.0, 0.0]))
    human = np.exp(-5 * 20 * 0.01) + 20 + 5 * np.exp(-1.0)
    assert moved == pytest.approx(human * 2 * np.exp(-1.0), abs=1e-2)
    box = replace(CLIPS[0], object_pos_w=np.zeros((40, 3)), object_quat_w=np.tile(rot.IDENTITY, (40, 1)))
    carried = ReferenceBank([box], H1)
    there = ObjectState.at_origin(1)
    lifting = context_of(carried, 5, task=LIFT_BOX, obj=there)
    assert papers(carried, lifting) == pytest.approx(26 * 2 * 1, abs=1e-2)
    off = replace(there, pos_w=torch.tensor([[0.0, 0.1, 0.0]]))
    away = context_of(carried, 5, task=LIFT_BOX, obj=off)
    expected = 26 * 2 * np.exp(-1.0) * np.exp(-1.0)
    assert papers(carried, away) == pytest.approx(expected, abs=1e-2), "r_w->o and r_object both see it"


def test_our_reward_follows_the_object_where_it_moves():
    bank = ReferenceBank([lifted()], H1)
    at = context_of(bank, 10, task=LIFT_BOX)
    assert RESIDUAL.reward(at, moved_on(bank, at), OURS)[0] == pytest.approx(0.5 * 1.4 + 0.5, abs=1e-5)
    obj = at.object
    away = replace(obj, pos_w=obj.pos_w + torch.tensor([0.1, 0, 0]))
    lost = context_of(bank, 10, task=LIFT_BOX, obj=away)
    assert RESIDUAL.reward(lost, moved_on(bank, lost), OURS)[0] == pytest.approx(0.7 + 0.5 * np.exp(-1.0), abs=1e-5)


def test_what_actions_mean():
    frame = ReferenceBank([CLIPS[0]], H1).frame(torch.zeros(1, dtype=torch.long), torch.tensor([1]))
    moved = RESIDUAL.target(H1, frame.joint_pos, torch.ones(1, 19), OURS) - frame.joint_pos
    np.testing.assert_allclose(moved[0], H1.gains["improved"].action_scale, atol=1e-6)
    absolute = HST.target(H1, frame.joint_pos, torch.full((1, 19), 9.0), PAPERS)
    np.testing.assert_allclose(absolute[0], H1.joint_range[:, 1], atol=1e-6)
    with pytest.raises(UnknownName, match="known are: .*residual"):
        TRACKERS.get("quick")


@pytest.mark.parametrize("spec", TRACKERS.all(), ids=TRACKERS.names())
def test_a_tracker_reads_the_next_pose_off_its_plan(spec):
    """Whoever plans for a tracker gives its privileged terms; the joint angles in them are the reference's."""
    bank = ReferenceBank([swing()], H1)
    context = context_of(bank, 10)
    terms = {name: TERMS[name].compute(context) for name in Layout.of(spec, H1, [SIT_CHAIR]).names}
    np.testing.assert_allclose(spec.next_joint_pos(H1, terms), context.reference(1).joint_pos, atol=1e-6)
    assert all(TERMS[name].privileged for name in spec.plan(SIT_CHAIR)) and spec.plan(SIT_CHAIR)


def test_when_an_episode_ends():
    bank = ReferenceBank([CLIPS[0]], H1)
    ends = EndConfig(0.5, 1.0, 0.25, max_object_error=0.15)
    shifts = [[0.49, 0, 0], [0.51, 0, 0], [0, 0, -0.24], [0, 0, -0.26], [0, 0, 0.3], [0, 0, 0]]
    found = []
    for shift, yaw in zip(shifts, [0.99, 0, 0, 0, 0, 1.01], strict=True):
        state = context_of(bank, 0).state
        turn = torch.tensor(rot.from_yaw(np.array([yaw])), dtype=torch.float32)
        off = replace(state, root_pos_w=state.root_pos_w + torch.tensor(shift), root_quat_w=turn)
        found.append([bool(flag) for flag in deviations(context_of(bank, 0, off), ends)])
    far, turned, dropped, left, lost = zip(*found, strict=True)
    assert far == (False, True, False, False, False, False)
    assert turned == (False, False, False, False, False, True)
    assert dropped == (False, False, False, True, False, False)
    assert not any(lost) and not any(left)
    frame = context_of(bank, 0).reference(0)
    ahead = replace(frame, ankle_pos_w=frame.ankle_pos_w + torch.tensor([[0.0, 0, 0], [0.3, 0.4, 0]]))
    for most, expected in ((0.49, True), (0.51, False)):  # the right one is half a meter off
        context = replace(context_of(bank, 0), reference=lambda _: ahead)
        assert bool(deviations(context, EndConfig(max_ankle_error=most))[3]) is expected
    carried = ReferenceBank([lifted()], H1)
    for distance, expected in ((0.14, False), (0.16, True)):
        obj = context_of(carried, 0).object
        away = replace(obj, pos_w=obj.pos_w + torch.tensor([0, distance, 0]))
        assert bool(deviations(context_of(carried, 0, task=LIFT_BOX, obj=away), ends)[4]) is expected


@pytest.mark.parametrize("spec", [RESIDUAL, HST, PHC], ids=lambda spec: spec.name)
def test_environment(spec):
    env = TrackingEnv(spec, clip_set(), 4, CALM, 0, ONE_THREAD)
    obs = env.observe()
    assert obs.shape == (4, {"residual": 167, "hst": 578, "phc": 698}[spec.name]) and obs.dtype == torch.float32
    length, settings = int(env.bank.lengths[0]), spec.settings()
    for step in range(length):
        hold = env.context.reference(1).joint_pos if spec is not RESIDUAL else torch.zeros(4, 19)
        obs, reward, done, time_out = env.step(hold, settings)
        assert torch.isfinite(obs).all() and torch.isfinite(reward).all()
        assert not (time_out & ~done).any(), "a time-out is an end"
        sits = env.env.clip == 1
        if spec is RESIDUAL and step < length - 2:
            assert not done[sits].any() and (reward[sits] > 0.8).all(), "who sits stays seated"
        if step == length - 2:
            assert time_out.any(), "a clip that is over ends an episode, and the learner is told"
    assert env.ended[ENDS.index("clip over")] >= 1


def test_who_fails_as_the_clip_ends_has_failed():
    env = TrackingEnv(RESIDUAL, clip_set(), 2, CALM, 0, ONE_THREAD)
    env.env.index[:] = env.bank.lengths[env.env.clip] - 2
    env.env.physics.push(torch.tensor([[40.0, 0, 0], [0, 0, 0]]))
    _, _, done, time_out = env.step(torch.zeros(2, 19), OURS)
    assert done.tolist() == [True, True] and time_out.tolist() == [False, True]


def test_environment_ends_and_restarts_who_falls():
    env = TrackingEnv(RESIDUAL, clip_set(), 4, CALM, 0, ONE_THREAD)
    push = torch.zeros(4, 3)
    push[1, 0] = 40.0
    env.env.physics.push(push)
    _, _, done, time_out = env.step(torch.zeros(4, 19), OURS)
    assert done.tolist() == [False, True, False, False] and not time_out.any()
    assert env.ended[ENDS.index("position")] == 1 and env.env.index[1] == 0 and env.env.index[0] == 1
    away = env.context.state.root_pos_w[1] - env.context.reference(0).root_pos_w[1]
    assert away.norm() < 1e-5, "it starts again on its reference"


def test_who_sinks_below_the_limit_ends():
    env = TrackingEnv(RESIDUAL, clip_set(CLIPS[0]), 2, CALM, 0, ONE_THREAD)
    state = env.context.state
    sunk = torch.tensor([[0.0, 0.0, -0.21], [0.0, 0.0, -0.19]])
    env.env.physics.reset(Rows.every(2), replace(state, root_pos_w=state.root_pos_w + sunk))
    env.env._context = env.env._look()
    assert deviations(env.context, EndConfig())[2].tolist() == [True, False]


def test_the_last_pose_is_to_be_held():
    env = TrackingEnv(RESIDUAL, clip_set(CLIPS[1]), 2, replace(CALM, hold=0.1), 0, ONE_THREAD)
    env.env.index[:] = env.bank.lengths[env.env.clip] - 2
    ends = [env.step(torch.zeros(2, 19), OURS)[3].tolist() for _ in range(6)]
    assert ends == [[False, False]] * 5 + [[True, True]], "five control steps after the clip's last frame"


def test_failures_draw_the_starts_to_where_they_happen():
    failures = Failures()
    np.testing.assert_allclose(Failures().chances(0.0), np.full(PARTS, 1 / PARTS))
    for _ in range(9000):  # nobody fails but in part 20, where one in four does
        progress = (torch.arange(PARTS * 4) // 4 + 0.5) / PARTS
        failures.update(progress, (torch.arange(PARTS * 4) == 80))
    chances = failures.chances(0.5)
    np.testing.assert_allclose(chances.sum(), 1.0, atol=1e-6)
    np.testing.assert_allclose(chances[21:], np.full(PARTS - 21, 0.5 / PARTS), rtol=0.02)
    drawn = chances[:21] - 0.5 / PARTS
    np.testing.assert_allclose(drawn[:-1] / drawn[1:], np.full(20, REWIND), rtol=0.02)
    np.testing.assert_allclose(drawn.sum(), 0.5, rtol=0.02)


def test_one_failure_beside_what_was_taken_as_given():
    """A hundredth of all that is in a part has failed before anything is seen; of what was, 1/1000 is forgotten a step.

    Then one robot fails at 0.1, which is in part 3, and one does not at its end, which is in part 31.
    """
    failures = Failures()
    failures.update(torch.tensor([0.1, 1.0]), torch.tensor([True, False]))
    assert failures.steps[[0, 3, 30, 31]].tolist() == pytest.approx([99.9, 100.9, 99.9, 100.9], abs=3e-5)
    assert failures.failed[[0, 3, 30, 31]].tolist() == pytest.approx([0.999, 1.999, 0.999, 0.999], abs=1e-6)
    hazard = np.full(PARTS, 0.01)
    hazard[[3, 31]] = 1.999 / 100.9, 0.999 / 100.9
    weight = [sum(hazard[later] * 0.6 ** (later - part) for later in range(part, PARTS)) for part in range(PARTS)]
    np.testing.assert_allclose(failures.chances(1.0), weight / np.sum(weight), rtol=1e-5)
    # what was hardly ever seen counts as seen once: 0.25 of 1, not of 0.5
    steps, failed = torch.full((PARTS,), 10.0), torch.zeros(PARTS)
    steps[31], failed[31], failed[0] = 0.5, 0.25, 5.0
    failures.load_state_tensors({"steps": steps, "failed": failed})
    weight = [0.25 * 0.6 ** (31 - part) + 0.5 * (part == 0) for part in range(PARTS)]
    np.testing.assert_allclose(failures.chances(1.0), weight / np.sum(weight), rtol=1e-5)


def test_starts_follow_the_chances_of_parts():
    env = TrackingEnv(RESIDUAL, clip_set(swing()), 2, TrackingConfig(), 0, ONE_THREAD)
    starts = ClipStarts(env.bank, [0], H1, ClipStartConfig(first_frame=0.0))
    chances = torch.zeros(4)
    chances[2] = 1.0
    drawn = starts.draw(200, torch.Generator().manual_seed(0), chances)
    share = drawn.frame / float(env.bank.lengths[0] - 2)
    assert share.min() >= 0.48 and share.max() < 0.75


def run(seed, workers):
    config = TrackingConfig(push_interval=0.1)
    env = TrackingEnv(RESIDUAL, clip_set(swing(), *CLIPS), 6, config, seed, EnvConfig(workers=workers))
    return [env.step(torch.zeros(6, 19), OURS)[0].numpy().tobytes() for _ in range(12)]


def test_the_same_seed_gives_the_same_bits_whatever_the_threads():
    assert run(3, 1) == run(3, 2) != run(4, 1)


def test_an_environment_is_taken_up_as_if_it_had_never_stopped():
    def make():
        return TrackingEnv(RESIDUAL, clip_set(swing(), *CLIPS), 6, TrackingConfig(push_interval=0.1), 0, ONE_THREAD)

    first, second = make(), make()
    for _ in range(7):
        first.step(torch.zeros(6, 19), OURS)
    second.load_state_tensors(first.state_tensors())
    for _ in range(30):
        ours, theirs = (env.step(torch.full((6, 19), 0.1), OURS) for env in (first, second))
        for mine, other in zip(ours, theirs, strict=True):
            assert mine.numpy().tobytes() == other.numpy().tobytes()


LAYOUT = Layout.of(RESIDUAL, H1, [SIT_CHAIR])


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
    first, second = PPOLearner(SMALL, 2, 4, TINY), PPOLearner(SMALL, 2, 4, TINY)
    collect(first, np.random.default_rng(0))
    saved, random = first.state_tensors(), TorchRandom().state_tensors()
    losses = collect(first, np.random.default_rng(1))
    second.load_state_tensors(saved)
    TorchRandom().load_state_tensors(random)
    again = collect(second, np.random.default_rng(1))
    assert again == losses
    for name, value in first.state_tensors().items():
        np.testing.assert_array_equal(second.state_tensors()[name], value, err_msg=name)


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


def test_training_is_over_when_every_task_is_good_enough(tmp_path):
    def samples(until, *held_out):
        rows, config = [], replace(tiny(3), evaluate_every=1, until=until)
        folder = tmp_path / f"{until}-{len(held_out)}"
        train_tracker(folder, [clip_set()], held_out, config, 0, ONE_THREAD, rows.append)
        return rows[-1]["samples"]

    assert samples(0.9, clip_set(CLIPS[1])) == tiny(1).samples, "who is placed seated stays so"
    assert samples(1.0, clip_set(CLIPS[1])) == tiny(3).samples
    assert samples(0.9, clip_set()) == tiny(3).samples, "the other of the two falls"
    assert samples(0.4) == tiny(1).samples, "nobody else is there: the training clips count"


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
    shutil.rmtree(first / CRITIC)
    assert load_critic(first, H1) is None


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


def idle():
    """A tracker that leaves the reference as it is."""
    network = LAYOUT.blueprint(MLPConfig((4,))).network(19)
    for parameter in network.parameters():
        parameter.data.zero_()
    return build_tracker(TrackerConfig("residual", LAYOUT.names, LAYOUT.widths, 19, (4,)), network.tensors())


def test_recorded_targets_stay_clean():
    tracker = idle()
    calm, noisy = (
        track_clips(
            tracker, clip_set(CLIPS[1]), RolloutConfig(True, Disturbance(action_noise=noise), 1), ONE_THREAD
        ).recording
        for noise in (0.0, 0.05)
    )
    reference = torch.tensor(seated(0.42)[1], dtype=torch.float32)
    np.testing.assert_allclose(noisy.targets[0], np.tile(reference, (len(noisy.targets[0]), 1)), atol=1e-6)
    np.testing.assert_array_equal(calm.applied[0], calm.targets[0])
    assert 0.04 < (noisy.applied[0] - noisy.targets[0]).std() < 0.06
    assert not np.array_equal(calm.qpos[0], noisy.qpos[0])


def test_worlds_are_made_worse():
    calm = track_clips(idle(), clip_set(swing()), RolloutConfig(True), ONE_THREAD).recording.qpos[0]
    troubles = {
        "push": Disturbance(push=0.3, push_interval=0.1),
        "delay": Disturbance(delay=2),
        "friction": Disturbance(friction=0.3),
        "mass": Disturbance(mass=1.2),
        "noise": Disturbance(noise={"proprio": 0.05}),
    }
    for name, trouble in troubles.items():
        track = track_clips(idle(), clip_set(swing()), RolloutConfig(True, trouble), ONE_THREAD).recording.qpos[0]
        again = track_clips(idle(), clip_set(swing()), RolloutConfig(True, trouble), ONE_THREAD).recording.qpos[0]
        assert track.tobytes() == again.tobytes(), "the same seed, the same bytes"
        assert (track.tobytes() != calm.tobytes()) or name == "noise", "idle trackers sense nothing"
    env = VecEnv(SIT_CHAIR, H1, [STOOL], Disturbance(mass=1.1, friction=0.6).of(ONE_THREAD))
    light, heavy = VecEnv(SIT_CHAIR, H1, [STOOL], ONE_THREAD).physics.model(0), env.physics.model(0)
    links = slice(1, 1 + len(H1.links))
    np.testing.assert_allclose(heavy.body_mass[links], 1.1 * light.body_mass[links])
    np.testing.assert_allclose(heavy.body_inertia[links], 1.1 * light.body_inertia[links])
    np.testing.assert_allclose(heavy.geom_friction[:, 0], 0.6 * light.geom_friction[:, 0])
    np.testing.assert_array_equal(heavy.geom_friction[:, 1:], light.geom_friction[:, 1:])


def test_trackers_go_on_to_the_time_limit_when_asked():
    tracker = idle()
    clips = replace(clip_set(), task=replace(SIT_CHAIR, time_limit=3.0))
    verdict = track_clips(tracker, clips, RolloutConfig(settle=None), ONE_THREAD).verdict
    assert verdict.steps.tolist() == [150, 150] and verdict.stays.tolist() == [False, True]
    assert verdict.fell.tolist() == [True, False], "who only stands topples within seconds"


def test_a_training_killed_between_its_state_and_its_checkpoint_has_both_alike(tmp_path):
    made = train_tracker(tmp_path / "a", [clip_set()], [clip_set(CLIPS[1])], tiny(2), 0, ONE_THREAD)
    whole = (made / "model.safetensors").read_bytes()
    old = train_tracker(tmp_path / "b", [clip_set()], [clip_set(CLIPS[1])], tiny(1), 0, ONE_THREAD)
    for name in ("model.safetensors", "config.json"):
        (made / name).write_bytes((old / name).read_bytes())  # what had been saved before
    again = train_tracker(tmp_path / "a", [clip_set()], [clip_set(CLIPS[1])], tiny(2), 0, ONE_THREAD)
    assert (again / "model.safetensors").read_bytes() == whole
