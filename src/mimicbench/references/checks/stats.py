"""What a set of clips is: the paper's table of numbers, sizes and durations, and how much its clips differ from each
other.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadFile
from mimicbench.core.files import read_npz
from mimicbench.core.motion import HumanMotion
from mimicbench.objects.make import read_objects
from mimicbench.objects.shape import SceneObject
from mimicbench.references.body.body import body_of
from mimicbench.references.importers.recording import stature
from mimicbench.references.paper import PAPER_SETS, Spread

SAMPLE = 300
"""Clips, evenly spread, whose whole motion is looked at; of the others only where the pelvis is."""
MOVING = 0.2
"""A pelvis that is faster [m/s] walks."""


@dataclass(frozen=True)
class Variety:
    """How much clips differ from each other."""

    start_distance: Spread
    """From the object's middle [m]."""
    start_bearing: float
    """Deviation of where people start, seen from the object [degrees]."""
    start_heading: float
    """Evenness of the headings at the start: 0 if all are alike, 1 if they point anywhere."""
    path_length: Spread
    """Of the pelvis, seen from above [m]."""
    path_spread: float
    """Mean distance of two clips' pelvises at the same share of their clips [m]."""
    walking_speed: Spread
    """[m/s] Median of a clip's, while the pelvis moves."""
    stature: Spread
    """From floor to the top of the head [m]."""
    final_pose: float
    """Mean distance of the same joint in the last frames of two clips [m], relative to the pelvis's place and heading,
    at one body size."""
    middle_pose: float
    """The same halfway through."""
    style: dict[str, Spread]
    """Every choice that clips record."""


@dataclass(frozen=True)
class SetStatistics:
    """One task's clips and objects. Sizes in cm, as the paper's table has them."""

    task: str
    objects: int
    length: Spread
    width: Spread
    height: Spread
    clips: int
    duration: Spread
    """[s]"""
    bytes_per_clip: float
    variety: Variety
    samples: "Samples"

    def to_dict(self) -> dict[str, Any]:
        """Plain JSON values, with the paper's beside them."""
        data = {name: value for name, value in vars(self).items() if name not in ("samples", "variety")}
        return data | {
            "variety": asdict(self.variety),
            "paper": asdict(PAPER_SETS[self.task]) if self.task in PAPER_SETS else None,
        }


@dataclass(frozen=True)
class Samples:
    """One number per clip or object, for plots."""

    duration: np.ndarray
    """(N,) [s]"""
    start_xy: np.ndarray
    """(N, 2) of the pelvis [m]."""
    walking_speed: np.ndarray
    """(N,) [m/s]; NaN where nobody walks."""
    size: np.ndarray
    """(M, 3) of the objects [cm]."""


def set_statistics(task: str, objects_folder: Path, references_folder: Path) -> SetStatistics:
    """Measure what is on disk. Raises BadFile if there is no clip."""
    paths = sorted(references_folder.glob("*.npz"))
    if not paths:
        raise BadFile(f"{references_folder} holds no clips; run `mimicbench references --task {task}` first")
    durations, starts, speeds, tracks = [], [], [], []
    for path in paths:
        header, data = read_npz(path, "human_motion", ("root_pos_w",))
        track, fps = data["root_pos_w"].astype(float), float(header["fps"])
        durations.append((len(track) - 1) / fps)
        starts.append(track[0, :2])
        speed = np.linalg.norm(np.diff(track[:, :2], axis=0), axis=-1) * fps
        speeds.append(float(np.median(speed[speed > MOVING])) if (speed > MOVING).sum() > 0.5 * fps else np.nan)
        tracks.append(track[:, :2])
    objects = read_objects(objects_folder)
    sizes = np.array([object_size(obj) for obj in objects.values()])
    duration, speed = np.array(durations), np.array(speeds)
    samples = Samples(duration, np.array(starts), speed, sizes)
    shown = [paths[i] for i in np.unique(np.linspace(0, len(paths) - 1, min(SAMPLE, len(paths))).astype(int))]
    variety = _variety([HumanMotion.load(path) for path in shown], tracks, samples)
    length, width, height = (spread(sizes[:, axis]) for axis in range(3))
    space = float(np.mean([path.stat().st_size for path in paths]))
    return SetStatistics(
        task, len(objects), length, width, height, len(paths), spread(duration), space, variety, samples
    )


def object_size(obj: SceneObject) -> tuple[float, float, float]:
    """Length, width and height [cm] as the paper's table has them: the length of sofas and couches is their long
    side.
    """
    low, high = obj.bounds()
    x, y, z = (100 * (high - low)).tolist()
    return (y, x, z) if obj.family in ("sofa", "couch") else (x, y, z)


def spread(values: np.ndarray) -> Spread:
    """Mean and standard deviation of what is finite; NaN of nothing."""
    values = values[np.isfinite(values)]
    return (float(values.mean()), float(values.std())) if len(values) else (float("nan"), float("nan"))


def pairwise(places: np.ndarray) -> float:
    """Mean distance of corresponding points (N, P, D) over all pairs of different rows; 0 of a single row."""
    count = len(places)
    if count < 2:
        return 0.0
    total = sum(float(np.linalg.norm(places[i + 1 :] - places[i], axis=-1).mean(-1).sum()) for i in range(count - 1))
    return total / (count * (count - 1) / 2)


def _variety(motions: Sequence[HumanMotion], tracks: Sequence[np.ndarray], samples: Samples) -> Variety:
    starts = samples.start_xy
    bearing = np.exp(1j * np.arctan2(starts[:, 1], starts[:, 0]))
    headings = np.exp(1j * np.array([rot.yaw_of(motion.local_quat[0, 0]) for motion in motions]))
    shares = np.linspace(0, 1, 40)
    paths = np.stack(
        [
            [np.interp(shares, np.linspace(0, 1, len(track)), track[:, axis]) for axis in (0, 1)]
            for track in tracks[:: _every(tracks)]
        ]
    )
    several = len({motion.skeleton.joint_names for motion in motions}) > 1
    poses = [_poses(motion, several) for motion in motions]
    names = sorted({name for motion in motions for name in motion.style})
    return Variety(
        spread(np.linalg.norm(starts, axis=-1)),
        float(np.degrees(np.sqrt(-2 * np.log(max(abs(bearing.mean()), 1e-12))))),
        1 - float(abs(headings.mean())),
        spread(np.array([np.linalg.norm(np.diff(track, axis=0), axis=-1).sum() for track in tracks])),
        pairwise(np.moveaxis(paths, 1, 2)),
        spread(samples.walking_speed),
        spread(np.array([stature(body_of(motion.skeleton)) for motion in motions])),
        pairwise(np.array([pose[1] for pose in poses])),
        pairwise(np.array([pose[0] for pose in poses])),
        {
            name: spread(np.array([motion.style[name] for motion in motions if name in motion.style], float))
            for name in names
        },
    )


def _every(tracks: Sequence[np.ndarray]) -> int:
    return max(1, -(-len(tracks) // SAMPLE))


def _poses(motion: HumanMotion, shared: bool) -> np.ndarray:
    """(2, J, 3) joints in the middle and in the last frame, seen from the pelvis's place and heading, at the
    standard body's size; of limbs and head alone, which every skeleton has, if `shared`.
    """
    body = body_of(motion.skeleton)
    joints = [*body.legs[0], *body.legs[1], *body.arms[0], *body.arms[1], body.neck[-1]] if shared else slice(None)
    frames = [motion.frames // 2, motion.frames - 1]
    pos, quat = (values[frames] for values in motion.forward_kinematics())
    turn = rot.conjugate(rot.from_yaw(rot.yaw_of(quat[:, 0])))
    return (rot.rotate(turn[:, None], pos - pos[:, :1]) / body.size)[:, joints]
