"""DAgger: who learns is shown what the tracker would have done where it got to itself."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
import torch

from learning import shape_of
from mimicbench.core.errors import MimicbenchError
from mimicbench.core.run import RunContext
from mimicbench.imitate.cloning import clone
from mimicbench.imitate.demos import observed_states
from mimicbench.imitate.learned import load_learner
from mimicbench.imitate.learners.bc import BCConfig, BCImitation
from mimicbench.imitate.lerobot import load_demos
from mimicbench.imitate.settings.cloning import DaggerConfig, TrainConfig
from mimicbench.imitate.settings.inputs import InputConfig
from mimicbench.imitate.spec import Given
from mimicbench.imitate.stored.demo_writer import Demonstration, DemoWriter
from mimicbench.policies.loading import load_policy
from mimicbench.sim.timing import CONTROL_DT
from mimicbench.track.checkpoint import build_tracker
from mimicbench.track.driven import drive_clips
from mimicbench.track.experts import ClipExpert, SensingExpert
from mimicbench.track.registry import TRACKERS
from mimicbench.track.settings import DrivenConfig, EndConfig
from stool import H1
from tracked import CLIPS, ONE_THREAD, SIT_CHAIR, clip_set

SITS = [replace(CLIPS[1], id=name) for name in ("a", "b", "c")]
WIDE = EndConfig(max_pos_error=5.0, max_angle_error=7.0, max_drop=5.0)
SHAPE = shape_of("residual", SIT_CHAIR)


def expert():
    torch.manual_seed(0)
    weights = SHAPE.blueprint().network(19).tensors()
    tracker = build_tracker(SHAPE, {name: 0 * value for name, value in weights.items()})
    return ClipExpert(tracker, H1)  # the reference is its target


class Wriggles:
    """Wants every joint a tenth of a radian from where it is."""

    observations, gains = ("proprio",), "improved"

    def to(self, device):
        pass

    def reset(self, ids, obs):
        self.asked = len(ids)

    def act(self, obs):
        return obs["proprio"][:, 10:29] + 0.1


class Rests(Wriggles):
    """Wants every joint where it is."""

    def act(self, obs):
        return obs["proprio"][:, 10:29]


def test_the_policy_drives_from_some_moment_on_and_the_tracker_says_what_was_right():
    policy = Wriggles()
    kept = drive_clips(expert(), policy, clip_set(*SITS), DrivenConfig(WIDE, settle=0.4), 3, ONE_THREAD)
    assert policy.asked == 3 and len({len(qpos) for qpos in kept.qpos} | {60}) == 1, "clip and settling are 60 frames"
    begins = []
    for motion, qpos, wanted, driven in zip(SITS, kept.qpos, kept.targets, kept.applied, strict=True):
        own = np.abs(driven - wanted).max(-1) > 1e-3
        begins.append(int(own.argmax()))
        assert own[begins[-1] :].all() and not own[: begins[-1]].any()
        np.testing.assert_allclose(driven[own], qpos[own, 7:] + 0.1, atol=1e-5)
        np.testing.assert_allclose(wanted, np.tile(motion.joint_pos[0], (60, 1)), atol=1e-5)
    assert len(set(begins)) == 3 and max(begins) < 40, "drawn for each, from all of its clip"


def test_an_episode_is_over_where_the_tracker_no_longer_knows_what_to_do():
    narrow = DrivenConfig(EndConfig(max_pos_error=0.005, max_drop=0.005), settle=0.4)
    ends = [len(q) for q in drive_clips(expert(), Wriggles(), clip_set(*SITS), narrow, 3, ONE_THREAD).qpos]
    assert max(ends) < 60


class Remembers(Wriggles):
    """Wriggles, and keeps what was done."""

    def __init__(self):
        self.done = []

    def drove(self, target):
        self.done.append(target.clone())

    def __deepcopy__(self, _):
        return self  # looked at from outside


LIMIT = round(SIT_CHAIR.time_limit / CONTROL_DT)


def test_a_policy_says_what_was_right_where_another_drives():
    asked, narrow = Remembers(), DrivenConfig(EndConfig(max_pos_error=0.0, max_drop=0.0), settle=0.4)
    by = SensingExpert(asked)
    by.late = 0.0
    kept = drive_clips(by, Rests(), clip_set(*SITS), narrow, 3, ONE_THREAD)
    assert asked.asked == 3
    for episode, (qpos, wanted, driven) in enumerate(zip(kept.qpos, kept.targets, kept.applied, strict=True)):
        assert len(qpos) > 30, "no clip to stray from: who falls is lost"
        np.testing.assert_allclose(wanted, qpos[:, 7:] + 0.1, atol=1e-5)
        own = np.abs(driven - wanted).max(-1) > 0.05
        np.testing.assert_allclose(driven, qpos[:, 7:] + np.where(own, 0.0, 0.1)[:, None], atol=1e-5)
        assert own[own.argmax() :].all()
        told = np.stack([target[episode] for target in asked.done[: len(driven)]])
        np.testing.assert_array_equal(told, driven, "it is told what was done")
    fallen = [len(qpos) for qpos in kept.qpos if len(qpos) < LIMIT]
    by.late = 0.2
    again = drive_clips(by, Rests(), clip_set(*SITS), narrow, 3, ONE_THREAD)
    late = [len(qpos) for qpos in again.qpos if len(qpos) < LIMIT]
    assert fallen and all(short in (0, long - 10) for short, long in zip(late, fallen, strict=True))


class Holds(Wriggles):
    """Stays as it sits."""

    def act(self, obs):
        return torch.tensor(SITS[0].joint_pos[0]).float().expand(len(obs["proprio"]), -1)


def test_beside_who_follows_no_clip_it_goes_on_to_the_time_limit():
    kept = drive_clips(SensingExpert(Holds()), Holds(), clip_set(*SITS), DrivenConfig(settle=0.4), 3, ONE_THREAD)
    assert [len(qpos) for qpos in kept.qpos] == [LIMIT] * 3, "the clips are 40 frames"


@pytest.mark.parametrize("name", list(TRACKERS))
def test_what_somebody_else_did_in_a_trackers_own_words(name):
    spec, random = TRACKERS.get(name), torch.Generator().manual_seed(0)
    settings = spec.settings()
    if hasattr(settings, "smoothing"):
        settings = replace(settings, smoothing=0.4)
    low, high = torch.tensor(H1.joint_range).float().T
    following, target = (low + (high - low) * torch.rand(5, 19, generator=random) for _ in range(2))
    last = torch.randn(5, 19, generator=random)
    action = spec.aimed(H1, following, target, last, settings)
    torch.testing.assert_close(spec.aim(H1, following, action, last, settings), target, atol=1e-5, rtol=0)
    with pytest.raises(MimicbenchError, match="does not say which action joint targets come from"):
        replace(spec, action=None).aimed(H1, following, target, last, settings)


def test_who_takes_over_goes_on_from_what_the_expert_did():
    taking_over = Remembers()
    kept = drive_clips(expert(), taking_over, clip_set(*SITS), DrivenConfig(WIDE, settle=0.4), 3, ONE_THREAD)
    told = torch.stack(taking_over.done).numpy()
    for episode, driven in enumerate(kept.applied):
        np.testing.assert_array_equal(told[: len(driven), episode], driven)


class Counts(Wriggles):
    """Wriggles more with every batch of episodes that it has begun."""

    begun = 0

    def reset(self, ids, obs):
        super().reset(ids, obs)
        self.begun += 1

    def act(self, obs):
        return super().act(obs) * self.begun


def test_a_policy_that_demonstrates_does_not_know_how_many_batches_there_were():
    """Who goes on after a kill has not seen those before, and comes to the same demonstrations."""
    by, clips = SensingExpert(Counts()), clip_set(*SITS)
    first, second = (drive_clips(by, Rests(), clips, None, 3, ONE_THREAD) for _ in range(2))
    for one, other in zip(first.targets, second.targets, strict=True):
        np.testing.assert_array_equal(one, other)


def given(tmp_path, clips):
    """Demonstrations of robots that sit, and the tracker that made them."""
    dataset = tmp_path / "dataset"
    writer = DemoWriter(dataset, "h1", SIT_CHAIR.title, H1.joint_names, gains="improved")
    qpos = np.tile(np.r_[clips.motions[0].root_pos_w[0], 1, 0, 0, 0, clips.motions[0].joint_pos[0]], (30, 1))
    qvel, target = np.zeros((30, 25)), np.tile(clips.motions[0].joint_pos[0], (30, 1)).astype(np.float32)
    state = observed_states(H1, qpos, qvel, target)
    for motion in clips.motions:
        writer.add(Demonstration(state, target, target, qpos, qvel, motion.object_id, motion.id, True))
    writer.finish()
    context = RunContext(workers=1, quiet=True)
    return Given(clips, dataset, 0, "improved", context, load_policy, expert())


def test_a_cloner_learns_from_what_it_got_into(tmp_path):
    blind = InputConfig(body="proprio", clock=True, elevation=False)
    config = BCImitation(
        network=BCConfig(inputs=blind, hidden=8),
        train=TrainConfig(steps=3, batch=8),
        dagger=DaggerConfig(rounds=2, clips=2, batch=1, driven=DrivenConfig(WIDE, settle=0.0)),
    )
    clips = clip_set(*SITS)
    told = clone(tmp_path / "policy", given(tmp_path, clips), config)
    rounds = [load_demos(tmp_path / "rounds" / str(n) / "dataset", "h1", only_success=False) for n in range(2)]
    assert told["demonstrations"] == 3 + sum(demos.episodes for demos in rounds) > 3 and told["batches"] == 9
    assert len({demos.reference_ids for demos in rounds}) == 2 or rounds[0].frames != rounds[1].frames
    assert not rounds[0].success.any()
    learned, _ = load_learner(tmp_path / "policy", H1, BCConfig)
    # another one learns from the same frames in one training, and then has a round of its own
    joined = replace(config, dagger=replace(config.dagger, rounds=1, rounds_of=(str(tmp_path / "policy"),)))
    heir = clone(tmp_path / "heir" / "policy", given(tmp_path / "heir", clips), joined)
    own = load_demos(tmp_path / "heir" / "rounds" / "0" / "dataset", "h1", only_success=False)
    assert heir["demonstrations"] == told["demonstrations"] + own.episodes and heir["batches"] == 6
    # taken up in its second round it comes to the same
    again = tmp_path / "again"
    shutil.copytree(tmp_path / "rounds" / "0", again / "rounds" / "0")
    clone(again / "policy", given(again, clips), config)
    other, _ = load_learner(again / "policy", H1, BCConfig)
    for name, value in learned.state_dict().items():
        assert torch.equal(value, other.state_dict()[name]), name
