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
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from mimicbench.core.errors import BadFile, MimicbenchError
from mimicbench.core.files import read_json, write_json
from mimicbench.imitate.tables import (
    column,
    flatten_stats,
    matrix,
    merge_stats,
    read_table,
    read_tasks,
    schema_names,
    stats_of,
    stats_to_json,
    unflatten_stats,
    write_table,
    write_tasks,
)

VERSION = "v3.0"
FILES_PER_CHUNK = 1000
DATA_PATH = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
EPISODES_PATH = "meta/episodes/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
MAX_FRAMES = 20_000_000  # 35 GB of frames: more would not fit in memory


@dataclass(frozen=True)
class Demonstration:
    """One episode of a tracker, before and after each of its T actions."""

    state: np.ndarray
    """(T, S) S_current of the paper before the action."""
    action: np.ndarray
    """(T, A) joint position targets that the tracker wanted [rad]: what is to be learned."""
    executed_action: np.ndarray
    """(T, A) targets that were executed [rad]: with noise, where there was any."""
    qpos: np.ndarray
    """(T, Q) simulator positions before the action: root position 3, root quaternion wxyz 4, joints."""
    qvel: np.ndarray
    """(T, V) simulator velocities before the action: root linear (world) 3, root angular (root frame) 3, joints."""
    object_id: str
    reference_id: str
    """The robot motion that was tracked."""
    success: bool
    """Whether the episode fulfills the task's metric K."""
    seed: int = 0
    """Of the noise."""


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

    @property
    def episodes(self) -> int:
        """E."""
        return len(self.starts) - 1

    @property
    def frames(self) -> int:
        """F."""
        return int(self.starts[-1])


class DemoWriter:
    """Appends episodes to a folder, a shard at a time.

    Made anew on a folder that was interrupted, it goes on after its last whole shard.
    """

    def __init__(
        self,
        folder: Path,
        robot: str,
        task: str,
        joint_names: Sequence[str],
        fps: float = 50.0,
        shard_episodes: int = 64,
    ) -> None:
        self.folder = folder
        self.robot, self.task, self.joint_names, self.fps = robot, task, tuple(joint_names), fps
        self.shard_episodes = shard_episodes
        self._rows: list[dict[str, Any]] = []
        """The episodes that are on disk, without their statistics."""
        self._stats: list[dict[str, dict[str, np.ndarray]]] = []
        self._waiting: list[Demonstration] = []
        self._files = 0
        info = folder / "meta" / "info.json"
        if info.exists():
            found = read_json(info)
            expected = {"robot_type": robot, "fps": fps}
            differs = [key for key, value in expected.items() if found.get(key) != value]
            if differs or found.get("codebase_version") != VERSION or read_tasks(folder) != [task]:
                raise MimicbenchError(
                    f"{folder} holds demonstrations of another robot, task or rate; write these to "
                    "another folder, or delete it"
                )
        for path in _episode_files(folder):
            rows = read_table(path).to_pylist()
            self._rows += [{key: value for key, value in row.items() if not key.startswith("stats/")} for row in rows]
            self._stats += [unflatten_stats(row) for row in rows]
            self._files += 1

    @property
    def written(self) -> tuple[str, ...]:
        """The reference ids of the episodes that are safely on disk: those need not be made again."""
        return tuple(row["reference_id"] for row in self._rows)

    def add(self, demo: Demonstration) -> None:
        """Append an episode; a full shard is written. Raises MimicbenchError if its arrays do not fit."""
        frames = len(demo.action)
        arrays = {
            "state": demo.state,
            "action": demo.action,
            "executed_action": demo.executed_action,
            "qpos": demo.qpos,
            "qvel": demo.qvel,
        }
        for name, array in arrays.items():
            if array.ndim != 2 or len(array) != frames or not frames or not np.isfinite(array).all():
                raise MimicbenchError(
                    f"the demonstration of {demo.reference_id} is not usable: {name} must be {frames} "
                    "rows of finite numbers"
                )
        self._waiting.append(demo)
        if len(self._waiting) >= self.shard_episodes:
            self._flush()

    def finish(self) -> None:
        """Write what is left."""
        self._flush()

    def _flush(self) -> None:
        if not self._waiting:
            return
        place = {"chunk_index": self._files // FILES_PER_CHUNK, "file_index": self._files % FILES_PER_CHUNK}
        first_episode = len(self._rows)
        index = self._rows[-1]["dataset_to_index"] if self._rows else 0
        columns: dict[str, list[np.ndarray]] = {}
        rows, stats = [], []
        for offset, demo in enumerate(self._waiting):
            frames = len(demo.action)
            arrays = _frame_arrays(demo, first_episode + offset, index, self.fps)
            for name, array in arrays.items():
                columns.setdefault(name, []).append(array)
            stats.append({name: stats_of(array) for name, array in arrays.items()})
            rows.append(
                {
                    "episode_index": first_episode + offset,
                    "tasks": [self.task],
                    "length": frames,
                    "dataset_from_index": index,
                    "dataset_to_index": index + frames,
                    "data/chunk_index": place["chunk_index"],
                    "data/file_index": place["file_index"],
                    "meta/episodes/chunk_index": place["chunk_index"],
                    "meta/episodes/file_index": place["file_index"],
                    "object_id": demo.object_id,
                    "reference_id": demo.reference_id,
                    "success": bool(demo.success),
                    "seed": demo.seed,
                }
            )
            index += frames
        features = self._features({name: arrays[0] for name, arrays in columns.items()})
        table = {name: column(np.concatenate(arrays), features[name]) for name, arrays in columns.items()}
        write_table(self.folder / DATA_PATH.format(**place), pa.table(table))
        flat = [{**row, **flatten_stats(stat)} for row, stat in zip(rows, stats, strict=True)]
        if not self._rows:
            write_tasks(self.folder, [self.task])
        write_table(self.folder / EPISODES_PATH.format(**place), pa.Table.from_pylist(flat))
        self._rows += rows
        self._stats += stats
        self._files += 1
        self._waiting = []
        write_json(self.folder / "meta" / "stats.json", stats_to_json(merge_stats(self._stats)))
        write_json(
            self.folder / "meta" / "info.json",
            {
                "codebase_version": VERSION,
                "robot_type": self.robot,
                "fps": self.fps,
                "features": features,
                "total_episodes": len(self._rows),
                "total_frames": index,
                "total_tasks": 1,
                "chunks_size": FILES_PER_CHUNK,
                "data_files_size_in_mb": 100,
                "video_files_size_in_mb": 200,
                "data_path": DATA_PATH,
                "video_path": None,
                "splits": {"train": f"0:{len(self._rows)}"},
            },
        )

    def _features(self, samples: Mapping[str, np.ndarray]) -> dict[str, dict[str, Any]]:
        names = {"action": list(self.joint_names), "executed_action": list(self.joint_names)}
        return {
            name: {
                "dtype": str(array.dtype),
                "shape": [array.shape[1] if array.ndim == 2 else 1],
                "names": names.get(name),
            }
            for name, array in samples.items()
        }


def load_demos(folder: Path, robot: str | None = None, state: bool = True, only_success: bool = True) -> Demos:
    """Read a folder that DemoWriter wrote. Raises BadFile.

    Args:
        folder: The dataset.
        robot: The robot that it must be of.
        state: Whether to read S_current too, by far the largest column.
        only_success: Leave out the episodes that failed the task.
    """
    path = folder / "meta" / "info.json"
    if not path.exists():
        raise BadFile(f"{folder} holds no demonstrations; run `mimicbench demos` first")
    info = read_json(path)
    try:
        version, found_robot, fps = info["codebase_version"], info["robot_type"], float(info["fps"])
        joint_names = tuple(info["features"]["action"]["names"])
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
    wanted = {"action": "action", "executed_action": "executed_action", "qpos": "sim.qpos", "qvel": "sim.qvel"}
    if state:
        wanted["state"] = "observation.state"
    shards = [
        (place, episodes, [row for row in episodes if row["success"] or not only_success])
        for place, episodes in _shards(folder)
    ]
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
    # filled shard by shard, so that no frame is in memory twice
    whole: dict[str, np.ndarray] = {}
    at = 0
    for place, episodes, kept in shards:
        table = read_table(folder / DATA_PATH.format(**place), list(wanted.values()))
        first = episodes[0]["dataset_from_index"]
        if table.num_rows != episodes[-1]["dataset_to_index"] - first:
            raise BadFile(
                f"{folder / DATA_PATH.format(**place)} lacks frames of its episodes; delete {folder} "
                "and run `mimicbench demos` again"
            )
        arrays = {name: matrix(table, column_name, folder) for name, column_name in wanted.items()}
        for row in kept:
            part = slice(row["dataset_from_index"] - first, row["dataset_to_index"] - first)
            for name, array in arrays.items():
                if name not in whole:
                    whole[name] = np.empty((starts[-1], array.shape[1]), array.dtype)
                whole[name][at : at + row["length"]] = array[part]
            at += row["length"]
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
    )


def _frame_arrays(demo: Demonstration, episode: int, first: int, fps: float) -> dict[str, np.ndarray]:
    frames = len(demo.action)
    last = np.arange(frames) == frames - 1
    return {
        "observation.state": demo.state.astype(np.float32),
        "action": demo.action.astype(np.float32),
        "executed_action": demo.executed_action.astype(np.float32),
        "sim.qpos": demo.qpos.astype(np.float64),
        "sim.qvel": demo.qvel.astype(np.float64),
        "timestamp": (np.arange(frames) / fps).astype(np.float32),
        "frame_index": np.arange(frames),
        "episode_index": np.full(frames, episode),
        "index": first + np.arange(frames),
        "task_index": np.zeros(frames, np.int64),
        "next.done": last,
        "next.success": last & demo.success,
    }


def _shards(folder: Path) -> list[tuple[dict[str, int], list[dict[str, Any]]]]:
    """Where each shard's frames are, and its episodes in order, without their statistics."""
    shards = []
    for path in _episode_files(folder):
        names = [name for name in schema_names(path) if not name.startswith("stats/")]
        rows = sorted(read_table(path, names).to_pylist(), key=lambda row: row["episode_index"])
        if rows:
            shards.append(
                ({"chunk_index": rows[0]["data/chunk_index"], "file_index": rows[0]["data/file_index"]}, rows)
            )
    return shards


def _episode_files(folder: Path) -> list[Path]:
    return sorted((folder / "meta" / "episodes").glob("chunk-*/file-*.parquet"))
