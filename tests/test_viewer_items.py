"""Which methods the viewer offers, and beside what it opens episodes and demonstrations. No page is drawn."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from episodes import EPISODE
from learning import clip_of
from making import QUIET, by_hand, make, small
from mimicbench.benchmark.graph import demonstrated
from mimicbench.benchmark.keys import Run
from mimicbench.benchmark.published import published_clips
from mimicbench.benchmark.shipped import SHIPPED
from mimicbench.benchmark.who import Who
from mimicbench.core.checkpoint import checkpoint_digest, load_checkpoint, save_checkpoint
from mimicbench.core.errors import BadFile
from mimicbench.core.files import read_record, write_record
from mimicbench.core.motion import RobotMotion
from mimicbench.core.stage import HEADER, read_stage
from mimicbench.evaluate.rows import write_rows
from mimicbench.imitate.lerobot import DATASET, episode_rows, load_episode
from mimicbench.imitate.settings.demos import DemosConfig
from mimicbench.imitate.stored.demo_writer import Demonstration, DemoWriter
from mimicbench.references.settings import ReferencesConfig
from mimicbench.retarget.settings import RetargetConfig
from mimicbench.robots.registry import DEFAULT_ROBOT, ROBOTS
from mimicbench.tasks.registry import TASKS
from mimicbench.track.registry import TRACKERS
from mimicbench.viewer.catalog import Catalog
from mimicbench.viewer.methods import methods, named, whose
from mimicbench.viewer.opened import open_item
from mimicbench.viewer.tracks import Recording, recorded_track, robot_track

TASK, ROBOT = TASKS.get("sit-chair"), ROBOTS.get(DEFAULT_ROBOT)
"""Of all items here."""


@pytest.fixture(scope="module")
def workdir(tmp_path_factory):
    """Clips of the same names, some to learn from and some to be judged on."""
    folder = tmp_path_factory.mktemp("work")
    for test_only in (False, True):
        make("retarget", folder, small(objects=6, references=ReferencesConfig(count=2, test_only=test_only)))
    return folder


def judged(workdir, name, row=EPISODE, **made_from):
    """An episode of a file of rows, as it is opened."""
    write_rows(workdir / TASK.name / "evaluate" / f"{name}.parquet", [row], made_from)
    catalog = Catalog(workdir)
    one = catalog.named(TASK.name, "evaluate", name)
    return open_item(catalog, one, one.items[0])


def clips(workdir):
    """The sets of retargeted clips, each with its first clip."""
    found = Catalog(workdir).sets(TASK.name, "retarget")
    return [(one, RobotMotion.load(one.file(one.items[0]))) for one in found]


def row_of(motion, **changes):
    """An episode that began in a clip."""
    return replace(EPISODE, object_id=motion.object_id, reference_id=motion.id, **changes)


def learn(folder, name):
    """As if somebody had learned a little on from what is shipped."""
    shipped = load_checkpoint(SHIPPED / TASK.name / name)
    tensors = {key: value + np.asarray(1e-3, value.dtype) for key, value in shipped.tensors.items()}
    save_checkpoint(folder, shipped.kind, shipped.robot, shipped.config, tensors, shipped.notes)
    return folder


@pytest.fixture(scope="module")
def learned(workdir):
    """A tracker and a policy of the workdir's own, beside copies of what it runs on."""
    stage = workdir / TASK.name / "imitate" / "bc-0"
    for name, folder in (("tracker", "tracker"), ("perception", "perception"), ("bc", "policy")):
        learn(stage / folder, name)
    learn(workdir / TASK.name / "track" / "residual-0" / "checkpoint", "tracker")
    return stage / "policy"


def test_a_workdirs_policy_is_not_the_tracker_beside_it(workdir, learned):
    found = methods(TASK.name, ROBOT.name, workdir)
    assert found["bc-0 (workdir)"] == learned
    assert found["residual-0 (workdir)"] == workdir / TASK.name / "track" / "residual-0" / "checkpoint"
    assert found["bc"] == SHIPPED / TASK.name / "bc"


def test_a_damaged_checkpoint_keeps_nobody_from_looking(workdir, learned):
    damaged = workdir / TASK.name / "imitate" / "bc-damaged" / "policy"
    learn(damaged, "bc")
    (damaged / "config.json").write_text('{"format"')
    assert "bc-damaged (workdir)" not in (found := methods(TASK.name, ROBOT.name, workdir))
    assert "bc-0 (workdir)" in found


def test_policies_that_are_called_alike_are_told_apart(tmp_path):
    folders = [tmp_path / name / "policy" for name in ("a", "b.2", "b.2", "bc")] + [tmp_path / "bc", tmp_path / "my.py"]
    (tmp_path / "my.py").touch()
    found = named([str(folder) for folder in folders], {"bc": SHIPPED / TASK.name / "bc"})
    told = {"policy": folders[0], "b.2/policy": folders[1], "bc/policy": folders[3], "my": tmp_path / "my.py"}
    assert found == {**told, f"{tmp_path.name}/bc": tmp_path / "bc"}


def test_an_episode_is_acted_out_again_by_whose_it_is(workdir, learned):
    found, (_, motion) = methods(TASK.name, ROBOT.name, workdir), clips(workdir)[0]

    def acts(name, folder):
        return whose(found, judged(workdir, name, row_of(motion, policy="bc"), **Who("bc", folder).digests))

    assert acts("own", learned) == "bc-0 (workdir)", "not the shipped one, which is called like it"
    assert acts("shipped", SHIPPED / TASK.name / "bc") == "bc"
    gone = judged(workdir, "gone", row_of(motion, policy="bc"), checkpoint="0" * 32)
    assert whose(found, gone) is None, "whoever acted is no longer here"
    silent = judged(workdir, "silent", row_of(motion, policy="bc"))
    assert whose(found, silent) == "bc", "who is called so, where the rows do not say more"


def test_an_episode_is_opened_beside_its_own_object(workdir):
    (first, one), (second, other) = clips(workdir)
    assert one.id == other.id and one.object_id != other.object_id, "else there is nothing to mix up"
    for place, (made, motion) in enumerate(((first, one), (second, other))):
        digest = read_stage(made.path).digest
        found = judged(workdir, f"told-{place}", row_of(motion), clips=digest)
        assert found.obj.id == motion.object_id and np.array_equal(found.clip.root_pos_w, motion.root_pos_w)
        found = judged(workdir, f"silent-{place}", row_of(motion))
        assert found.obj.id == motion.object_id, "where rows do not say of which clips they are"
    with pytest.raises(BadFile, match="no clip .* beside no-such is left .* `mimicbench evaluate` again"):
        judged(workdir, "gone", row_of(replace(one, object_id="no-such")), clips=read_stage(first.path).digest)


def test_an_episode_begins_in_the_clip_that_it_was_judged_on(workdir, tmp_path_factory):
    """Two methods made clips of one name on one object."""
    folder = tmp_path_factory.mktemp("methods")
    for method in ("interaction", "optimization"):
        make("retarget", folder, small(clips=2, retarget=RetargetConfig(method)))
    for made, motion in clips(folder):
        found = judged(folder, made.name, row_of(motion), clips=read_stage(made.path).digest)
        assert np.array_equal(found.clip.joint_pos, motion.joint_pos)


@pytest.fixture(scope="module")
def drawn(workdir):
    """Demonstrations of who followed no clip, made by hand: `rule` at rest, `poses` in those of people."""
    first = clips(workdir)[0][0]
    reads = {"objects": Catalog(workdir).sets(TASK.name, "objects")[0].path, "retarget": first.path}
    for kind, read in (("rule", ["objects"]), ("poses", ["objects", "retarget"])):
        config = DemosConfig(expert="bc", starts=kind, clips=3)
        recipe = small(objects=6, references=ReferencesConfig(count=2), demos=config)
        by = {"expert_checkpoint": checkpoint_digest(SHIPPED / TASK.name / "bc")}
        folder = workdir / TASK.name / "demos" / kind
        more = {"settings": {"clips": 3}, "made_from": by, "reads": {name: reads[name] for name in read}}
        with by_hand(folder, "demos", **more) as stage:
            writer = DemoWriter(folder / DATASET, ROBOT.name, TASK.name, ROBOT.joint_names)
            for motion in demonstrated(Run(recipe, workdir, QUIET)).motions:
                writer.add(standing_still(motion))
            writer.finish()
            stage.finish()
    return workdir


def standing_still(motion):
    """A demonstration of who stands where a start was drawn."""
    start = np.r_[motion.root_pos_w[0], motion.root_quat_w[0], motion.joint_pos[0]]
    qpos, qvel = np.tile(start, (4, 1)), np.zeros((4, 6 + len(ROBOT.joints)))
    targets = qpos[:, 7:]
    return Demonstration(np.zeros((4, 3)), targets, targets, qpos, qvel, motion.object_id, motion.id, True)


@pytest.mark.parametrize("kind", ["rule", "poses"])
def test_who_followed_no_clip_is_seen_beside_its_object(drawn, kind):
    catalog = Catalog(drawn)
    one = catalog.named(TASK.name, "demos", kind)
    rows = episode_rows(one.path / DATASET)
    assert len(one.items) == 3
    for item, row in zip(one.items, rows, strict=True):
        found = open_item(catalog, one, item)
        assert list(found.tracks) == ["robot"] and found.clip is None
        assert found.obj.id == row["object_id"] and found.facts[0].startswith("demonstration ")
        assert "is not here" not in " ".join(found.facts)
        assert found.tracks["robot"].curves() is not None


@pytest.mark.parametrize("kind", ["rule", "poses"])
def test_starts_of_published_demonstrations_are_drawn_again(drawn, kind):
    published = published_clips(Run(small(demos=DemosConfig(source=kind)), drawn, QUIET))
    rows = episode_rows(drawn / TASK.name / "demos" / kind / DATASET)
    assert [(one.id, one.object_id) for one in published.motions] == [
        (row["reference_id"], row["object_id"]) for row in rows
    ]
    first, _ = load_episode(drawn / TASK.name / "demos" / kind / DATASET, 0)
    assert np.allclose(first["qpos"][0, 7:], published.motions[0].joint_pos[0])
    rest = np.allclose(published.motions[0].joint_pos[0], ROBOT.rest_pose)
    assert rest == (kind == "rule"), "people stand straighter than a robot at rest"


def test_torques_are_by_the_gains_of_who_demonstrated(drawn, tmp_path):
    catalog = Catalog(drawn)
    header = read_record(catalog.named(TASK.name, "demos", "rule").path / HEADER)

    def opened(name, made_from, tracker="residual"):
        folder = drawn / TASK.name / "demos" / name
        shutil.copytree(folder.with_name("rule"), folder)
        write_record(folder / HEADER, {**header, "made_from": made_from, "recipe": {"track": {"tracker": tracker}}})
        one = catalog.named(TASK.name, "demos", name)
        found = open_item(catalog, one, one.items[0])
        return found.tracks["robot"].state(0).gains, found.facts

    bc, hst = (checkpoint_digest(SHIPPED / TASK.name / name) for name in ("bc", "hst"))
    assert TRACKERS.get("hst").gains != TRACKERS.get("residual").gains, "else nothing is told apart"
    assert opened("policy", {"expert_checkpoint": bc}, "hst")[0] == TRACKERS.get("residual").gains
    assert opened("tracker", {"tracker": hst})[0] == TRACKERS.get("hst").gains, "another's than the recipe's"
    gains, facts = opened("gone", {"expert_checkpoint": "0"}, "hst")
    assert gains == TRACKERS.get("hst").gains
    assert facts[1] == "who demonstrated is not here: torques are by the gains of tracker hst"


def test_a_recorded_reach_fulfills_k_where_its_clip_does():
    """Its targets are told: without them there would be nothing to reach, and nothing lacking."""
    clips = clip_of(TASKS.get("touch-points"))
    motion, (obj,) = clips.motions[0], clips.objects.values()
    qpos = np.concatenate([motion.root_pos_w, motion.root_quat_w, motion.joint_pos], 1)
    recording = Recording(qpos, np.zeros((len(qpos), 25)), motion.joint_pos, "improved")
    track = recorded_track("demonstration", clips.task, obj, ROBOT, recording, motion.wrist_goal_w)
    np.testing.assert_array_equal(track.info.wrist_goal_w, np.tile(motion.wrist_goal_w, (len(qpos), 1, 1)))
    shown = robot_track(clips.task, motion, obj, ROBOT, "clip")
    assert [track.lacks(frame) for frame in range(len(qpos))] == [shown.lacks(frame) for frame in range(len(qpos))]
    assert "" in {track.lacks(frame) for frame in range(len(qpos))}
