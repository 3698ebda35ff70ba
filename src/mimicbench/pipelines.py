"""The stages of a task, one after the other, each on the artefacts of the one before.

A Workspace says where they are and with which seed; each function below is one stage with its files, and returns it
finished. Running a finished stage again does nothing; a killed one goes on where it stopped.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from mimicbench.core.motion import RobotMotion
from mimicbench.core.stage import Stage, open_stage, read_stage
from mimicbench.objects.make import ObjectsConfig, make_objects, read_objects
from mimicbench.objects.shape import SceneObject
from mimicbench.references.make import ReferencesConfig, make_references
from mimicbench.retarget.make import RetargetConfig, make_retargeted, read_retargeted
from mimicbench.robot.description import Robot, load_robot
from mimicbench.tasks.registry import get_task
from mimicbench.tasks.task import Task

if TYPE_CHECKING:  # these bring torch, which the earlier stages do without
    from mimicbench.evaluate.rows import EpisodeRow
    from mimicbench.track.train import TrackConfig

Say = Callable[[str], None]


@dataclass(frozen=True)
class Workspace:
    """Where a task's artefacts are, and what every stage shares."""

    workdir: Path
    slug: str
    seed: int = 0
    workers: int = 0
    """Threads or processes; 0 for all processors. Never changes a result."""
    quiet: bool = False
    """No progress bars."""
    robot_name: str = "h1"

    @cached_property
    def task(self) -> Task:
        """The task. Raises UnknownName."""
        return get_task(self.slug)

    @cached_property
    def robot(self) -> Robot:
        """The robot. Raises UnknownName."""
        return load_robot(self.robot_name)

    def folder(self, stage: str) -> Path:
        """`<workdir>/<task>/<stage>`."""
        return self.workdir / self.slug / stage

    def finished(self, stage: str) -> Stage:
        """An earlier stage. Raises BadFile with the command that makes it."""
        return read_stage(self.folder(stage), f"mimicbench {stage} --task {self.slug} --workdir {self.workdir}")

    def objects(self) -> dict[str, SceneObject]:
        """All objects by id."""
        self.finished("objects")
        return read_objects(self.folder("objects"))

    def motions(self, split: str | None = None) -> list[RobotMotion]:
        """Retargeted clips that fulfil K, of one split or of both."""
        self.finished("retarget")
        objects = self.objects()
        return [m for m in read_retargeted(self.folder("retarget"), self.robot.name) if split is None or objects[m.object_id].split == split]


def objects_stage(ws: Workspace, config: ObjectsConfig) -> Stage:
    """Make objects of the task's family."""
    return make_objects(ws.folder("objects"), ws.slug, ws.task.family, config, ws.seed)


def references_stage(ws: Workspace, config: ReferencesConfig) -> Stage:
    """Make human clips on the objects."""
    return make_references(ws.folder("references"), ws.finished("objects"), ws.slug, config, ws.seed, ws.workers, ws.quiet)


def retarget_stage(ws: Workspace, config: RetargetConfig) -> Stage:
    """Retarget the clips and judge each by K."""
    return make_retargeted(ws.folder("retarget"), ws.finished("references"), ws.folder("objects"), ws.slug, ws.task.fulfilled, config, ws.workers, ws.quiet)


def track_stage(ws: Workspace, config: TrackConfig, say: Say = print) -> Stage:
    """Train the tracker on the clips of training objects; objects of the test split only judge it."""
    from mimicbench.track.train import train_tracker

    stage = open_stage(ws.folder("track"), "track", ws.slug, ws.seed, asdict(config), {"retarget": ws.finished("retarget").fingerprint})
    if stage.complete:
        return stage
    train, test = ws.motions("train"), ws.motions("test")

    def report(row: dict) -> None:
        say(
            f"{row['samples'] / 1e6:6.2f} M samples  {row['samples'] / row['seconds']:6.0f}/s  reward {row['reward']:.3f}  "
            f"K on training clips {row['k_train']:.2f}, on unseen objects {row['k_held_out']:.2f}"
        )

    train_tracker(stage.folder, ws.robot, ws.task, train, test, ws.objects(), config, ws.seed, ws.workers, report)
    return stage.finish(clips=len(train), samples=config.samples)


def evaluate_tracker(ws: Workspace, checkpoint: Path, episodes: int, split: str) -> list[EpisodeRow]:
    """One row per clip: the tracker follows `episodes` clips of a split from their first frames."""
    from mimicbench.evaluate.rollout import tracker_rows
    from mimicbench.track.checkpoint import load_tracker
    from mimicbench.track.rollout import track_clips

    tracker = load_tracker(checkpoint, ws.robot)
    motions, objects = ws.motions(split)[:episodes], ws.objects()
    rollout = track_clips(tracker, ws.robot, ws.task, motions, objects, ws.workers)
    return tracker_rows(rollout, motions, objects, ws.task, ws.robot, "tracker", tracker.kind.name, ws.seed)
