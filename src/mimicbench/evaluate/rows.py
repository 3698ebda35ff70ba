"""One row per episode, in one parquet file, and the summary of such rows.

Every number of a table is a pure function of these rows, and every row names the object, the reference and the seed
that make its episode again.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from functools import partial
from math import isnan
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from mimicbench.core.errors import BadFile, MimicbenchError
from mimicbench.core.files import DIGEST, digest_of_json, write_atomic
from mimicbench.core.foreign.columns import check_claims, read_checked
from mimicbench.evaluate.intervals import Rate

SCHEMA = 2
KIND = "episode_rows"
METADATA = b"mimicbench"
MAX_BYTES = 1 << 30  # 1 GiB, some ten million episodes
ENERGY_LIMITS = (1e6, 2e6, 4e6, 8e6)
"""lambda of the physical metric P [W^2] (appendix, hyperparameters of the physical evaluation metric)."""


@dataclass(frozen=True)
class EpisodeRow:
    """What one episode came to.

    Two rows of equal task, seed and episode had the same start and the same object, if their clips were retargeted
    alike; each way to retarget loses other clips, so across these rows belong together by `reference_id`.
    """

    task: str
    stage: str
    """`track` for a tracker on its references, `imitate` for a policy."""
    policy: str
    """Name of the tracker or of the policy."""
    preset: str
    """`paper` or `improved`."""
    robot: str
    seed: int
    """Seed of the run that the episode belongs to."""
    episode: int
    """Place in the list of episodes, from 0."""
    object_id: str
    object_kind: str
    """Such as `dining` or `stool`."""
    split: str
    """`train` or `test`."""
    reference_id: str
    """The clip that was followed, or whose first frame was the start; empty if there was none."""
    steps: int
    """Control steps until the episode ended."""
    success: bool
    """K was fulfilled at some time within the limit (lift-box: in the last frame)."""
    success_at_end: bool
    """The condition of K held for its time up to the last frame that was run."""
    stays: bool
    """Its condition held over the last 0.3 s of the time limit, or as long as K asks where that is longer, and the
    robot has not fallen."""
    first_success_time: float | None
    """When K was first fulfilled [s]; None if never."""
    fell: bool
    """The robot fell at any time up to the time limit, after success, too."""
    fell_time: float | None
    """When it fell [s]; None if it did not."""
    fell_phase: str
    """What it was at when its fall began: `walking`, `turning`, the task's word such as `sitting down`, or `after
    success`; empty if it did not fall."""
    diverged: bool
    """The physics broke down."""
    max_energy: float
    """Largest e_i = sum over the joints of (torque * velocity)^2 over the frames of the episode [W^2]."""
    seat_height: float | None
    """Height of the surface to sit or lie on [m]; None where the task has none."""
    start_distance: float
    """Horizontal distance of the root from the object's bounding rectangle at the start [m]; 0 inside."""
    end_distance: float
    """The same at the end [m]."""
    mimicbench: str
    """Version that ran the episode."""
    mujoco: str
    """Version that ran the episode."""
    error: str = ""
    """What the policy did wrong, if that ended the episode: raised, gave targets that are none, or took too long."""

    def __post_init__(self) -> None:
        if isnan(self.max_energy) or self.max_energy < 0:
            raise MimicbenchError(
                f"episode {self.id}: the energy is {self.max_energy}; the simulation broke, run the "
                "episode again with its seed to see where"
            )
        if self.fell and self.fell_time is None:
            raise MimicbenchError(f"episode {self.id}: a fall needs its time")
        if self.success and self.first_success_time is None:
            raise MimicbenchError(f"episode {self.id}: a success needs the time at which K was first fulfilled")

    @property
    def id(self) -> str:
        """Stable name of the episode, the same for every policy that ran it."""
        return f"{self.task}-{self.seed}-{self.episode:05d}"

    def holds(self, limit: float) -> bool:
        """K and P(limit): success with every e_i below the limit [W^2]."""
        return self.success and self.max_energy < limit


_TYPES = {str: pa.string(), int: pa.int64(), bool: pa.bool_(), float: pa.float64(), float | None: pa.float64()}
_COLUMNS = pa.schema([pa.field(f.name, _TYPES[f.type], nullable=f.type == (float | None)) for f in fields(EpisodeRow)])  # pyright: ignore[reportArgumentType]


def write_rows(path: Path, rows: Sequence[EpisodeRow], made_from: Mapping[str, Any] | None = None) -> None:
    """Write one parquet file, atomically; the same rows give the same bytes.

    `made_from` says what the rows depend on (networks, clips, protocol, versions); it is kept in the file, so that rows
    and what they are of can never part.
    """
    header: dict[str, Any] = {"schema": SCHEMA, "type": KIND, "made_from": dict(made_from or {})}
    columns = [asdict(row) for row in rows]
    header[DIGEST] = digest_of_json([header, columns])
    written = json.dumps(header, sort_keys=True).encode()
    table = pa.Table.from_pylist(columns, schema=_COLUMNS.with_metadata({METADATA: written}))
    write_atomic(path, partial(_write_table, table))


def _write_table(table: pa.Table, stream: Any) -> None:
    pq.write_table(table, stream, compression="zstd", write_page_checksum=True)


def read_rows(path: Path) -> list[EpisodeRow]:
    """Read what `write_rows` wrote. Raises BadFile if it is missing, cut off, damaged or something else."""
    if not path.is_file():
        told = (
            "is a folder; give the files in it" if path.is_dir() else "does not exist; run `mimicbench evaluate` first"
        )
        raise BadFile(f"{path} {told}")
    if path.stat().st_size > MAX_BYTES:
        raise BadFile(f"{path} is larger than {MAX_BYTES >> 20} MiB; it is not a file of episode rows")
    try:
        with pq.ParquetFile(path, page_checksum_verification=True) as file:
            header = _checked_header(path, file.schema_arrow)
            check_claims(path, file.metadata)
            columns = read_checked(path, file.schema_arrow).to_pylist()
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise BadFile(
            f"{path} cannot be read as parquet ({reason}); it is cut off or damaged: run the evaluation again"
        ) from None
    digest = header.pop(DIGEST, None)
    if set(header) != {"schema", "type", "made_from"} or digest not in (None, digest_of_json([header, columns])):
        raise BadFile(f"{path} is not as it was written; it is damaged: run the evaluation again")
    return [EpisodeRow(**row) for row in columns]


def rows_made_from(path: Path) -> dict[str, Any]:
    """What the rows of a file depend on; empty if it does not say, or cannot be read."""
    try:
        found = json.loads((pq.read_schema(path).metadata or {})[METADATA])["made_from"]
    except (pa.ArrowException, OSError, KeyError, TypeError, ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def _checked_header(path: Path, schema: pa.Schema) -> dict[str, Any]:
    try:
        header = json.loads((schema.metadata or {})[METADATA])
        kind, version = header["type"], header["schema"]
    except (KeyError, TypeError, ValueError, RecursionError):
        raise BadFile(f"{path} is a parquet file, but not one of mimicbench's episode rows") from None
    if kind != KIND:
        raise BadFile(f"{path} holds {kind!r}, expected {KIND!r}")
    if version != SCHEMA:
        raise BadFile(
            f"{path} has schema {version}, this version of mimicbench reads {SCHEMA}; run the evaluation again"
        )
    if not schema.equals(_COLUMNS, check_metadata=False):
        differs = sorted(set(schema.names) ^ set(_COLUMNS.names)) or [
            f.name for f in _COLUMNS if schema.field(f.name).type != f.type
        ]
        raise BadFile(
            f"{path} has other columns than episode rows ({', '.join(differs) or 'another order'}); "
            "run the evaluation again"
        )
    return header


@dataclass(frozen=True)
class Summary:
    """The rates of one policy on one task."""

    task: str
    stage: str
    policy: str
    preset: str
    robot: str
    kinematic: Rate
    """K."""
    at_end: Rate
    """K in the last frame."""
    by_limit: tuple[Rate, ...]
    """K and P(lambda) for each of ENERGY_LIMITS."""
    fell: Rate
    stays: Rate
    """K's condition at the time limit, on the feet or the seat."""
    errors: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    """What the policy did wrong, and the episodes that this ended; they count as failed."""

    @property
    def energy(self) -> Rate:
        """The energy-averaged rate: the mean over lambda of the rate of K and P(lambda), on n episodes.

        Its count is the mean count over the limits, and its interval Wilson's at that count. An episode then scores 0,
        1/4, ... or 1 rather than 0 or 1, so its variance is at most p(1-p) and the interval, if anything, too wide.
        """
        return Rate(sum(rate.successes for rate in self.by_limit) / len(self.by_limit), self.kinematic.episodes)

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values, as `mimicbench evaluate --json` prints them."""
        limits = [{"lambda": limit, **rate.to_dict()} for limit, rate in zip(ENERGY_LIMITS, self.by_limit, strict=True)]
        return {
            "task": self.task,
            "policy": self.policy,
            "preset": self.preset,
            "robot": self.robot,
            "episodes": self.kinematic.episodes,
            "kinematic": self.kinematic.to_dict(),
            "energy": {
                **self.energy.to_dict(),
                "limits": limits,
                "interval": "Wilson at the mean count of successes over the limits",
            },
            "at_end": self.at_end.to_dict(),
            "stays": self.stays.to_dict(),
            "fell": self.fell.to_dict(),
            "errors": {error: list(episodes) for error, episodes in self.errors.items()},
        }


def summarize(rows: Sequence[EpisodeRow]) -> Summary:
    """The rates of one policy's rows. Raises MimicbenchError if there are none, or of more than one policy."""
    if not rows:
        raise MimicbenchError("there are no episodes to summarize; run `mimicbench evaluate` first")
    kinds = sorted({_kind(row) for row in rows})
    if len(kinds) > 1:
        raise MimicbenchError(
            f"the rows are of several policies ({'; '.join(' '.join(kind) for kind in kinds)}); "
            "summarize each on its own"
        )
    n = len(rows)
    by_limit = tuple(Rate(sum(row.holds(limit) for row in rows), n) for limit in ENERGY_LIMITS)
    names = ("success", "success_at_end", "fell", "stays")
    kinematic, at_end, fell, stays = (Rate(sum(getattr(row, name) for row in rows), n) for name in names)
    errors = {
        error: tuple(row.episode for row in rows if row.error == error)
        for error in dict.fromkeys(row.error for row in rows if row.error)
    }
    return Summary(*kinds[0], kinematic, at_end, by_limit, fell, stays, errors)


def group(rows: Sequence[EpisodeRow]) -> dict[tuple[str, str, str, str, str], list[EpisodeRow]]:
    """Rows by (task, stage, policy, preset, robot), in the order in which these first come."""
    groups: dict[tuple[str, str, str, str, str], list[EpisodeRow]] = {}
    for row in rows:
        groups.setdefault(_kind(row), []).append(row)
    return groups


def _kind(row: EpisodeRow) -> tuple[str, str, str, str, str]:
    return row.task, row.stage, row.policy, row.preset, row.robot
