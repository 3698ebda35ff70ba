"""The environment that trackers learn in: when episodes end, where they begin, and the same bits for the same seed."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from mimicbench.core import rotations as rot
from mimicbench.envs.clip_starts import ClipStarts
from mimicbench.envs.reference import ReferenceBank
from mimicbench.envs.settings import ClipStartConfig
from mimicbench.envs.vec_env import EnvConfig
from mimicbench.sim.rows import Rows
from mimicbench.track.failures import PARTS, REWIND, Failures
from mimicbench.track.settings import EndConfig, TrackingConfig
from mimicbench.track.tracking import ENDS, TrackingEnv, deviations
from stool import H1
from tracked import (
    CALM,
    CLIPS,
    HST,
    LIFT_BOX,
    ONE_THREAD,
    OURS,
    PHC,
    RESIDUAL,
    clip_set,
    context_of,
    lifted,
    swing,
)


def test_when_an_episode_ends():
    bank = ReferenceBank([CLIPS[0]], H1)
    ends = EndConfig(max_pos_error=0.5, max_angle_error=1.0, max_drop=0.25, max_object_error=0.15)
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


def test_a_training_is_by_default_as_documented():
    """Ends at 0.4 m, 0.7 rad, 0.2 m lower, a box 0.3 m off; the last pose held for 2 s; pushed by 0.4 m/s every 2 s."""
    bank, carried = ReferenceBank([CLIPS[0]], H1), ReferenceBank([lifted()], H1)
    state, obj = context_of(bank, 0).state, context_of(carried, 0).object
    for off, ended in ((-0.01, False), (0.01, True)):
        turn = torch.tensor(rot.from_yaw(np.array([0.7 + off])), dtype=torch.float32)
        found = [
            deviations(context_of(bank, 0, replace(state, **changed)), EndConfig())[end]
            for end, changed in (
                (0, {"root_pos_w": state.root_pos_w + torch.tensor([0.4 + off, 0, 0])}),
                (1, {"root_quat_w": turn}),
                (2, {"root_pos_w": state.root_pos_w - torch.tensor([0, 0, 0.2 + off])}),
            )
        ]
        away = replace(obj, pos_w=obj.pos_w + torch.tensor([0, 0.3 + off, 0]))
        found.append(deviations(context_of(carried, 0, task=LIFT_BOX, obj=away), EndConfig())[4])
        assert [bool(flag) for flag in found] == [ended] * 4
    usual = TrackingConfig()
    assert (usual.focus, usual.hold, usual.push, usual.push_interval) == (0.5, 2.0, 0.4, 2.0)
    assert (usual.assist, usual.assist_steps) == (0.0, 5000)


def test_targets_are_the_next_frame_of_the_clip():
    env = TrackingEnv(RESIDUAL, clip_set(swing()), 1, CALM, 0, ONE_THREAD)
    now, following = (env.context.reference(ahead).joint_pos.clone() for ahead in (0, 1))
    env.step(torch.zeros(1, 19), OURS)
    torch.testing.assert_close(env.env.last_target, following)
    assert not torch.allclose(now, following) and not torch.allclose(env.context.reference(1).joint_pos, following)


def test_a_failure_is_counted_where_in_its_clip_it_happens():
    """Robot 0 is thrown a quarter into its clip, in part 8 of 32; robot 1 goes on in part 24."""
    env = TrackingEnv(RESIDUAL, clip_set(CLIPS[1]), 2, CALM, 0, ONE_THREAD)
    last = int(env.bank.lengths[0]) - 1
    env.env.index[:] = torch.tensor([round(0.26 * last), round(0.76 * last)]) - 1
    env.env.physics.push(torch.tensor([[40.0, 0, 0], [0, 0, 0]]))
    env.step(torch.zeros(2, 19), OURS)
    seen, failed = env.failures.steps - 99.9, env.failures.failed - 0.999
    assert seen.round().nonzero()[:, 0].tolist() == [8, 24] and failed.round().nonzero()[:, 0].tolist() == [8]


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


def test_who_fulfils_k_may_have_more():
    """Half a point a control step for who sits, during the clip and after it; nothing for who stands."""

    def rewards(clip, fulfilled):
        env = TrackingEnv(RESIDUAL, clip_set(clip), 2, replace(CALM, hold=0.2, fulfilled=fulfilled), 0, ONE_THREAD)
        env.env.index[:] = env.bank.lengths[env.env.clip] - 4
        return torch.stack([env.step(torch.zeros(2, 19), OURS)[1] for _ in range(6)])

    sits, stands = CLIPS[1], CLIPS[0]
    torch.testing.assert_close(rewards(sits, 0.5) - rewards(sits, 0.0), torch.full((6, 2), 0.5))
    torch.testing.assert_close(rewards(stands, 0.5), rewards(stands, 0.0))


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
