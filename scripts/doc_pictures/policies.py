"""Pictures of policies: what those that come with the package do, beside objects that nothing was trained on."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from doc_pictures.picture import DocPicture, of_objects, of_robots
from mimicbench.benchmark.shipped import SHIPPED
from mimicbench.core.checkpoint import CONFIG, beside
from mimicbench.core.motion import RobotMotion
from mimicbench.core.seeds import digest
from mimicbench.drawing.camera import Camera, Picture, frame_all
from mimicbench.envs.clips import ClipSet
from mimicbench.evaluate.rollout import run_policy
from mimicbench.objects.registry import FAMILIES
from mimicbench.objects.shape import SceneObject
from mimicbench.policies.loading import load_policy
from mimicbench.references.synthesis.registry import synthesize
from mimicbench.report.render import robot_frames
from mimicbench.report.video import strip
from mimicbench.retarget.clip import Clip
from mimicbench.retarget.registry import DEFAULT_METHOD, METHODS
from mimicbench.robots.registry import ROBOTS
from mimicbench.sim.scene import build_model
from mimicbench.sim.timing import CONTROL_DT
from mimicbench.tasks.registry import TASKS

H1 = ROBOTS.get("h1")
SHOWN = {
    "sit-chair": ("online", 100),
    "sit-sofa": ("online", 0),
    "lie-bed": ("online", 0),
    "lie-sofa": ("online", 0),
    "touch-points": ("online", 100),
    "lift-box": ("online", 0),
}
"""Whom to show at which task, and from which number on to look for an object: episodes that succeed."""
MOMENTS = 8
NEAR, DOWN = 3.4, -24.0
"""[m], [deg] From where how robots end is drawn: nearer and from above, for on beds and sofas one sees little else."""


@dataclass(frozen=True)
class Episode:
    """Where a policy begins, beside what."""

    policy: Path
    obj: SceneObject
    start: RobotMotion


def episodes() -> list[Episode]:
    """One of each task, beside an object of the test split."""
    found, method = [], METHODS.get(DEFAULT_METHOD)
    for task, (policy, first) in SHOWN.items():
        family = FAMILIES.get(TASKS.get(task).family)
        obj = next(obj for index in range(first, first + 40) if (obj := family.make(index, 1)).split == "test")
        clip = Clip(synthesize(task, 0, obj, 1), obj, H1)
        found.append(Episode(SHIPPED / task / policy, obj, method.retarget(clip, method.preset(None))))
    return found


def arrays(shown: Sequence[Episode]) -> list[np.ndarray]:
    """Objects, starts and checkpoints; not what the physics makes of them, which machines round differently."""
    used = [[one.policy, *(beside(one.policy, name) for name in ("tracker", "perception"))] for one in shown]
    # the configuration of a checkpoint holds the digest of its weights
    texts = ["".join((f / CONFIG).read_text() for f in folders if (f / CONFIG).exists()) for folders in used]
    known = [float(digest(0, text) % 997) for text in texts]
    return [*of_objects([one.obj for one in shown]), *of_robots([one.start for one in shown]), np.array(known)]


def draw(shown: Sequence[Episode]) -> np.ndarray:
    """A strip of each, moments apart in what the root has gone, the last one at the time limit, from nearer."""
    rows = []
    for one in shown:
        task = TASKS.get(one.start.task)
        clips = ClipSet(task, H1, [one.start], {one.obj.id: one.obj})
        (run,) = run_policy(load_policy(one.policy, H1, task), clips, record=[0])
        qpos = run.recordings[0]
        gone = np.linalg.norm(np.diff(qpos[:, :3], axis=0), axis=1).cumsum()
        moments = [*np.searchsorted(gone, np.linspace(0, 0.99 * gone[-1], MOMENTS - 1)), len(qpos) - 1]
        model, camera = build_model(H1, one.obj, visuals=True), frame_all(one.obj, qpos[:, :3], 1.0)
        x, y, z = (float(value) for value in qpos[-1, :3])
        near = Camera((x, y, z), NEAR, camera.azimuth, DOWN)
        picture, goals = Picture(240, 240, 2048, suns=32), one.start.wrist_goal_w
        frames = [
            frame
            for shown_at, seen_by in ((moments[:-1], camera), (moments[-1:], near))
            for frame in robot_frames(model, qpos[shown_at], seen_by, picture, goals)
        ]
        rows.append(strip(frames, [f"{moment * CONTROL_DT:.1f} s" for moment in moments]))
    return np.concatenate(rows)


def pictures() -> list[DocPicture]:
    """The one."""
    return [DocPicture("policies.jpg", episodes, arrays, draw)]
