"""Which clips a tracker learns from, and which only judge it."""

from dataclasses import replace

import numpy as np
import pytest

from mimicbench.core import rotations as rot
from mimicbench.core.errors import MimicbenchError
from mimicbench.core.motion import RobotMotion
from mimicbench.envs.clips import ClipSet, learned_and_judged
from mimicbench.objects.registry import FAMILIES, make_object
from mimicbench.objects.shape import split_of
from mimicbench.references.synthesis.registry import synthesize
from mimicbench.retarget.clip import Clip
from mimicbench.retarget.registry import METHODS
from mimicbench.robots.registry import ROBOTS
from mimicbench.tasks.registry import TASKS
from mimicbench.tasks.task import PAUSE, REST, STILL

ROBOT = ROBOTS.get("h1")


def clips(task, family, named, kind):
    """A clip of a robot that stands beside each of eight objects, called so; enough for both splits."""
    ids = [kind.format(index) for index in range(8)]
    assert {split_of(object_id) for object_id in ids} == {"train", "test"}
    pose = np.array([[0, 0, 1.0]] * 2), np.array([[1.0, 0, 0, 0]] * 2), np.tile(ROBOT.rest_pose, (2, 1))
    motions = [
        RobotMotion(f"{named}-{i}", task, "h1", ROBOT.joint_names, 50, *pose, object_id, f"{named}-{i}")
        for i, object_id in enumerate(ids)
    ]
    objects = {object_id: replace(make_object(f"{family}-0-00000"), id=object_id) for object_id in ids}
    return ClipSet(TASKS.get(task), ROBOT, motions, objects)


def test_recordings_are_learned_from_whole_and_judge_nothing():
    chairs, sofas = clips("sit-chair", "chair", "made", "chair-{}"), clips("sit-sofa", "sofa", "made", "sofa-{}")
    people = clips("sit-chair", "chair", "person", "fitted-{}-0")
    learned, judged = learned_and_judged({"sit-chair": chairs, "sit-sofa": sofas, "sit-chair/people": people})
    assert [some.task.name for some in learned] == [some.task.name for some in judged] == ["sit-chair", "sit-sofa"]
    names = [{motion.id for motion in some.motions} for some in (*learned, *judged)]
    everyone = {motion.id for motion in people.motions}
    assert everyone < names[0], "whatever split their objects are in"
    assert not everyone & names[2] and not everyone & names[3]
    variants = [replace(motion, id=f"{motion.id}~start") for motion in chairs.motions]
    (more, _), (apart, _) = learned_and_judged(
        {"sit-chair": chairs, "sit-sofa": sofas, "sit-chair/augmented": replace(chairs, motions=variants)}
    )
    assert {motion.object_id for motion in more.motions}.isdisjoint(motion.object_id for motion in apart.motions)
    assert len(more) == 2 * len(chairs.split("train")), "variants of what judges teach nothing"
    for made, first, last in ((chairs, names[0] - everyone, names[2]), (sofas, names[1], names[3])):
        assert first == {motion.id for motion in made.split("train").motions}
        assert last == {motion.id for motion in made.split("test").motions}


def test_all_of_a_recording_is_in_one_split():
    """However many clips are cut of it: who learned from one has seen the person of all."""
    for name in "abcdefgh":
        assert len({split_of(f"fitted-{name}-walk-{number}{of}") for number in range(9) for of in ("", "~x1.05")}) == 1
    assert {split_of(f"fitted-walk{number}-0") for number in range(20)} == {"train", "test"}
    assert {split_of(f"chair-0-0000{index}") for index in range(9)} == {"train", "test"}, "made ones are each their own"
    chairs = clips("sit-chair", "chair", "made", "fitted-{}-0")
    variants = [replace(motion, id=f"{motion.id}~start") for motion in chairs.motions]
    learned, judged = learned_and_judged({"sit-chair": chairs, "sit-chair/more": replace(chairs, motions=variants)})
    assert not {motion.object_id for motion in learned[0].motions} & {motion.object_id for motion in judged[0].motions}


def test_two_objects_of_one_name_are_refused():
    made = clips("sit-chair", "chair", "made", "chair-{}")
    others = {name: replace(make_object("chair-0-00001"), id=name) for name in made.objects}
    with pytest.raises(MimicbenchError, match="two objects are called 'chair-0'"):
        made.joined(replace(made, objects=others))


def test_some_clips_are_from_all_over_the_set():
    made = clips("sit-chair", "chair", "made", "chair-{}")
    assert [motion.id for motion in made.spread(5).motions] == [f"made-{i}" for i in (0, 1, 3, 4, 6)]
    assert made.spread(20).motions == made.motions


@pytest.mark.parametrize("task", [task for task in TASKS.all() if not task.in_last_frame], ids=lambda task: task.name)
def test_what_robots_hold_after_a_clip_is_how_people_rest(task):
    """Robots hold the pose of the moment at which clips are cut: by then trunks must have come down, or up, to where
    they are in the end. On beds they have 2 to 9 degrees to go after 1.5 s, and hands are in the air; what waits for
    them waits until they lie.
    """
    for index in range(3):
        obj = FAMILIES.get(task.family).make(index, 0)
        clip = Clip(synthesize(task.name, index, obj, 0), obj, ROBOT)
        whole = METHODS.get("interaction").retarget(clip, "improved")
        cut = task.trimmed(whole, obj, ROBOT)
        assert task.fulfilled(cut, obj, ROBOT)
        tilt = [np.arccos(rot.to_matrix(motion.root_quat_w[-1])[2, 2]) for motion in (cut, whole)]
        left = tilt[1] - tilt[0]
        # who lies may prop up a little later, to look around
        assert (abs(left) if task.upright else left) < np.radians(5.0)
        if task.rest > REST:
            last = cut.joint_pos[-1 - round(PAUSE * cut.fps) :]
            assert np.abs(last - last[-1]).max() < STILL + 1e-9
