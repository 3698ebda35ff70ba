"""Clips in the mirror: twice is once, every link is where the mirror shows it, and K is what K was."""

from dataclasses import replace

import numpy as np
import pytest

from learning import clip_of
from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion
from mimicbench.envs.clips import ClipSet
from mimicbench.envs.mirrored import mirrored, with_mirror_images
from mimicbench.references.augment import mirrored_object
from mimicbench.robots.mirror import SPECULAR, SPECULAR_QUAT, mirrored_joints, other_side
from mimicbench.robots.registry import ROBOTS
from mimicbench.tasks.registry import TASKS
from mimicbench.track.train import train_tracker
from stool import H1
from tracked import CLIPS, ONE_THREAD, clip_set, tiny


@pytest.mark.parametrize("robot", ROBOTS.all(), ids=ROBOTS.names())
def test_every_link_is_where_the_mirror_shows_it(robot):
    random = np.random.default_rng(0)
    low, high = robot.joint_range.T
    angles, pos = random.uniform(low, high, (20, len(low))), random.normal(size=(20, 3))
    quat = rot.normalize(random.normal(size=(20, 4)))
    other, sign = mirrored_joints(robot)
    seen = angles[:, other] * sign
    assert (seen >= low - 1e-3).all() and (seen <= high + 1e-3).all()
    assert robot.joint_names[other[robot.joint_names.index("left_knee_joint")]] == "right_knee_joint"
    there = robot.forward_kinematics(pos, quat, angles)
    image = robot.forward_kinematics(pos * SPECULAR, quat * SPECULAR_QUAT, seen)
    links = [robot.link_names.index(other_side(name)) for name in robot.link_names]
    np.testing.assert_allclose(image[0], there[0][:, links] * SPECULAR, atol=2e-3)
    np.testing.assert_allclose(rot.angle_between(image[1], there[1][:, links] * SPECULAR_QUAT), 0.0, atol=2e-3)


def test_who_is_not_the_same_on_both_sides_has_no_mirror_image():
    longer = replace(H1.links[5], pos=(0.0, 0.0, -0.45))
    with pytest.raises(BadMotion, match="not the same on both sides"):
        mirrored_joints(replace(H1, links=(*H1.links[:5], longer, *H1.links[6:])))
    with pytest.raises(BadMotion, match="no other side"):
        mirrored_joints(replace(H1, joints=(replace(H1.joints[0], name="left_tail"), *H1.joints[1:])))
    clips = clip_set(CLIPS[1])
    one_sided = replace(
        clips.motions[0], contact_names=("left_hand",), contacts=np.zeros((clips.motions[0].frames, 1), bool)
    )
    with pytest.raises(BadMotion, match="has no labels of right_hand"):
        mirrored(one_sided, clips.robot, clips.scenes[0])


@pytest.mark.parametrize("name", ["sit-chair", "lie-bed", "touch-points", "lift-box"])
def test_a_mirror_image_fulfills_what_its_clip_does(name):
    task, clips = TASKS.get(name), clip_of(TASKS.get(name))
    motion, obj = clips.motions[0], clips.scenes[0]
    other = mirrored_object(obj)
    image = mirrored(motion, clips.robot, other)
    again = mirrored(image, clips.robot, mirrored_object(other))
    for part in ("root_pos_w", "root_quat_w", "joint_pos", "contacts", "object_pos_w", "object_quat_w", "wrist_goal_w"):
        np.testing.assert_array_equal(getattr(again, part), getattr(motion, part), err_msg=part)
    same = ("id", "object_id", "reference_id", "contact_names", "style", "fps")
    assert all(getattr(again, part) == getattr(motion, part) for part in same)
    assert (image.id, image.object_id, other.split) == (f"{motion.id}~mirror", other.id, obj.split)
    ours, theirs = (task.held(m, o, clips.robot) for m, o in ((motion, obj), (image, other)))
    np.testing.assert_array_equal(ours, theirs)
    assert task.fulfilled(image, other, clips.robot) == task.fulfilled(motion, obj, clips.robot)
    broken = replace(motion, root_pos_w=motion.root_pos_w + [0.0, 0.9, 0.6])
    assert not task.fulfilled(mirrored(broken, clips.robot, other), other, clips.robot)


def test_a_set_gets_the_images_that_it_lacks():
    clips = clip_set(*CLIPS)
    joined = with_mirror_images(clips)
    assert [motion.id for motion in joined.motions] == ["stands", "sits", "stands~mirror", "sits~mirror"]
    assert with_mirror_images(joined).motions == joined.motions
    part = ClipSet(joined.task, joined.robot, joined.motions[1:], joined.objects)
    assert [motion.id for motion in with_mirror_images(part).motions[3:]] == ["stands"]


def test_trackers_learn_from_mirror_images(tmp_path):
    rows = []
    config = replace(tiny(2), mirrored=True, evaluate_clips=8)
    clips = clip_set(CLIPS[1])
    train_tracker(tmp_path, [clips], [], config, 0, ONE_THREAD, rows.append)
    assert rows[-1]["k_train"] == 1.0, "who is placed seated stays so, in the mirror as well"
    plain = train_tracker(tmp_path / "plain", [with_mirror_images(clips)], [], tiny(2), 0, ONE_THREAD)
    assert (
        plain.joinpath("model.safetensors").read_bytes() == (tmp_path / "checkpoint" / "model.safetensors").read_bytes()
    ), "as from a set that has them"
