"""Frames of a recording in which tracking was lost."""

from pathlib import Path

import numpy as np
import pytest

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion
from mimicbench.references.importers.lost import mend_lost_frames

FPS, FRAMES = 30.0, 200
HERE = Path("take.npy")


def walking():
    """Pelvis and rotations of somebody who goes evenly, and turns evenly."""
    time = np.arange(FRAMES) / FPS
    root = np.stack([0.9 * time, 0.1 * time, np.ones(FRAMES)], 1)
    return root, np.stack([rot.from_yaw(0.3 * time), rot.from_yaw(-0.2 * time)], 1)


def test_who_is_elsewhere_for_a_moment_is_where_the_way_leads():
    whole, turning = walking()
    root, quat = whole.copy(), turning.copy()
    root[60:63] += [50.0, 0.0, -3.0]
    quat[60:63] = rot.IDENTITY
    root[120] = 0.0
    found, turns, said = mend_lost_frames(HERE, FPS, root, quat)
    np.testing.assert_allclose(found, whole, atol=1e-9)
    assert rot.angle_between(turns[60:63], turning[60:63]).max() < 1e-6 and (turns[:60] == quat[:60]).all()
    assert said == ("tracking was lost in 4 frames (from frame 60), which were interpolated",)
    assert (root[61, 0] > 50).all(), "what was given is as it was"


def test_what_was_never_lost_is_what_was_given():
    root, quat = walking()
    assert mend_lost_frames(HERE, FPS, root, quat) == (root, quat, ())


@pytest.mark.parametrize("frames", [slice(60, None), slice(0, 60), slice(60, 80), slice(-1, None)])
def test_who_does_not_come_back_soon_is_of_another_take(frames):
    root, quat = walking()
    root[frames] += [0.0, 20.0, 0.0]
    with pytest.raises(BadMotion, match=r"take\.npy: the person jumps by 20 m at frame (60|199); cut the file there"):
        mend_lost_frames(HERE, FPS, root, quat)
