"""Pictures of robots: the H1 itself, starts of the six tasks, and what becomes of people's clips."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import gymnasium
import numpy as np

import mimicbench  # noqa: F401 (makes the environments known)
from doc_pictures.people import synthetic
from doc_pictures.picture import DocPicture, of_clips, of_objects, of_robots
from doc_pictures.real import recorded
from mimicbench.core import rotations as rot
from mimicbench.drawing.camera import Camera, Picture
from mimicbench.objects.registry import FAMILIES
from mimicbench.objects.shape import SceneObject
from mimicbench.report.render import Painter
from mimicbench.report.retargeting import SideBySide, draw_side_by_side
from mimicbench.report.video import strip
from mimicbench.retarget.clip import Clip
from mimicbench.retarget.registry import METHODS
from mimicbench.robots.registry import ROBOTS
from mimicbench.sim.scene import build_model
from mimicbench.tasks.registry import TASKS

H1 = ROBOTS.get("h1")
SHOWN = {"sit-chair": 3, "sit-sofa": 0, "lie-bed": 0, "lie-sofa": 0, "touch-points": 0, "lift-box": 0}
"""Number of the clip of each task that is retargeted."""


def standing_and_seated() -> tuple[SceneObject, list[tuple[np.ndarray, np.ndarray, float]]]:
    """A chair, and per moment the robot's root (3,), joints (19,) and heading [rad]."""
    chair = FAMILIES.get("chair").make(1, 0)
    stands = np.array(H1.rest_pose)
    pos, quat = H1.forward_kinematics(np.zeros(3), rot.IDENTITY, stands)
    place = np.array([0.35, -0.85, -H1.keypoint_pos("left_sole", pos, quat)[2]])
    seat = np.array([float(chair.seat_polygon[:, 0].mean()), 0.0, chair.require_seat() + 0.24])

    def over_floor(sits: np.ndarray) -> float:
        found = H1.forward_kinematics(seat, rot.IDENTITY, sits)
        return abs(float(H1.keypoint_pos("left_sole", *found)[2]))

    sits = min((_seated(bent) for bent in np.linspace(1.0, 1.6, 121)), key=over_floor)
    return chair, [(place, stands, 0.2), (seat, sits, 0.0)]


def _seated(bent: float) -> np.ndarray:
    """(19,) joints of who sits with hips and knees bent so far [rad], shanks upright and feet level."""
    sits = np.zeros(len(H1.joint_names))
    for name, angle in (("hip_pitch", -bent), ("knee", bent), ("shoulder_pitch", -0.35), ("elbow", 0.5)):
        for side in ("left", "right"):
            sits[H1.joint_names.index(f"{side}_{name}_joint")] = angle
    return sits


def draw_h1(shown: tuple[SceneObject, list[tuple[np.ndarray, np.ndarray, float]]]) -> np.ndarray:
    """Both moments side by side."""
    chair, moments = shown
    frames = []
    for place, joints, yaw in moments:
        model = build_model(H1, chair, visuals=True)
        qpos = model.qpos0.copy()
        qpos[:26] = np.concatenate([place, rot.from_yaw(np.array(yaw)), joints])
        camera = Camera((0.2, -0.3, 0.85), 4.1, 215.0, -12.0)
        with Painter(model, Picture(460, 560, 4096), camera) as painter:
            frames.append(painter.draw(qpos))
    return strip(frames, ["standing", "seated"])


@dataclass(frozen=True)
class Start:
    """How an episode begins."""

    obj: SceneObject
    pose: np.ndarray
    """(26,) root and joints."""
    picture: np.ndarray


def starts() -> list[Start]:
    """One of each task."""
    found = []
    for number, task in enumerate(TASKS):
        name = "".join(word.capitalize() for word in task.split("-"))
        env = gymnasium.make(f"mimicbench/{name}-v0", render_mode="rgb_array", width=400, height=300)
        env.reset(seed=number)
        start = env.unwrapped.episodes.starts[0]  # type: ignore[attr-defined]
        pose = np.concatenate([start.root_pos_w, start.root_quat_w, start.joint_pos])
        found.append(Start(start.obj, pose, np.asarray(env.render())))
        env.close()
    return found


def draw_starts(found: Sequence[Start]) -> np.ndarray:
    """Three by two."""
    rows = [np.concatenate([start.picture for start in found[i : i + 3]], 1) for i in range(0, len(found), 3)]
    return np.concatenate(rows)


def retargeted(task: str, real: Path | None = None) -> SideBySide:
    """A clip by every method: a synthetic one, or the first of the recordings that does the task."""
    human, obj = synthetic(task, SHOWN[task]) if real is None else recorded(task, real)
    clip = Clip(human, obj, H1)
    robots = {}
    for name in METHODS:
        method = METHODS.get(name)
        preset = "paper" if "paper" in method.presets else method.preset(None)
        robots[method.titled(preset)] = method.retarget(clip, preset)
    return SideBySide(obj, human, robots)


def pictures() -> list[DocPicture]:
    """Those that show no recordings."""
    return [
        DocPicture(
            "h1.jpg",
            standing_and_seated,
            lambda shown: [*of_objects([shown[0]]), *(np.concatenate([p, q, [y]]) for p, q, y in shown[1])],
            draw_h1,
        ),
        DocPicture(
            "environments.png",
            starts,
            lambda found: [*of_objects([start.obj for start in found]), *(start.pose for start in found)],
            draw_starts,
        ),
        *(_retargeting(f"retargeting-{task}.jpg", task, None) for task in TASKS),
    ]


def real_pictures(real: Path) -> list[DocPicture]:
    """Those that show recordings."""
    return [_retargeting(f"retargeting-real-{task}.jpg", task, real) for task in TASKS]


def _retargeting(name: str, task: str, real: Path | None) -> DocPicture:
    return DocPicture(
        name,
        partial(retargeted, task, real),
        lambda sides: [*of_clips([(sides.human, sides.obj)]), *of_robots(list(sides.robots.values()))],
        draw_side_by_side,
    )
