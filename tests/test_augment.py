"""Variants of clips: what must be the same, what must be mirrored, and that feet and hands stay where they bear."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import making
from mimicbench import cli
from mimicbench.commands.options import recipes
from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion, MimicbenchError
from mimicbench.core.files import read_record, write_record
from mimicbench.core.motion import HumanMotion
from mimicbench.core.stage import HEADER, read_stage
from mimicbench.objects.make import read_objects
from mimicbench.objects.registry import FAMILIES
from mimicbench.objects.shape import SceneObject, split_of
from mimicbench.references.augment import (
    AugmentConfig,
    ClipSource,
    make_augmented,
    mirror,
    mirrored_joints,
    mirrored_object,
    resize,
    restart,
    retime,
    variant,
)
from mimicbench.references.body.body import body_of
from mimicbench.references.body.skeletons import SKELETONS
from mimicbench.references.checks.quality import check_clip, faults, gate
from mimicbench.references.synthesis.registry import synthesize
from mimicbench.references.warp import approach_end, contact, rescaled, turned_approach
from mimicbench.tasks.registry import TASKS

FLIP = np.array([1.0, -1.0, 1.0])
NAMES = tuple(TASKS)


def clip(task: str, index: int = 1) -> tuple[HumanMotion, SceneObject]:
    obj = FAMILIES.get(TASKS.get(task).family).make(index, 0)
    return synthesize(task, index, obj, 0), obj


@pytest.fixture(scope="module")
def clips() -> dict[str, tuple[HumanMotion, SceneObject]]:
    """One good clip per task."""
    found = {}
    for task in NAMES:
        found[task] = next(
            (m, o) for i in range(9) for m, o in [clip(task, i)] if not gate(m, o, TASKS.get(task).fulfilled_by_human)
        )
    return found


@pytest.mark.parametrize("name", list(SKELETONS))
@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_mirrored_clip_has_mirrored_positions(name: str, seed: int):
    skeleton, random = SKELETONS[name], np.random.default_rng(seed)
    joints = len(skeleton.joint_names)
    names = ("left_foot", "right_foot", "pelvis", "left_hand", "right_hand")
    motion = HumanMotion(
        "any",
        "sit-chair",
        skeleton,
        30.0,
        random.normal(size=(4, 3)),
        rot.normalize(random.normal(size=(4, joints, 4))),
        "chair-0-00001",
        names,
        random.uniform(size=(4, 5)) < 0.5,
        {"turn": 1.0, "speed": 0.6},
        object_pos_w=random.normal(size=(4, 3)),
        object_quat_w=rot.normalize(random.normal(size=(4, 4))),
        wrist_goal_w=random.normal(size=(2, 3)),
    )
    obj = FAMILIES.get("chair").make(1, 0)
    other, other_obj = mirror(motion, obj)
    pairs = mirrored_joints(skeleton)
    assert other.forward_kinematics()[0] == pytest.approx(motion.forward_kinematics()[0][:, pairs] * FLIP, abs=1e-9)
    assert (other.contacts[:, 0] == motion.contacts[:, 1]).all() and (
        other.contacts[:, 2] == motion.contacts[:, 2]
    ).all()
    assert other.wrist_goal_w[0] == pytest.approx(motion.wrist_goal_w[1] * FLIP) and other.style == {
        "turn": -1.0,
        "speed": 0.6,
    }
    # a place on the moving object is where its mirror image is
    place = np.array([0.2, 0.3, 0.4])
    there = motion.object_pos_w + rot.rotate(motion.object_quat_w, place)
    assert other.object_pos_w + rot.rotate(other.object_quat_w, place * FLIP) == pytest.approx(there * FLIP, abs=1e-9)
    again, again_obj = mirror(other, other_obj)
    assert again.id == motion.id and again.object_id == motion.object_id and again_obj.id == obj.id
    for name in ("root_pos_w", "local_quat", "contacts", "object_pos_w", "object_quat_w", "wrist_goal_w"):
        assert (getattr(again, name) == getattr(motion, name)).all(), name


@settings(max_examples=25, deadline=None)
@given(st.sampled_from(sorted(FAMILIES)), st.integers(0, 50), st.integers(0, 2**32 - 1))
def test_a_mirrored_object_has_mirrored_distances(family: str, index: int, seed: int):
    obj = FAMILIES.get(family).make(index, 0)
    other = mirrored_object(obj)
    points = np.random.default_rng(seed).normal(size=(50, 3))
    assert other.distance(points * FLIP) == pytest.approx(obj.distance(points), abs=1e-9)
    assert (
        other.split == obj.split
        and other.id == f"{obj.id}~mirror"
        and mirrored_object(other).to_dict() == obj.to_dict()
    )
    if len(obj.seat_polygon):  # counter-clockwise still
        (x, y), (x1, y1) = other.seat_polygon.T, np.roll(other.seat_polygon, -1, 0).T
        assert (x * y1 - x1 * y).sum() > 0


def test_variants_of_an_object_stay_in_its_split():
    assert all(split_of(f"chair-0-{i:05d}~x1.0500") == split_of(f"chair-0-{i:05d}") for i in range(40))


def test_who_has_one_longer_shin_has_the_other_in_the_mirror():
    motion = synthesize("sit-chair", 1, obj := FAMILIES.get("chair").make(1, 0), 0)
    offsets = motion.skeleton.offsets.copy()
    offsets[motion.skeleton.index("left_foot"), 2] -= 0.03
    lopsided = replace(motion, skeleton=replace(motion.skeleton, offsets=offsets))
    other, _ = mirror(lopsided, obj)
    pairs = mirrored_joints(lopsided.skeleton)
    there = lopsided.forward_kinematics()[0]
    assert other.forward_kinematics()[0] == pytest.approx(there[:, pairs] * FLIP, abs=1e-9)
    assert (mirror(other, obj)[0].skeleton.offsets == offsets).all()


def test_who_has_no_mirror_image_is_told_so():
    skeleton = SKELETONS["unihsi"]
    names = tuple(name.replace("left_", "lefty_") for name in skeleton.joint_names)
    with pytest.raises(BadMotion, match="no mirror image"):
        mirrored_joints(replace(skeleton, joint_names=names))
    motion = synthesize("sit-chair", 1, obj := FAMILIES.get("chair").make(1, 0), 0)
    one_sided = replace(motion, contact_names=("left_foot",), contacts=motion.contacts[:, :1])
    with pytest.raises(BadMotion, match="no labels of right_foot"):
        mirror(one_sided, obj)


@settings(max_examples=10, deadline=None)
@given(st.floats(0.7, 1.4))
def test_retiming_keeps_the_way_and_its_ends(factor: float):
    motion, _ = clip("sit-chair")
    other = retime(motion, factor)
    assert other.duration == pytest.approx(motion.duration / factor, abs=0.5 / motion.fps)
    assert other.root_pos_w[[0, -1]] == pytest.approx(motion.root_pos_w[[0, -1]], abs=1e-9)
    assert rot.angle_between(other.local_quat[-1], motion.local_quat[-1]).max() < 1e-7
    there = np.array(
        [
            np.interp(np.linspace(0, 1, other.frames), np.linspace(0, 1, motion.frames), axis)
            for axis in motion.root_pos_w.T
        ]
    ).T
    assert np.abs(other.root_pos_w - there).max() < 2e-3
    assert (other.contacts.mean(0) == pytest.approx(motion.contacts.mean(0), abs=0.02)) and other.style[
        "retimed"
    ] == factor


def test_the_same_speed_is_the_same_clip():
    motion, _ = clip("lift-box")
    other = retime(motion, 1.0)
    assert other.root_pos_w == pytest.approx(motion.root_pos_w, abs=1e-12) and other.object_pos_w == pytest.approx(
        motion.object_pos_w, abs=1e-12
    )
    assert rot.angle_between(other.local_quat, motion.local_quat).max() < 1e-7


@pytest.mark.parametrize("task", NAMES)
def test_no_change_changes_nothing(task: str, clips: dict[str, tuple[HumanMotion, SceneObject]]):
    motion, obj = clips[task]
    before = motion.forward_kinematics()[0]
    for other in (turned_approach(motion, approach_end(motion), 0.0, np.zeros(2)), rescaled(motion, obj, 1.0)):
        assert (
            np.abs(other.forward_kinematics()[0] - before).max() < 2e-3
        )  # a leg out of reach of its foot may be a hair shorter


@pytest.mark.parametrize("task", NAMES)
def test_another_start_leaves_the_action_alone(task: str, clips: dict[str, tuple[HumanMotion, SceneObject]]):
    motion, obj = clips[task]
    small = 0.25 if motion.duration > 6 else 0.12
    end, shift = approach_end(motion), np.array([0.05, -0.04])
    other = restart(motion, small, shift)
    pivot = motion.root_pos_w[end] * [1, 1, 0]
    start = pivot + rot.rotate(rot.from_yaw(np.array(small)), motion.root_pos_w[0] - pivot) + [*shift, 0]
    assert other.root_pos_w[0] == pytest.approx(start)
    turned = rot.wrap_angle(rot.yaw_of(other.local_quat[0, 0]) - rot.yaw_of(motion.local_quat[0, 0]))
    assert turned == pytest.approx(small, abs=1e-6)
    assert other.root_pos_w[end:] == pytest.approx(motion.root_pos_w[end:], abs=1e-12)
    walks = ~(contact(motion, "left_foot") & contact(motion, "right_foot"))
    action = np.flatnonzero(
        np.any([contact(motion, name) for name in motion.contact_names if "foot" not in name], axis=0)
    )[0]
    settled = int(np.flatnonzero(walks[:action])[-1]) + 1  # the other foot may still be on its way
    assert np.abs(other.forward_kinematics()[0][settled:] - motion.forward_kinematics()[0][settled:]).max() < 2e-3
    assert check_clip(other, obj)["skate"] < 0.01


@pytest.mark.parametrize("task", NAMES)
@pytest.mark.parametrize("factor", [0.96, 1.04])
def test_another_size_keeps_the_contacts(task: str, factor: float, clips: dict[str, tuple[HumanMotion, SceneObject]]):
    motion, obj = clips[task]
    other, other_obj = resize(motion, obj, factor)
    assert other.object_id == other_obj.id and other_obj.bounds()[1] == pytest.approx(factor * obj.bounds()[1])
    body = body_of(motion.skeleton)
    pos, moved = motion.forward_kinematics()[0], other.forward_kinematics()[0]
    origin = motion.object_pos_w if len(motion.object_pos_w) else np.zeros((motion.frames, 3))
    for side, hand in enumerate(("left_hand", "right_hand")):
        bears, wrist = contact(motion, hand), body.arms[side].end
        expected = origin + factor * (pos[:, wrist] - origin)
        assert np.abs(moved[bears, wrist] - expected[bears]).max(initial=0) < 0.01
    sits = contact(motion, "pelvis")
    if sits.any():
        rise = other.root_pos_w[sits, 2] - motion.root_pos_w[sits, 2]
        assert rise == pytest.approx(np.full(sits.sum(), (factor - 1) * obj.require_seat()), abs=1e-9)
    assert check_clip(other, other_obj)["skate"] < 0.01 and TASKS.get(task).fulfilled_by_human(other, other_obj)


def test_variants_depend_on_the_id_alone(clips: dict[str, tuple[HumanMotion, SceneObject]]):
    motion, obj = clips["sit-sofa"]
    for kind in AugmentConfig().kinds:
        first, again = (variant(motion, obj, kind, AugmentConfig(), 3)[0] for _ in range(2))
        assert first.id == again.id and first.local_quat.tobytes() == again.local_quat.tobytes()
    other = variant(replace(motion, id="sit-sofa-0-00099"), obj, "speed", AugmentConfig(), 3)[0]
    assert other.frames != variant(motion, obj, "speed", AugmentConfig(), 3)[0].frames


def test_who_does_not_walk_has_no_other_start():
    motion, _ = clip("sit-chair")
    seated = replace(motion, **{name: getattr(motion, name)[-30:] for name in ("root_pos_w", "local_quat", "contacts")})
    with pytest.raises(BadMotion, match="nobody walks"):
        restart(seated, 0.1, np.zeros(2))


def test_a_stage_of_variants(tmp_path):
    task = TASKS.get("sit-chair")
    references = making.make("references", tmp_path)
    source = ClipSource(making.make("objects", tmp_path), references, sorted(references.folder.glob("*.npz")))
    folders = tmp_path / "sit-chair" / "objects" / "more", tmp_path / "sit-chair" / "references" / "more"
    config = AugmentConfig(("mirror", "size"))
    arguments = tmp_path, "more", source, config, task.fulfilled_by_human, making.QUIET
    stage = make_augmented(*arguments)
    summary = stage.header["summary"]
    paths = sorted(folders[1].glob("*.npz"))
    assert (
        summary["originals"] == 4
        and summary["clips"] == len(paths) == 4 + summary["mirror"] + summary["size"]
        and summary["mirror"] == 4
    )
    found = read_objects(folders[0])
    for path in paths:
        motion = HumanMotion.load(path)
        assert path.stem == motion.id and gate(motion, found[motion.object_id], task.fulfilled_by_human) == []
    assert read_stage(folders[0]).complete
    again = make_augmented(*arguments)
    assert again.header["summary"] == summary
    # killed before its last clip, it makes that one, and no other
    for folder in folders:
        write_record(folder / HEADER, {**read_record(folder / HEADER), "complete": False, "summary": {}})
    last = sorted(path for path in paths if path.stem.startswith(source.clips[-1].stem))
    content, stamps = [path.read_bytes() for path in last], {path: path.stat().st_mtime_ns for path in paths}
    last[0].unlink()
    assert last[0].name == source.clips[-1].name and make_augmented(*arguments).header["summary"] == summary
    assert [path.read_bytes() for path in last] == content
    assert {path for path in paths if path.stat().st_mtime_ns != stamps[path]} == {last[0]}
    # variants and objects that are gone from a finished set are made again as they were
    objects = sorted(path for path in folders[0].glob("*.json") if path.name != HEADER)
    for gone in (last[1:], objects[-1:], [*last, *objects[:1]]):
        before = [path.read_bytes() for path in gone]
        for path in gone:
            path.unlink()
        assert make_augmented(*arguments).header["summary"] == summary
        assert [path.read_bytes() for path in gone] == before
        assert all(read_stage(folder).complete for folder in folders)
    with pytest.raises(MimicbenchError, match="the variants of 'more' need a name of their own"):
        make_augmented(
            tmp_path, "more", replace(source, references=stage), config, task.fulfilled_by_human, making.QUIET
        )


def test_all_tasks_are_those_that_have_the_set(tmp_path, capsys):
    with making.by_hand(tmp_path / "lift-box" / "references" / "mine") as stage:
        stage.finish()
    assert [one.task for one in recipes("all", source="mine", workdir=tmp_path)] == ["lift-box"]
    assert [one.task for one in recipes("sit-sofa", source="mine", workdir=tmp_path)] == ["sit-sofa"]
    assert len(recipes("all", source="other", workdir=tmp_path)) == len(recipes("all", workdir=tmp_path)) == len(TASKS)
    for source, words in (
        ("mind", "called 'mind' of sit-chair"),
        ("made", "run `mimicbench references --task sit-chair"),
    ):
        with pytest.raises(SystemExit):
            cli.main(["references", "stats", "--workdir", str(tmp_path / "sit-chair"), "--source", source])
        assert words in capsys.readouterr().err
    with pytest.raises(SystemExit):
        cli.main(["references", "augment", "--workdir", str(tmp_path), "--source", "mind", "--task", "lie-bed"])
    how = f"`mimicbench import FILE --task lie-bed --to mind --workdir {tmp_path}` makes the set 'mind'"
    assert how in capsys.readouterr().err


def test_a_kind_that_is_named_twice_is_made_once(tmp_path, capsys):
    words = "--count 4 --kinds size size --workers 1 --json --workdir"
    making.make("references", tmp_path, making.small(objects=400))
    cli.main(["references", "augment", *words.split(), str(tmp_path)])
    told = json.loads(capsys.readouterr().out)
    assert told["clips"] == len(list(Path(told["folder"]).glob("*.npz")))


def test_a_recording_beyond_the_gate_has_variants_no_worse_than_itself(tmp_path):
    """Real soles skate: what the gate would refuse in a synthetic person is no reason against a variant."""
    task = TASKS.get("sit-chair")
    objects, references = making.make("objects", tmp_path), making.make("references", tmp_path)
    with making.by_hand(tmp_path / "sit-chair" / "references" / "skating") as skating:
        for path in sorted(references.folder.glob("*.npz"))[:2]:
            motion = HumanMotion.load(path)
            slide = np.linspace(0, 0.4, motion.frames)[:, None] * np.array([1.0, 0, 0])
            replace(motion, root_pos_w=motion.root_pos_w - slide[::-1]).save(skating.folder / path.name)
        skating.finish()
    source = ClipSource(objects, skating, sorted(skating.folder.glob("*.npz")))
    config = AugmentConfig(("mirror", "speed"), copies=2)
    stage = make_augmented(tmp_path, "more", source, config, task.fulfilled_by_human, making.QUIET)
    assert stage.summary["mirror"] == 2 and stage.summary["speed"] >= 4, "two copies of each, of the mirror image too"
    found = read_objects(tmp_path / "sit-chair" / "objects" / "more")
    for path in stage.folder.glob("*.npz"):
        motion = HumanMotion.load(path)
        assert "skate" in gate(motion, found[motion.object_id])
        assert motion.id == path.stem
    measures = check_clip(motion, found[motion.object_id])
    worse = {**measures, "skate": measures["skate"] * 1.3, "knee_flexion_most": 9.0}
    assert {"skate", "knee_flexion_most"} <= set(faults(worse, original=measures))
    assert not faults(measures, original=measures)
