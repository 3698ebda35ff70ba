"""What trackers see and what their actions mean, and every term of their rewards by hand."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from mimicbench.core import rotations as rot
from mimicbench.core.errors import UnknownName
from mimicbench.envs.reference import ReferenceBank
from mimicbench.sensors.observations import TERMS
from mimicbench.sensors.proprioception import body_state
from mimicbench.sensors.reference import reference_in_root
from mimicbench.sim.physics import ObjectState
from mimicbench.tasks.registry import TASKS
from mimicbench.track.registry import TRACKERS
from mimicbench.track.tracker import Layout
from mimicbench.track.trackers import residual
from stool import H1
from tracked import (
    CLIPS,
    HST,
    LIFT_BOX,
    OURS,
    PAPERS,
    PHC,
    RESIDUAL,
    SIT_CHAIR,
    TOUCH,
    FakePhysics,
    context_of,
    lifted,
    moved_on,
    observed,
    shifted,
    state_of,
    swing,
)


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
