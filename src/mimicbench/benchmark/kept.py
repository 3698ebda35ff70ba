"""Episodes whose motions are kept beside their rows: the first of the best, and some of each way to fail.

Each is a robot clip (docs/formats.md) from the start to the time limit, named like its episode.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain, zip_longest
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.motion import RobotMotion
from mimicbench.evaluate.failures import FAILURES, failure
from mimicbench.evaluate.rows import EpisodeRow
from mimicbench.sim.timing import CONTROL_DT

if TYPE_CHECKING:
    from mimicbench.envs.clips import ClipSet

MOST_FAILURES = 4


def worth_keeping(rows: Sequence[EpisodeRow]) -> list[EpisodeRow]:
    """The first of the best of one policy's rows, and up to MOST_FAILURES that failed, each kind in its turn.

    None of episodes that were over before anything had moved, as where a policy raises at once.
    """
    rows = [row for row in rows if row.steps]
    if not rows:
        return []
    by_kind = [[row for row in rows if failure(row) == kind] for kind in FAILURES]
    in_turn = [row for row in chain.from_iterable(zip_longest(*by_kind)) if row is not None]
    best = max(rows, key=lambda row: (row.stays, row.success))
    return [best, *[row for row in in_turn if row is not best][:MOST_FAILURES]]


def keep(folder: Path, rows: Sequence[EpisodeRow], positions: Mapping[int, np.ndarray], clips: ClipSet) -> None:
    """Write those that are worth it, of the episodes whose simulator positions (T, nq) are there."""
    folder.mkdir(parents=True, exist_ok=True)
    for row in worth_keeping([row for row in rows if row.episode in positions]):
        as_motion(row, positions[row.episode], clips).save(folder / f"{row.id}.npz")


def forget(folder: Path) -> None:
    """Remove what is kept beside rows that are about to be made anew: their motions would be taken for those of the new
    ones, for episodes are called the same, and not all of both are kept. Who dies in between has rows without motions,
    and those can be made again.
    """
    for path in folder.glob("*.npz"):
        path.unlink(missing_ok=True)


def kept(folder: Path, rows: Sequence[EpisodeRow]) -> list[tuple[EpisodeRow, RobotMotion]]:
    """What `keep` has written of these rows. Raises BadFile or BadMotion if something of it is missing."""
    return [(row, RobotMotion.load(folder / f"{row.id}.npz")) for row in worth_keeping(rows)]


def as_motion(row: EpisodeRow, qpos: np.ndarray, clips: ClipSet) -> RobotMotion:
    """An episode's simulator positions (T, nq) as a clip of the robot, with the object if it moves."""
    robot, obj, began = clips.robot, clips.objects[row.object_id], clips.motions[row.episode]
    joints = len(robot.joint_names)
    moved = {"object_pos_w": qpos[:, -7:-4], "object_quat_w": rot.normalize(qpos[:, -4:])} if obj.movable else {}
    return RobotMotion(
        row.id,
        row.task,
        robot.name,
        robot.joint_names,
        1 / CONTROL_DT,
        qpos[:, :3],
        rot.normalize(qpos[:, 3:7]),
        qpos[:, 7 : 7 + joints],
        obj.id,
        row.reference_id,
        success=row.success,
        wrist_goal_w=began.wrist_goal_w,
        **moved,
    )
