"""Motions of episodes that are kept beside their rows: which ones, and what they are read as again."""

from dataclasses import replace

import numpy as np
import pytest

from mimicbench.benchmark.kept import MOST_FAILURES, as_motion, keep, kept, worth_keeping
from mimicbench.core.errors import BadFile
from mimicbench.core.motion import RobotMotion
from mimicbench.envs.clips import ClipSet
from mimicbench.evaluate.failures import failure
from mimicbench.objects.registry import make_object
from mimicbench.robots.registry import ROBOTS
from mimicbench.tasks.registry import TASKS
from test_evaluate_rows import ROW

ROBOT = ROBOTS.get("h1")


def rows(*ends):
    """Rows of episodes that ended in these ways."""
    ways = {
        "stays": {},
        "leaves": {"stays": False},
        "falls": {"success": False, "stays": False, "fell": True, "fell_time": 2.0, "fell_phase": "walking"},
        "wanders": {"success": False, "stays": False, "end_distance": 1.0},
    }
    return [replace(ROW, episode=i, **ways[end]) for i, end in enumerate(ends)]


def test_each_way_to_fail_comes_in_its_turn():
    found = worth_keeping(rows("falls", "falls", "stays", "falls", "leaves", "wanders", "stays", "falls"))
    assert [row.episode for row in found] == [2, 0, 5, 4, 1], "the first that stays, then falls, wandering, leaving"
    assert len(found) == 1 + MOST_FAILURES
    assert [row.episode for row in worth_keeping(rows("falls", "leaves", "falls"))] == [1, 0, 2], "the best failed, too"
    assert [failure(row) for row in worth_keeping(rows("stays"))] == [None]


def clips(task, object_id, count):
    """Clips of a robot that stands; only their names and goals matter."""
    motion = RobotMotion(
        "clip", task, "h1", ROBOT.joint_names, 50, np.array([[0, 0, 1.0]] * 2), np.array([[1.0, 0, 0, 0]] * 2),
        np.tile(ROBOT.rest_pose, (2, 1)), object_id, "clip",
        wrist_goal_w=np.array([[1, 0.3, 1], [1, -0.3, 1.0]]),
    )  # fmt: skip
    return ClipSet(TASKS.get(task), ROBOT, [motion] * count, {object_id: make_object(object_id)})


@pytest.mark.parametrize(
    ("task", "object_id", "free"), [("sit-chair", "chair-0-00003", 0), ("lift-box", "box-0-00000", 7)]
)
def test_what_is_kept_is_what_the_simulator_went_through(tmp_path, task, object_id, free):
    random = np.random.default_rng(0)
    qpos = random.normal(size=(30, 7 + len(ROBOT.joints) + free)).astype(np.float32)
    done = [replace(row, task=task, object_id=object_id) for row in rows("stays", "falls", "stays")]
    made_of = clips(task, object_id, 3)
    keep(tmp_path / "kept", done, {0: qpos, 1: qpos + 1, 2: qpos}, made_of)
    assert sorted(path.name for path in (tmp_path / "kept").iterdir()) == [f"{row.id}.npz" for row in done[:2]]
    (first, motion), (second, other) = kept(tmp_path / "kept", done)
    assert (first.episode, second.episode) == (0, 1) and motion.id == done[0].id and motion.fps == 50
    assert np.allclose(motion.root_pos_w, qpos[:, :3]) and np.allclose(other.joint_pos, qpos[:, 7:26] + 1)
    assert np.allclose(np.linalg.norm(motion.root_quat_w, axis=1), 1)
    assert np.allclose(motion.wrist_goal_w, made_of.motions[0].wrist_goal_w)
    assert len(motion.object_pos_w) == (30 if free else 0)
    assert not free or np.allclose(motion.object_pos_w, qpos[:, -7:-4])
    (tmp_path / "kept" / f"{done[1].id}.npz").unlink()
    with pytest.raises(BadFile):
        kept(tmp_path / "kept", done)


def test_of_who_never_moved_nothing_is_kept(tmp_path):
    still = [replace(row, steps=0) for row in rows("wanders", "wanders")]
    keep(tmp_path / "kept", still, {0: np.zeros((1, 26)), 1: np.zeros((1, 26))}, clips("sit-chair", "chair-0-00003", 2))
    assert kept(tmp_path / "kept", still) == []


def test_an_episode_on_a_moving_object_keeps_its_way():
    qpos = np.tile(np.r_[0, 0, 1.0, 1, 0, 0, 0, ROBOT.rest_pose, 0.4, 0, 0.2, 1, 0, 0, 0], (5, 1))
    row = replace(ROW, task="lift-box", object_id="box-0-00000")
    motion = as_motion(row, qpos, clips("lift-box", "box-0-00000", 1))
    assert np.allclose(motion.object_pos_w, (0.4, 0, 0.2)) and motion.success
