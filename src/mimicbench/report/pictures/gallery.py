"""What a report shows beside its one episode: the last moments of some that failed, and objects with their counts."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import numpy as np

from mimicbench.core.motion import RobotMotion
from mimicbench.drawing.camera import Picture, frame_all
from mimicbench.drawing.opengl import draw_apart
from mimicbench.evaluate.failures import failure
from mimicbench.evaluate.intervals import Rate
from mimicbench.evaluate.rows import EpisodeRow
from mimicbench.objects.shape import SceneObject
from mimicbench.report.pictures.sheet import draw_object, sheet_camera
from mimicbench.report.pictures.showcase import positions
from mimicbench.report.render import robot_frames
from mimicbench.report.video import write_jpeg, write_video
from mimicbench.robots.registry import ROBOTS
from mimicbench.sim.scene import build_model

BEFORE, AFTER = 3.0, 1.5
"""[s] That a video shows before a fall (or before the time limit, for who does not fall), and after it."""
MOST_OBJECTS = 24
"""Objects that are shown, those with the most failures first."""
FILM = Picture(360, 250, 512)
TILE = Picture(150, 130, 512)
VERSION = 1
"""Of the drawing; raising it makes all pictures again."""


@dataclass(frozen=True)
class Failed:
    """An episode that failed."""

    row: EpisodeRow
    motion: RobotMotion
    """From its start to the time limit."""
    obj: SceneObject

    @property
    def part(self) -> tuple[float, float]:
        """From when to when it is shown [s]."""
        middle = self.row.fell_time if self.row.fell_time is not None else self.motion.duration
        return max(0.0, middle - BEFORE), min(self.motion.duration, middle + AFTER)

    @property
    def caption(self) -> str:
        """What happened, when, and where."""
        start, end = self.part
        told = failure(self.row) or "failed"
        if self.row.fell and "fell" not in told:
            told += f", fell {self.row.fell_phase}"
        return f"{told} · {self.row.object_kind}, {self.row.object_id} · {start:.1f} to {end:.1f} s"


def draw_failures(
    failed: Sequence[Failed], folder: Path, fps: float = 25.0, workers: int = 0, quiet: bool = True
) -> list[Path]:
    """Videos of episodes that failed, those that are not there yet drawn into `folder`. Raises NoPictures."""
    paths = [folder / f"failed-{one.row.policy}-{one.row.id}-{_digest(one, fps)}.mp4" for one in failed]
    missing = [(one, path) for one, path in zip(failed, paths, strict=True) if not path.exists()]
    if missing:
        draw_apart(partial(_draw_failure, fps), missing, workers, "drawing failures", quiet)
    return paths


def _draw_failure(fps: float, job: tuple[Failed, Path]) -> None:
    one, path = job
    model = build_model(ROBOTS.get(one.motion.robot), one.obj, visuals=True)
    start, end = one.part
    frames = np.round(np.arange(start, end, 1 / fps) * one.motion.fps).astype(int)
    qpos = positions(one.motion, model)[np.minimum(frames, one.motion.frames - 1)]
    camera = frame_all(one.obj, qpos[:, :3], FILM.width / FILM.height)
    write_video(path, robot_frames(model, qpos, camera, FILM, one.motion.wrist_goal_w), fps)


@dataclass(frozen=True)
class Counted:
    """An object, and in how many episodes beside it a policy succeeded."""

    obj: SceneObject
    rate: Rate


def counted(rows: Sequence[EpisodeRow], objects: Sequence[SceneObject]) -> list[Counted]:
    """One policy's objects, those with the most failures first."""
    won = {obj.id: [row.success for row in rows if row.object_id == obj.id] for obj in objects}
    found = [Counted(obj, Rate(sum(won[obj.id]), len(won[obj.id]))) for obj in objects if won[obj.id]]
    return sorted(found, key=lambda one: (one.rate.successes - one.rate.episodes, one.rate.rate, one.obj.id))


def draw_objects(shown: Sequence[Counted], folder: Path, workers: int = 0, quiet: bool = True) -> list[Path]:
    """Pictures of objects, all to one scale, those that are not there yet drawn into `folder`. Raises NoPictures."""
    camera = sheet_camera([one.obj for one in shown], TILE)
    paths = [folder / f"{one.obj.id}-{_hash([one.obj.to_dict(), asdict(camera), asdict(TILE)])}.jpg" for one in shown]
    missing = [i for i, path in enumerate(paths) if not path.exists()]
    if missing:
        draw = partial(draw_object, TILE, camera)
        drawn = draw_apart(draw, [shown[i].obj for i in missing], workers, "drawing objects", quiet)
        for i, picture in zip(missing, drawn, strict=True):
            write_jpeg(paths[i], picture)
    return paths


def _digest(one: Failed, fps: float) -> str:
    motion = one.motion
    arrays = (motion.root_pos_w, motion.root_quat_w, motion.joint_pos, motion.object_pos_w, motion.object_quat_w)
    content = np.concatenate([array.astype(np.float32).ravel() for array in arrays])
    return _hash([one.obj.to_dict(), asdict(FILM), fps, one.part, hashlib.blake2b(content.tobytes()).hexdigest()])


def _hash(values: object) -> str:
    return hashlib.blake2b(json.dumps([VERSION, values], sort_keys=True).encode(), digest_size=6).hexdigest()
