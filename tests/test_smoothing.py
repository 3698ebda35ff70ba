"""A tracker may carry out the mean of its last two actions: targets jump less, what it observes stays as it is."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from learning import ONE, ROBOT, clip_of, shape_of, tracker
from mimicbench.envs.reference import ReferenceBank
from mimicbench.tasks.registry import TASKS
from mimicbench.track.registry import TRACKERS
from mimicbench.track.rollout import RolloutConfig, track_clips

SPEC = TRACKERS.get("residual")
SCALE = torch.tensor(ROBOT.gains["improved"].action_scale)


@pytest.mark.parametrize(("share", "expected"), [(0.0, 1.0), (0.4, 0.4), (0.5, 0.25)])
def test_targets_are_the_mean_of_two_actions(share, expected):
    """1 now after -0.5 before: (1 - s) - 0.5 s of what an action of 1 means."""
    settings = replace(SPEC.settings(), smoothing=share)
    following, action = torch.full((1, 19), 0.3), torch.ones(1, 19)
    target = SPEC.aim(ROBOT, following, action, -0.5 * action, settings)
    torch.testing.assert_close(target, following + expected * SCALE, atol=1e-6, rtol=0)


def test_it_is_carried_out_wherever_trackers_run():
    """Recorded targets of a rollout are those of the actions, two by two."""
    task = TASKS.get("sit-chair")
    clips, plain = clip_of(task), tracker(shape_of("residual", task))
    smooth = replace(plain, settings=replace(plain.settings, smoothing=0.5))
    config = RolloutConfig(record=True, settle=0.0)
    first, second = (track_clips(one, clips, config, ONE).recording.targets[0] for one in (plain, smooth))
    # nothing was before the first action, so that it is halved
    following = (
        ReferenceBank(clips.motions, ROBOT).frame(torch.zeros(1, dtype=torch.long), torch.ones(1).long()).joint_pos
    )
    np.testing.assert_allclose(second[0] - following[0].numpy(), 0.5 * (first[0] - following[0].numpy()), atol=1e-5)
    assert abs(first[0] - following[0].numpy()).max() > 1e-3
    terms = {"proprio": torch.zeros(1, 48), "reference+1": torch.zeros(1, 50), "last_action": torch.full((1, 19), 2.0)}
    action = torch.ones(1, 19)
    torch.testing.assert_close(smooth.target(ROBOT, terms, action), 1.5 * plain.target(ROBOT, terms, action))
