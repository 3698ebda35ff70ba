"""Draws the pictures of docs/people.md: `python docs/draw_people.py`. Needs OpenGL.

With `--real FOLDER --to FOLDER` it draws only what people did of whom there are recordings below the first folder, in
any format that can be
imported, into the second: `people-<task>-real.png` beside `people-<task>.png`. What one may show of recordings is up to
their licenses.
"""

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from mimicbench.core.errors import MimicbenchError
from mimicbench.core.motion import HumanMotion
from mimicbench.objects.registry import FAMILIES
from mimicbench.objects.shape import SceneObject
from mimicbench.references.importers.recording import Wishes
from mimicbench.references.importers.registry import import_recording
from mimicbench.references.recordings.real_clips import find_clips
from mimicbench.references.synthesis.registry import synthesize
from mimicbench.report.render import Picture, frame_all, human_frames
from mimicbench.report.video import strip
from mimicbench.robots.registry import ROBOTS
from mimicbench.sim.scene import build_model
from mimicbench.tasks.registry import TASKS

IMAGES = Path(__file__).parent / "images"
ROBOT = ROBOTS.get("h1")
PICTURE = Picture(248, 250, 2048)
MOMENTS = 7
ROWS = 3
"""Clips per picture."""
CLIPS = {
    "sit-chair": (1, 2, 5),
    "sit-sofa": (1, 2, 4),
    "lie-bed": (1, 6, 3),
    "lie-sofa": (3, 12, 4),
    "touch-points": (3, 7, 2),
    "lift-box": (0, 2, 14),
}
"""Numbers of the clips that are shown, of seed 0."""
BEFORE = 2.6
"""Of the walk, so much is shown before somebody is at the object [s]."""
Clip = tuple[HumanMotion, SceneObject]


def main() -> None:
    """All pictures."""
    parser = argparse.ArgumentParser(description="Draw the pictures of docs/people.md.")
    parser.add_argument("--real", type=Path, help="folder of recordings of real people")
    parser.add_argument("--to", type=Path, help="folder for the pictures of real people")
    args = parser.parse_args()
    if (args.real is None) != (args.to is None):
        parser.error("--real and --to go together")
    found = None if args.real is None else list(recorded(args.real))
    for task in TASKS:
        if found is None:
            save(IMAGES / f"people-{task}.png", task, [synthetic(task, index) for index in CLIPS[task]])
        elif clips := [clip for clip in found if clip[0].task == task][:ROWS]:
            save(args.to / f"people-{task}-real.png", task, clips)
            save(args.to / f"people-{task}.png", task, [synthetic(task, index) for index in CLIPS[task]])


def synthetic(task: str, index: int) -> Clip:
    """A clip, and the object that it is on."""
    obj = FAMILIES.get(TASKS.get(task).family).make(index, 0)
    return synthesize(task, index, obj, 0), obj


def recorded(folder: Path) -> Iterator[Clip]:
    """All that real people do of the tasks, in all files below a folder; those that are no motion are passed over."""
    meshes = sorted(folder.rglob("*.obj"))
    for path in sorted(path for path in folder.rglob("*") if path.suffix in (".npy", ".npz", ".pt", ".bvh", ".pkl")):
        mesh = next((mesh for mesh in meshes if mesh.parent == path.parent and mesh.stem in path.stem), None)
        for task in TASKS:
            try:
                clips = find_clips(import_recording(path, wishes=Wishes(mesh=mesh)), task)
            except MimicbenchError:
                continue
            print(f"{path.name}: {len(clips)} x {task}", flush=True)
            yield clips[0]


def save(path: Path, task: str, clips: Sequence[Clip]) -> None:
    """One strip below the other, with few enough colors that the file stays small."""
    rows = [draw(motion, obj) for motion, obj in clips]
    gap = np.full((6, rows[0].shape[1], 3), 255, np.uint8)
    image = np.concatenate([part for row in rows for part in (row, gap)][:-1])
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(image).quantize(128, dither=Image.Dither.NONE).save(path, optimize=True)
    print(f"{path}: {path.stat().st_size / 1000:.0f} kB", flush=True)


def draw(motion: HumanMotion, obj: SceneObject) -> np.ndarray:
    """Moments of a clip from one place, near enough for hands and feet."""
    frames = moments(motion, obj)
    camera = frame_all(
        obj, motion.root_pos_w[frames], PICTURE.width / PICTURE.height, 1.75, 0.3, heading(motion, frames)
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


if __name__ == "__main__":
    main()
