"""References: frames of clips at the control rate, their derivatives, and episodes that begin at any of them."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion
from mimicbench.envs.clip_starts import ClipStarts
from mimicbench.envs.reference import ReferenceBank
from mimicbench.envs.vec_env import VecEnv
from mimicbench.sensors.observations import TERMS
from mimicbench.sensors.reference import reference_links
from mimicbench.sim.rows import Rows
from stool import H1, block
from tracked import (
    CLIPS,
    LIFT_BOX,
    ONE_THREAD,
    RATES,
    lifted,
    swing,
)


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
