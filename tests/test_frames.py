"""Any tracker may see frames before the present one, and begin from one that did not."""

from dataclasses import replace

import numpy as np
import torch

from mimicbench.track.checkpoint import load_tracker
from mimicbench.track.history import Follower
from mimicbench.track.registry import TRACKERS
from mimicbench.track.rollout import RolloutConfig, track_clips
from mimicbench.track.tracker import Layout
from mimicbench.track.train import train_tracker
from stool import H1
from tracked import CLIPS, ONE_THREAD, SIT_CHAIR, clip_set, tiny


def test_where_terms_are_in_the_frames_of_another_layout():
    old, new = Layout(("a", "b"), (2, 3)), Layout(("a", "c", "b"), (2, 1, 3), frames=2)
    assert new.columns_of(old) == [(slice(0, 2), slice(6, 8)), (slice(2, 5), slice(9, 12))]
    assert old.columns_of(new) == [(slice(6, 8), slice(0, 2)), (slice(9, 12), slice(2, 5))]
    assert len(new.columns_of(new)) == 6, "all terms of both frames"


def test_our_tracker_sees_frames_when_it_is_asked_to(tmp_path):
    clips = [clip_set(CLIPS[1])]
    plain = train_tracker(tmp_path / "plain", clips, [], tiny(1), 0, ONE_THREAD)
    config = replace(tiny(2), frames=3, begin_from=str(plain), ppo=replace(tiny(1).ppo, learning_rate=0.0))
    rows = []
    made = train_tracker(tmp_path / "frames", clips, [], config, 0, ONE_THREAD, rows.append)
    tracker, before = load_tracker(made, H1), load_tracker(plain, H1)
    spec = TRACKERS.get("residual")
    assert tracker.layout == Layout.of(spec, H1, [SIT_CHAIR], 3) and before.layout.frames == 1
    assert tracker.network.tensors()["layers.0.weight"].shape == (16, 3 * 167)
    terms = {name: torch.randn(2, width) for name, width in zip(before.layout.names, before.layout.widths, strict=True)}
    told, once = Follower(tracker, 2), Follower(before, 2)
    np.testing.assert_allclose(told.action(terms).detach(), once.action(terms).detach(), atol=1e-4)
    verdict = track_clips(tracker, clips[0], RolloutConfig(leave_fallen=True), ONE_THREAD).verdict
    assert rows[-1]["k_train"] == float(verdict.success) == 1.0
