"""What bears in a recording, told by places alone: backs that lie, that lean against something, and that do neither."""

from pathlib import Path

import numpy as np
import pytest

from mimicbench.core import rotations as rot
from mimicbench.core.motion import HumanMotion
from mimicbench.objects.shape import SceneObject
from mimicbench.references.body.body import unihsi_body
from mimicbench.references.checks.contacts import BEARING_NAMES, detect_bearing
from mimicbench.references.importers.unihsi import import_skeleton_motion
from mimicbench.references.recordings.real_clips import lying_clips
from mimicbench.retarget.acceptance import unsolved
from mimicbench.retarget.clip import Clip
from mimicbench.retarget.registry import METHODS
from mimicbench.robots.registry import ROBOTS

CLIPS = Path(__file__).parents[1].parent / "shared" / "data" / "unihsi" / "motion_clips"
HEIGHT = 0.4
"""Of the bed and of the seat [m]."""


def boxes(*given: tuple[tuple[float, float, float], tuple[float, float, float]]) -> SceneObject:
    """An object of boxes, each from its lowest corner to its highest [m]."""
    low, high = (np.array(corners) for corners in zip(*given, strict=True))
    turns, colors = np.tile(rot.IDENTITY, (len(low), 1)), np.full(low.shape, 0.5)
    square = np.array([[-0.2, -0.2], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2]])
    return SceneObject("o", "bed", "platform", (low + high) / 2, turns, (high - low) / 2, colors, HEIGHT, square)


BED = boxes(((-1.2, -0.7, 0.0), (1.0, 0.7, HEIGHT)))
LOW_BACK = boxes(((-0.19, -0.3, 0.0), (0.3, 0.3, HEIGHT)), ((-0.25, -0.3, HEIGHT), (-0.19, 0.3, HEIGHT + 0.34)))


@pytest.mark.parametrize(
    ("obj", "pelvis", "chest", "back"),
    [
        (BED, -90.0, 5.0, True),  # flat
        (BED, -90.0, 55.0, False),  # propped up on the elbows: the loins touch, 9 cm of air are under the shoulders
        (LOW_BACK, -20.0, 30.0, True),  # who sits and slumps leans against a low back with the loins alone
        (LOW_BACK, 10.0, 0.0, False),  # and who bends forward does not lean
    ],
)
def test_a_back_lies_with_its_upper_end_and_leans_with_any(obj, pelvis, chest, back):
    body, frames = unihsi_body(), 12
    quat = np.tile(rot.IDENTITY, (frames, len(body.skeleton.joint_names), 1))
    for joint, angle in ((body.pelvis, pelvis), (body.chest, chest)):
        quat[:, joint] = rot.from_rotvec(np.radians(angle) * np.array([0.0, 1.0, 0.0]))
    root = np.tile([0.0, 0.0, HEIGHT + body.buttock], (frames, 1))
    motion = HumanMotion("m", "lie-bed", body.skeleton, 30.0, root, quat, obj.id)
    found = dict(zip(BEARING_NAMES, detect_bearing(motion, obj).T, strict=True))
    assert found["pelvis"].all() and found["back"].tolist() == [back] * frames


@pytest.mark.skipif(not CLIPS.is_dir(), reason="the recorded UniHSI clips are not here")
def test_a_robot_does_as_who_lies_down_by_way_of_the_elbows():
    [(motion, obj)] = lying_clips(import_skeleton_motion(CLIPS / "lie_down.npy"), "lie-bed")
    pelvis, back = (motion.contacts[:, motion.contact_names.index(name)].astype(bool) for name in ("pelvis", "back"))
    assert 1.0 < (np.argmax(back) - np.argmax(pelvis)) / motion.fps < 3.0, "sits, then is propped up, then lies"
    method = METHODS.get("interaction")
    result = method.retarget(Clip(motion, obj, ROBOTS.get("h1")), "improved")
    assert unsolved(result.measures, method.limits) == []
    assert 0.0 < result.root_pos_w[-10:, 2].mean() - obj.require_seat() < 0.25, "on the bed, and not in it"
