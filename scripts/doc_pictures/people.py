"""Pictures of docs/people.md and of the README: moments of clips of synthetic people."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from doc_pictures.picture import Clip, DocPicture, of_clips
from mimicbench.core.motion import HumanMotion
from mimicbench.drawing.camera import Picture, frame_all
from mimicbench.objects.registry import FAMILIES
from mimicbench.objects.shape import SceneObject
from mimicbench.references.synthesis.registry import synthesize
from mimicbench.report.render import human_frames
from mimicbench.report.video import strip
from mimicbench.robots.registry import ROBOTS
from mimicbench.sim.scene import build_model
from mimicbench.tasks.registry import TASKS

ROBOT = ROBOTS.get("h1")
PICTURE = Picture(248, 250, 2048)
MOMENTS = 7
CLIPS = {
    "sit-chair": (1, 2, 5),
    "sit-sofa": (1, 2, 4),
    "lie-bed": (1, 4, 3),
    "lie-sofa": (2, 5, 1),
    "touch-points": (0, 3, 9),
    "lift-box": (0, 2, 5),
}
"""Numbers of the clips that are shown, of seed 0."""
BEFORE = 2.6
"""Of the walk, so much is shown before somebody is at the object [s]."""


def synthetic(task: str, index: int) -> Clip:
    """A clip, and the object that it is on."""
    obj = FAMILIES.get(TASKS.get(task).family).make(index, 0)
    return synthesize(task, index, obj, 0), obj


def people(clips: Sequence[Clip]) -> np.ndarray:
    """One strip below the other."""
    rows = [draw(motion, obj) for motion, obj in clips]
    gap = np.full((6, rows[0].shape[1], 3), 255, np.uint8)
    return np.concatenate([part for row in rows for part in (row, gap)][:-1])


def draw(motion: HumanMotion, obj: SceneObject) -> np.ndarray:
    """Moments of a clip from one place, near enough for hands and feet."""
    frames = moments(motion, obj)
    camera = frame_all(
        obj, motion.root_pos_w[frames], PICTURE.width / PICTURE.height, 1.95, 0.35, heading(motion, frames)
    )
    pictures = human_frames(build_model(ROBOT, obj, visuals=True), motion, frames / motion.fps, camera, PICTURE)
    return strip(list(pictures), [f"{frame / motion.fps:.1f} s" for frame in frames], 2)


def heading(motion: HumanMotion, frames: np.ndarray) -> float | None:
    """In which the camera looks [deg]: at hands from behind the object, at beds from the side on which people are.

    None for the usual.
    """
    if motion.task in ("touch-points", "lift-box"):
        return 58.0
    side = 1.0 if motion.root_pos_w[frames, 1].mean() >= 0 else -1.0
    return -125.0 * side if motion.task == "lie-bed" else None


def moments(motion: HumanMotion, obj: SceneObject) -> np.ndarray:
    """(MOMENTS,) frames at which as much has happened since the last one, of all joints.

    Of a long walk the end only.
    """
    pos, _ = motion.forward_kinematics()
    low, high = obj.bounds()
    away = np.linalg.norm(np.maximum(np.maximum(low[:2] - pos[:, 0, :2], pos[:, 0, :2] - high[:2]), 0.0), axis=1)
    there = int(np.argmax(away < away.min() + 0.35))
    start = max(0, there - round(BEFORE * motion.fps))
    gone = np.linalg.norm(np.diff(pos[start:], axis=0), axis=-1).mean(-1)
    progress = np.concatenate([[0.0], np.cumsum(gone)])
    return start + np.clip(
        np.searchsorted(progress, np.linspace(0.0, progress[-1], MOMENTS) - 1e-9), 0, len(progress) - 1
    )


def pictures() -> list[DocPicture]:
    """Three clips of each task, and the two at the head of the README."""

    def shown(numbers: Sequence[tuple[str, int]]) -> list[Clip]:
        return [synthetic(task, number) for task, number in numbers]

    found = {f"people-{task}.png": [(task, number) for number in numbers] for task, numbers in CLIPS.items()}
    found["human-clips.png"] = [("sit-chair", 2), ("sit-sofa", 1)]
    return [DocPicture(name, partial(shown, numbers), of_clips, people) for name, numbers in found.items()]
