"""Writes demonstrations as `imitate/lerobot.py` describes and reads them, a shard of whole episodes at a time."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from mimicbench.core.errors import MimicbenchError
from mimicbench.core.files import read_json, write_json
from mimicbench.imitate.lerobot import DATA_PATH, EPISODES_PATH, FILES_PER_CHUNK, GAINS, VERSION, episode_files
from mimicbench.imitate.stored.digests import write_digests
from mimicbench.imitate.stored.tables import (
    column,
    flatten_stats,
    merge_stats,
    read_table,
    read_tasks,
    stats_of,
    stats_to_json,
    unflatten_stats,
    write_table,
    write_tasks,
)

STATE, SCENE, PICTURE = "observation.state", "observation.environment_state", "observation.images.elevation"
"""LeRobot's names of the robot's state, and of what its policies see beside it."""
Row = dict[str, Any]
"""Of the table of episodes."""
Stats = dict[str, dict[str, np.ndarray]]
"""Statistics of an episode's columns."""


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
    scene: np.ndarray | None = None
    """(T, N) the object, and the targets, in a few numbers, for policies of LeRobot's; None: not stored."""
    picture: np.ndarray | None = None
    """(T, H, W) uint8 what LeRobot's policies see; None: not stored."""


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
        names: Mapping[str, Sequence[str]] | None = None,
        gains: str | None = None,
    ) -> None:
        """`names` are of the entries of STATE and SCENE; `gains` are those that turned joint targets into torques, and
        None if nobody knows.
        """
        self.folder = folder
        self._names = {
            **dict.fromkeys(("action", "executed_action"), list(joint_names)),
            **{column_name: list(entries) for column_name, entries in (names or {}).items()},
            PICTURE: ["height", "width", "channels"],
        }
        self.robot, self.task, self.joint_names, self.fps = robot, task, tuple(joint_names), fps
        self.gains = gains
        self.shard_episodes = shard_episodes
        self._rows: list[Row] = []
        """The episodes that are on disk, without their statistics."""
        self._stats: list[Stats] = []
        self._waiting: list[Demonstration] = []
        self._files = 0
        info, features = folder / "meta" / "info.json", None
        if not info.exists():
            # whoever was to write it died first: nothing tells what the columns of that shard are
            for path in episode_files(folder):
                path.unlink()
        else:
            found = read_json(info)
            features = found.get("features")
            expected = {"robot_type": robot, "fps": round(fps)}
            differs = [key for key, value in expected.items() if found.get(key) != value]
            differs += [GAINS] if found.get(GAINS) not in (None, gains) else []
            if differs or found.get("codebase_version") != VERSION or read_tasks(folder) != [task]:
                raise MimicbenchError(
                    f"{folder} holds demonstrations of another robot, task or rate, or by other gains; write these to "
                    "another folder, or delete it"
                )
        for path in episode_files(folder):
            rows = read_table(path).to_pylist()
            self._rows += [{key: value for key, value in row.items() if not key.startswith("stats/")} for row in rows]
            self._stats += [unflatten_stats(row) for row in rows]
            self._files += 1
        if self._rows and features is not None:
            self._describe(features)  # somebody may have died before that

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
            **({} if demo.scene is None else {"scene": demo.scene}),
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
        if self._rows:
            write_digests(self.folder)

    def _flush(self) -> None:
        if not self._waiting:
            return
        place = {"chunk_index": self._files // FILES_PER_CHUNK, "file_index": self._files % FILES_PER_CHUNK}
        columns, rows, stats = self._shard(place)
        features = _features({name: arrays[0] for name, arrays in columns.items()}, self._names)
        known = {name for stat in self._stats[:1] for name in stat}
        if known and known != set(features):
            raise MimicbenchError(
                f"{self.folder} has demonstrations with other columns; delete it, and make all of them again"
            )
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
        self._describe(features)

    def _describe(self, features: Mapping[str, Any]) -> None:
        """Write what the whole data set is, and what protects its files from flipped bits."""
        write_json(self.folder / "meta" / "stats.json", stats_to_json(merge_stats(self._stats)))
        write_json(
            self.folder / "meta" / "info.json",
            {
                "codebase_version": VERSION,
                "robot_type": self.robot,
                **({} if self.gains is None else {GAINS: self.gains}),
                "fps": round(self.fps),  # LeRobot wants a whole number
                "features": features,
                "total_episodes": len(self._rows),
                "total_frames": self._rows[-1]["dataset_to_index"],
                "total_tasks": 1,
                "chunks_size": FILES_PER_CHUNK,
                "data_files_size_in_mb": 100,
                "video_files_size_in_mb": 200,
                "data_path": DATA_PATH,
                "video_path": None,
                "splits": {"train": f"0:{len(self._rows)}"},
            },
        )
        write_digests(self.folder)

    def _shard(self, place: Mapping[str, int]) -> tuple[dict[str, list[np.ndarray]], list[Row], list[Stats]]:
        """Columns of the frames, rows and statistics of the episodes that wait, as a shard at `place`."""
        first_episode = len(self._rows)
        index = self._rows[-1]["dataset_to_index"] if self._rows else 0
        columns: dict[str, list[np.ndarray]] = {}
        rows: list[Row] = []
        stats: list[Stats] = []
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
        return columns, rows, stats


def _features(samples: Mapping[str, np.ndarray], names: Mapping[str, list[str] | None]) -> dict[str, dict[str, Any]]:
    """What the columns are, as LeRobot says it; of vectors, of numbers, and of pictures, which become RGB."""
    return {
        name: {
            "dtype": "image" if array.ndim == 3 else str(array.dtype),
            "shape": [*array.shape[1:], 3] if array.ndim == 3 else [array.shape[1] if array.ndim == 2 else 1],
            "names": names.get(name),
        }
        for name, array in samples.items()
    }


def _frame_arrays(demo: Demonstration, episode: int, first: int, fps: float) -> dict[str, np.ndarray]:
    frames = len(demo.action)
    last = np.arange(frames) == frames - 1
    more = {} if demo.scene is None else {SCENE: demo.scene.astype(np.float32)}
    if demo.picture is not None:
        more[PICTURE] = demo.picture
    return {
        STATE: demo.state.astype(np.float32),
        **more,
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
