"""One chair, four stages: a strip of pictures and a video of the human, the retargeted, the tracked and the learned
motion.
"""

import hashlib
import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from functools import partial
from itertools import repeat
from pathlib import Path

import mujoco
import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion
from mimicbench.core.motion import HumanMotion, RobotMotion
from mimicbench.drawing.camera import Camera, Picture, frame_all
from mimicbench.drawing.opengl import draw_apart
from mimicbench.objects.shape import SceneObject
from mimicbench.report.render import human_frames, robot_frames, with_object
from mimicbench.report.video import strip, write_jpeg, write_video
from mimicbench.robots.registry import ROBOTS
from mimicbench.sim.scene import build_model

VERSION = 3
"""Of the drawing; raising it makes all pictures again."""
MAX_SECONDS = 20.0
"""Longest video."""


@dataclass(frozen=True)
class Recording:
    """What a simulation ran through."""

    qpos: np.ndarray
    """(T, nq) simulator positions of the robot's scene."""
    fps: float
    wrist_goal_w: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    """(2, 3) where left and right wrist were to go [m]; empty if the task has no such goal."""


@dataclass(frozen=True)
class Clip:
    """One stage's motion."""

    title: str
    """Such as `Human`."""
    note: str
    """One sentence under it."""
    motion: HumanMotion | RobotMotion | Recording


@dataclass(frozen=True)
class Showcase:
    """Clips beside one object."""

    obj: SceneObject
    robot: str
    """Whose name ROBOTS knows."""
    clips: tuple[Clip, ...]


@dataclass(frozen=True)
class ShowConfig:
    """How a showcase is drawn."""

    moments: int = 5
    """Pictures of a strip."""
    still: Picture = Picture(460, 380, 2048)
    video: Picture = Picture(560, 350, 1024)
    fps: float = 25.0
    """Of the videos."""


QUICK = ShowConfig(video=Picture(560, 350, 1024, samples=0), fps=8.0)
"""For who only wants to see that there are pictures: a seventh of the work."""


@dataclass(frozen=True)
class Shown:
    """The files of one clip."""

    clip: Clip
    strip: Path
    """JPEG."""
    video: Path
    """MP4. All videos of a showcase are of one length, so that they can be moved through together: whose motion is over
    rests in its last frame."""
    seconds: float
    """Of the motion."""


def draw(
    showcase: Showcase, folder: Path, config: ShowConfig | None = None, workers: int = 0, quiet: bool = True
) -> list[Shown]:
    """Draw what is not there yet into `folder`; the names of the files tell what they show.

    Raises NoPictures without OpenGL.
    """
    config = config or ShowConfig()
    _, tracks, cameras = _prepared(showcase, config)
    shown, whole = [], film_seconds(tracks)
    for i, (clip, track) in enumerate(zip(showcase.clips, tracks, strict=True)):
        stem = f"{i}-{_slug(clip.title)}-{_digest(showcase.obj, track, cameras, config, whole)}"
        seconds = min(MAX_SECONDS, track.seconds)
        shown.append(Shown(clip, folder / f"{stem}.jpg", folder / f"{stem}.mp4", seconds))
    missing = [i for i, each in enumerate(shown) if not (each.strip.exists() and each.video.exists())]
    if missing:
        draw_apart(partial(_draw_clip, showcase, config, shown), missing, workers, "drawing", quiet)
    return shown


def _draw_clip(showcase: Showcase, config: ShowConfig, shown: Sequence[Shown], index: int) -> None:
    model, tracks, cameras = _prepared(showcase, config)
    each, track = shown[index], tracks[index]
    times = moments(track.root_pos_w, track.root_quat_w, config.moments) / track.fps
    frames = list(_frames(each.clip.motion, track, model, times, cameras[0], config.still))
    write_jpeg(each.strip, strip(frames, [f"{time:.1f} s" for time in times]))
    times = np.arange(int(film_seconds(tracks) * config.fps) + 1) / config.fps
    moving = times[times <= track.seconds + 1e-9]
    film = _frames(each.clip.motion, track, model, moving, cameras[1], config.video)
    write_video(each.video, _resting(film, len(times) - len(moving)), config.fps)


def film_seconds(tracks: "Sequence[_Track]") -> float:
    """[s] How long all videos are: as the longest motion."""
    return min(MAX_SECONDS, max(track.seconds for track in tracks))


def _resting(frames: Iterable[np.ndarray], count: int) -> Iterator[np.ndarray]:
    """Pictures, and then the last of them `count` times."""
    last = None
    for last in frames:
        yield last
    if last is not None:
        yield from repeat(last, count)


def _prepared(showcase: Showcase, config: ShowConfig) -> tuple[mujoco.MjModel, "list[_Track]", list[Camera]]:
    """The scene, all motions in it, and the cameras of stills and videos."""
    model = build_model(ROBOTS.get(showcase.robot), showcase.obj, visuals=True)
    tracks = [_track(clip.motion, model) for clip in showcase.clips]
    paths = np.concatenate([track.root_pos_w for track in tracks])
    return (
        model,
        tracks,
        [frame_all(showcase.obj, paths, picture.width / picture.height) for picture in (config.still, config.video)],
    )


def moments(root_pos_w: np.ndarray, root_quat_w: np.ndarray, count: int) -> np.ndarray:
    """(count,) frames at which as much has happened since the last one: by meters gone, and turns at a quarter meter
    per radian.
    """
    gone = np.linalg.norm(np.diff(root_pos_w, axis=0), axis=1) + 0.25 * rot.angle_between(
        root_quat_w[:-1], root_quat_w[1:]
    )
    progress = np.concatenate([[0.0], np.cumsum(gone)])
    wanted = np.linspace(0.0, progress[-1], count)
    return np.clip(np.searchsorted(progress, wanted - 1e-9), 0, len(root_pos_w) - 1)


@dataclass(frozen=True)
class _Track:
    """Any motion as the camera sees it."""

    fps: float
    root_pos_w: np.ndarray
    root_quat_w: np.ndarray
    qpos: np.ndarray | None
    """(T, nq); None for a human."""
    content: np.ndarray
    """All that tells it from another motion."""

    @property
    def seconds(self) -> float:
        """How long it is."""
        return (len(self.root_pos_w) - 1) / self.fps


def _track(motion: HumanMotion | RobotMotion | Recording, model: mujoco.MjModel) -> _Track:
    goals = motion.wrist_goal_w
    if isinstance(motion, HumanMotion):
        content = np.concatenate(
            [
                part.ravel()
                for part in (motion.root_pos_w, motion.local_quat, motion.object_pos_w, motion.object_quat_w, goals)
            ]
        )
        return _Track(
            motion.fps, motion.root_pos_w, motion.local_quat[:, motion.skeleton.parents.index(-1)], None, content
        )
    if isinstance(motion, RobotMotion):
        motion = Recording(positions(motion, model), motion.fps, goals)
    root = int(model.joint("root").qposadr[0])
    return _Track(
        motion.fps,
        motion.qpos[:, root : root + 3],
        motion.qpos[:, root + 3 : root + 7],
        motion.qpos,
        np.append(motion.qpos, goals),
    )


def positions(motion: RobotMotion, model: mujoco.MjModel) -> np.ndarray:
    """(T, nq) a robot clip and its object as positions of a scene's model."""
    qpos = with_object(model, motion)
    root = int(model.joint("root").qposadr[0])
    qpos[:, root : root + 3], qpos[:, root + 3 : root + 7] = motion.root_pos_w, motion.root_quat_w
    for j, name in enumerate(motion.joint_names):
        try:
            qpos[:, int(model.joint(name).qposadr[0])] = motion.joint_pos[:, j]
        except KeyError:
            raise BadMotion(
                f"{motion.id}: the robot of this scene has no joint {name!r}; the clip is of robot {motion.robot!r}"
            ) from None
    return qpos


def _frames(
    motion: HumanMotion | RobotMotion | Recording,
    track: _Track,
    model: mujoco.MjModel,
    times: np.ndarray,
    camera: Camera,
    picture: Picture,
) -> Iterable[np.ndarray]:
    if isinstance(motion, HumanMotion):
        return human_frames(model, motion, times, camera, picture)
    assert track.qpos is not None
    index = np.clip(np.round(times * track.fps).astype(int), 0, len(track.qpos) - 1)
    return robot_frames(model, track.qpos[index], camera, picture, motion.wrist_goal_w)


def _digest(obj: SceneObject, track: _Track, cameras: Sequence[Camera], config: ShowConfig, seconds: float) -> str:
    drawn = [asdict(camera) for camera in cameras], asdict(config), seconds
    plain = json.dumps([VERSION, obj.to_dict(), track.fps, *drawn], sort_keys=True)
    return hashlib.blake2b(
        plain.encode() + np.ascontiguousarray(track.content, np.float32).tobytes(), digest_size=6
    ).hexdigest()


def _slug(title: str) -> str:
    return "".join(character if character.isalnum() else "-" for character in title.lower())
