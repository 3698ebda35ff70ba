"""Demonstrations on disk, as a LeRobotDataset v3: parquet tables that LeRobot's own loader reads, written with pyarrow.

    meta/info.json                               what the columns are, and how many episodes there are
    meta/stats.json, meta/tasks.parquet          statistics of every column; the tasks by name
    meta/episodes/chunk-000/file-000.parquet     one row per episode: where it is, its object, its reference, its
    success
    data/chunk-000/file-000.parquet              one row per frame

Maps are not stored: the simulator's states are, with the object and reference of each episode, so any observation can
be made again and any success judged again. A file holds a shard of whole episodes. It is written atomically, the frames
first and the episodes after them: whoever dies in between loses that shard and nothing else, and goes on from there.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mimicbench.core.errors import BadFile, MimicbenchError
from mimicbench.core.files import read_json
from mimicbench.imitate.stored.digests import check_digests
from mimicbench.imitate.stored.scratch import joined, scratch
from mimicbench.imitate.stored.tables import matrix, read_table, read_tasks, schema_names

DATASET = "dataset"
"""The folder of them in a stage of demonstrations."""
VERSION = "v3.0"
GAINS = "gains"
"""What info.json says, beside what LeRobot wants to know: which of the robot's gains turned joint targets into torques.
Data sets of before this was recorded lack it."""
FILES_PER_CHUNK = 1000
DATA_PATH = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
EPISODES_PATH = "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
MAX_FRAMES = 20_000_000  # 35 GB of frames, in memory or on the disk

_NUMBERS = (
    *("episode_index", "length", "dataset_from_index", "dataset_to_index"),
    *("data/chunk_index", "data/file_index"),
)
_NEEDED = {*_NUMBERS, "object_id", "reference_id", "success"}
"""Columns of the table of episodes that are read."""
Shard = tuple[dict[str, int], list[dict[str, Any]], list[dict[str, Any]]]
"""Where its frames are, its episodes in order, and those of them that are wanted."""


@dataclass(frozen=True)
class Demos:
    """All demonstrations of a folder as flat arrays over F frames of E episodes."""

    robot: str
    task: str
    fps: float
    joint_names: tuple[str, ...]
    starts: np.ndarray
    """(E + 1,) frame at which each episode starts; the last entry is F."""
    state: np.ndarray | None
    """(F, S), or None if it was not asked for."""
    action: np.ndarray
    """(F, A)"""
    executed_action: np.ndarray
    """(F, A)"""
    qpos: np.ndarray
    """(F, Q)"""
    qvel: np.ndarray
    """(F, V)"""
    object_ids: tuple[str, ...]
    """One per episode."""
    reference_ids: tuple[str, ...]
    success: np.ndarray
    """(E,)"""
    gains: str | None = None
    """Which of the robot's gains turned joint targets into torques, where that was recorded."""
    disk: Path | None = None
    """Folder of the files that large arrays are in (stored.scratch); None: they are in memory."""

    @property
    def episodes(self) -> int:
        """E."""
        return len(self.starts) - 1

    @property
    def frames(self) -> int:
        """F."""
        return int(self.starts[-1])

    def joined(self, *others: "Demos") -> "Demos":
        """These episodes and others of the same robot and task, all with S_current or none.

        Raises MimicbenchError if they were made with different gains.
        """
        every = (self, *others)
        if len(every) == 1:
            return self
        gains = sorted({demos.gains for demos in every if demos.gains is not None})
        if len(gains) > 1:
            raise MimicbenchError(
                f"demonstrations by the gains {' and '.join(gains)} cannot be learned from together, for their joint "
                "targets mean different torques; leave one of them out"
            )

        def rows(name: str) -> Any:
            return joined([getattr(demos, name) for demos in every], self.disk)

        lengths = [np.diff(demos.starts) for demos in every]
        return replace(
            self,
            starts=np.concatenate([[0], np.cumsum(np.concatenate(lengths))]),
            state=None if any(demos.state is None for demos in every) else rows("state"),
            action=rows("action"),
            executed_action=rows("executed_action"),
            qpos=rows("qpos"),
            qvel=rows("qvel"),
            object_ids=sum((demos.object_ids for demos in every), ()),
            reference_ids=sum((demos.reference_ids for demos in every), ()),
            success=rows("success"),
            gains=gains[0] if gains else None,
        )


def load_demos(
    folder: Path,
    robot: str | None = None,
    state: bool = True,
    only_success: bool = True,
    disk: Path | None = None,
) -> Demos:
    """Read a folder that DemoWriter wrote. Raises BadFile.

    Args:
        folder: The dataset.
        robot: The robot that it must be of.
        state: Whether to read S_current too, by far the largest column.
        only_success: Leave out the episodes that failed the task.
        disk: Folder for arrays that are too large for memory, see stored.scratch; None: they are in memory.
    """
    found_robot, fps, joint_names, gains = _described(folder, robot)
    check_digests(folder)
    wanted = {"action": "action", "executed_action": "executed_action", "qpos": "sim.qpos", "qvel": "sim.qvel"}
    if state:
        wanted["state"] = "observation.state"
    shards = _shards(folder, only_success)
    rows = [row for _, _, kept in shards for row in kept]
    if not rows:
        raise BadFile(
            f"{folder} holds no {'successful ' if only_success else ''}demonstration; train the "
            "tracker longer, then run `mimicbench demos` again"
        )
    starts = np.concatenate([[0], np.cumsum([row["length"] for row in rows])])
    if starts[-1] > MAX_FRAMES:
        raise BadFile(
            f"{folder} says that it has {starts[-1]} frames, more than the {MAX_FRAMES} that can be read at once"
        )
    whole = _filled(folder, wanted, shards, int(starts[-1]), disk)
    return Demos(
        robot=found_robot,
        task=read_tasks(folder)[0],
        fps=fps,
        joint_names=joint_names,
        starts=starts,
        state=whole.get("state"),
        action=whole["action"],
        executed_action=whole["executed_action"],
        qpos=whole["qpos"],
        qvel=whole["qvel"],
        object_ids=tuple(row["object_id"] for row in rows),
        reference_ids=tuple(row["reference_id"] for row in rows),
        success=np.array([row["success"] for row in rows]),
        gains=gains,
        disk=disk,
    )


def episode_rows(folder: Path) -> list[dict[str, Any]]:
    """One row for each episode, in order, without statistics: cheap, for no frame is read. Raises BadFile."""
    return [row for _, rows, _ in _shards(folder, only_success=False) for row in rows]


def load_episode(folder: Path, number: int) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """The simulator's states and the targets of one episode, and its row; only its shard is read.

    Arrays are called as in `Demos`. Raises BadFile.
    """
    wanted = {"executed_action": "executed_action", "qpos": "sim.qpos", "qvel": "sim.qvel"}
    for place, rows, _ in _shards(folder, only_success=False):
        mine = [row for row in rows if row["episode_index"] == number]
        if mine:
            return _filled(folder, wanted, [(place, rows, mine)], mine[0]["length"]), mine[0]
    raise BadFile(f"{folder} has no episode {number}; run `mimicbench demos` again")


def recorded_gains(folder: Path) -> str | None:
    """Which gains a dataset was made with; None if it does not say. No frame is read. Raises BadFile."""
    return _described(folder, None)[-1]


def _described(folder: Path, robot: str | None) -> tuple[str, float, tuple[str, ...], str | None]:
    """Robot, rate, joint names and gains of a dataset of ours."""
    path = folder / "meta" / "info.json"
    if not path.exists():
        raise BadFile(f"{folder} holds no demonstrations; run `mimicbench demos` first")
    info = read_json(path)
    try:
        version, found_robot, fps = info["codebase_version"], info["robot_type"], float(info["fps"])
        joint_names, gains = tuple(info["features"]["action"]["names"]), info.get(GAINS)
    except (KeyError, TypeError, ValueError):
        raise BadFile(
            f"{path} does not describe demonstrations of ours; make them again with `mimicbench demos`"
        ) from None
    if version != VERSION:
        raise BadFile(f"{folder} is a LeRobotDataset {version}, this reads {VERSION}; convert it with LeRobot first")
    if robot is not None and found_robot != robot:
        raise BadFile(
            f"{folder} holds demonstrations of robot {found_robot!r}, not of {robot!r}; make some with that robot"
        )
    return found_robot, fps, joint_names, None if gains is None else str(gains)


def _filled(
    folder: Path, wanted: Mapping[str, str], shards: Sequence[Shard], frames: int, disk: Path | None = None
) -> dict[str, np.ndarray]:
    """The `wanted` columns of all `frames`, filled shard by shard, so that no frame is in memory twice; see scratch."""
    whole: dict[str, np.ndarray] = {}
    at = 0
    for place, episodes, kept in shards:
        table = read_table(folder / DATA_PATH.format(**place), list(wanted.values()))
        first, last = episodes[0]["dataset_from_index"], episodes[-1]["dataset_to_index"]
        if table.num_rows != last - first or any(not _within(row, first, last) for row in episodes):
            raise BadFile(
                f"{folder / DATA_PATH.format(**place)} has not the frames of its episodes; delete {folder} "
                "and run `mimicbench demos` again"
            )
        arrays = {name: matrix(table, column_name, folder) for name, column_name in wanted.items()}
        for row in kept:
            part = slice(row["dataset_from_index"] - first, row["dataset_to_index"] - first)
            for name, array in arrays.items():
                if name not in whole:
                    whole[name] = scratch((frames, array.shape[1]), array.dtype, disk)
                whole[name][at : at + row["length"]] = array[part]
            at += row["length"]
    return whole


def _within(row: Mapping[str, Any], first: int, last: int) -> bool:
    """Whether an episode is as long as its frames are, and these are of its shard."""
    begin, end = row["dataset_from_index"], row["dataset_to_index"]
    return first <= begin <= end <= last and row["length"] == end - begin


def _shards(folder: Path, only_success: bool) -> list[Shard]:
    """All shards, with what is needed of their episodes."""
    shards = []
    for path in episode_files(folder):
        names = [name for name in schema_names(path) if name in _NEEDED]
        missing = sorted(_NEEDED - set(names))
        if missing:
            raise BadFile(f"{path} has no column {missing[0]!r}; it is no table of demonstrations of mimicbench's")
        rows = read_table(path, names).to_pylist()
        if odd := [name for name in _NUMBERS if any(type(row[name]) is not int for row in rows)]:
            raise BadFile(f"{path} has something else than whole numbers in {odd[0]!r}; make the demonstrations again")
        rows = sorted(rows, key=lambda row: row["episode_index"])
        if rows:
            place = {"chunk_index": rows[0]["data/chunk_index"], "file_index": rows[0]["data/file_index"]}
            shards.append((place, rows, [row for row in rows if row["success"] or not only_success]))
    return shards


def episode_files(folder: Path) -> list[Path]:
    """The tables of episodes, in the order of their shards."""
    return sorted((folder / "meta" / "episodes").glob("chunk-*/file-*.parquet"))
