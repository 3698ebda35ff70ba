"""Which methods the viewer offers, and beside what it opens episodes and demonstrations. No page is drawn."""

from dataclasses import replace

import numpy as np
import pytest

from episodes import EPISODE
from making import make, small
from mimicbench.benchmark.shipped import SHIPPED
from mimicbench.benchmark.who import Who
from mimicbench.core.checkpoint import load_checkpoint, save_checkpoint
from mimicbench.core.errors import BadFile
from mimicbench.core.motion import RobotMotion
from mimicbench.core.stage import read_stage
from mimicbench.evaluate.rows import write_rows
from mimicbench.references.make import ReferencesConfig
from mimicbench.retarget.make import RetargetConfig
from mimicbench.robots.registry import DEFAULT_ROBOT, ROBOTS
from mimicbench.tasks.registry import TASKS
from mimicbench.viewer.catalog import Catalog
from mimicbench.viewer.live import methods, whose
from mimicbench.viewer.opened import open_item

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
