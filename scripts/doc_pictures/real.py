"""Pictures of recorded people: moments of each phase beside synthetic ones."""

from collections.abc import Sequence
from functools import cache, partial
from pathlib import Path

import numpy as np

from doc_pictures.people import synthetic
from doc_pictures.picture import Clip, DocPicture, of_clips
from mimicbench.core.motion import HumanMotion
from mimicbench.drawing.camera import Picture, frame_all
from mimicbench.objects.shape import SceneObject
from mimicbench.references.checks.beside_real import person_of
from mimicbench.references.checks.phases import STRIDE, WINDOW
from mimicbench.references.checks.signals import RATE
from mimicbench.references.importers.recording import Wishes
from mimicbench.references.importers.registry import import_recording
from mimicbench.references.recordings.real_clips import find_clips
from mimicbench.report.render import human_frames
from mimicbench.report.video import strip
from mimicbench.robots.registry import ROBOTS
from mimicbench.sim.scene import build_model

RECORDINGS = {
    "sit-chair": "unihsi/motion_clips/armchair.npy",
    "sit-sofa": "unihsi/motion_clips/armchair002.npy",
    "lie-bed": "unihsi/motion_clips/lie_down_10.npy",
    "lie-sofa": "unihsi/motion_clips/lie_down_2.npy",
    "touch-points": "unihsi/motion_clips/s2_mediaroom2_desk_2_mediaroom2_0_001_reaching_001_reaching.npy",
    "lift-box": "omomo/sub3_largebox_003.pt",
}
MESH = "omomo/largebox.obj"
PHASES = {
    "walk": "sit-chair",
    "turn": "sit-chair",
    "sit down": "sit-chair",
    "rest seated": "sit-sofa",
    "lie down": "lie-bed",
    "rest lying": "lie-bed",
    "reach": "touch-points",
    "lift": "lift-box",
}
"""Phase -> the task whose clips show it."""
FIRST = 2
"""Number of the first synthetic clip that is looked at."""
MOMENTS, LONGEST = 7, 2.4
"""Pictures in a row, over at most so long [s]."""
STILL = Picture(220, 230, 2048)


@cache
def recorded(task: str, real: Path) -> Clip:
    """The clip of a task in its recording."""
    path = real / RECORDINGS[task]
    wishes = Wishes(mesh=real / MESH if path.suffix == ".pt" else None)
    return find_clips(import_recording(path, wishes=wishes), task)[0]


def both(phase: str, task: str, real: Path) -> list[Clip]:
    """Who was recorded, and the first who was made that goes through the phase."""
    for number in range(FIRST, FIRST + 20):
        made = synthetic(task, number)
        if phase in person_of(made[0]).phases:
            return [recorded(task, real), made]
    raise SystemExit(f"nobody of twenty synthetic people does {phase} in {task}")


def draw(phase: str, clips: Sequence[Clip]) -> np.ndarray:
    """Two strips."""
    return np.concatenate(
        [_strip(phase, who, *clip) for who, clip in zip(("recorded", "synthetic"), clips, strict=True)]
    )


def _strip(phase: str, who: str, motion: HumanMotion, obj: SceneObject) -> np.ndarray:
    phases = person_of(motion).phases
    first = phases.index(phase)
    last = first
    while last + 1 < len(phases) and phases[last + 1] == phase:
        last += 1
    start, end = first * STRIDE / RATE, (last * STRIDE + WINDOW) / RATE
    end = min(end, motion.duration)
    # of who rests the end, of all else the beginning
    start, end = (max(start, end - LONGEST), end) if "rest" in phase else (start, min(end, start + LONGEST))
    times = np.linspace(start, end, MOMENTS)
    frames = np.round(times * motion.fps).astype(int).clip(0, motion.frames - 1)
    heading = -125.0 if motion.root_pos_w[frames, 1].mean() >= 0 else 125.0
    camera = frame_all(obj, motion.root_pos_w[frames], STILL.width / STILL.height, 2.05, 0.4, heading)
    drawn = human_frames(build_model(ROBOTS.get("h1"), obj, visuals=True), motion, frames / motion.fps, camera, STILL)
    return strip(list(drawn), [f"{phase}, {who}", *[""] * (MOMENTS - 1)], 2)


def file_of(phase: str) -> str:
    """The picture of a phase."""
    return f"beside-real-{phase.replace(' ', '-')}.png"


def pictures(real: Path) -> list[DocPicture]:
    """One per phase."""
    return [
        DocPicture(file_of(phase), partial(both, phase, task, real), of_clips, partial(draw, phase))
        for phase, task in PHASES.items()
    ]
