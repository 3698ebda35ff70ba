"""The stages of a task, one after the other, each on the artefacts of the one before.

A Workspace says where they are and with which seed; each function below is one stage with its files, and returns it
finished. Running a finished stage again does nothing; a killed one goes on where it stopped.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from mimicbench.core.errors import BadFile, MimicbenchError, UnknownName
from mimicbench.core.motion import HumanMotion, RobotMotion
from mimicbench.core.stage import Stage, open_stage, read_stage
from mimicbench.objects.make import ObjectsConfig, make_objects, read_objects
from mimicbench.objects.shape import SceneObject
from mimicbench.references.make import ImportConfig, ReferencesConfig, import_references, make_references, remake
from mimicbench.retarget.make import RetargetConfig, make_retargeted, read_retargeted
from mimicbench.retarget.registry import METHODS
from mimicbench.robots.description import Robot
from mimicbench.robots.registry import ROBOTS
from mimicbench.sim.devices import CPU
from mimicbench.tasks.registry import TASKS
from mimicbench.tasks.task import Task

if TYPE_CHECKING:  # these bring torch, which the earlier stages do without
    import numpy as np

    from mimicbench.envs.clips import ClipSet
    from mimicbench.envs.vec_env import EnvConfig
    from mimicbench.evaluate.rows import EpisodeRow
    from mimicbench.imitate.demos import DemosConfig
    from mimicbench.imitate.make import ImitateConfig
    from mimicbench.references.augment import AugmentConfig
    from mimicbench.references.checks.stats import SetStatistics
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
    device: str = "cpu"
    """What computes the physics, and where networks learn and judge: `cpu`, `cuda`, `cuda:1` or `warp-cpu`."""

    def __post_init__(self) -> None:
        """Raises UnknownName or MimicbenchError where there is no such device."""
        if self.device != CPU:
            from mimicbench.sim.backends import check_device

            check_device(self.device)

    @cached_property
    def task(self) -> Task:
        """The task. Raises UnknownName."""
        return TASKS.get(self.slug)

    @cached_property
    def robot(self) -> Robot:
        """The robot. Raises UnknownName."""
        return ROBOTS.get(self.robot_name)

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
        """Retargeted clips that fulfil K, of one split or of both, without the long rest after it is fulfilled."""
        self.finished("retarget")
        objects = self.objects()
        motions = [
            m
            for m in read_retargeted(self.folder("retarget"), self.robot.name)
            if split is None or objects[m.object_id].split == split
        ]
        return [self.task.trimmed(m, objects[m.object_id], self.robot) for m in motions]


def objects_stage(ws: Workspace, config: ObjectsConfig) -> Stage:
    """Make objects of the task's family."""
    return make_objects(ws.folder("objects"), ws.slug, ws.task.family, config, ws.seed)


def references_stage(ws: Workspace, config: ReferencesConfig) -> Stage:
    """Make human clips on the objects."""
    return make_references(
        ws.folder("references"),
        ws.finished("objects"),
        ws.slug,
        ws.task.fulfilled_by_human,
        config,
        ws.seed,
        ws.workers,
        ws.quiet,
    )


def remake_clip(ws: Workspace, name: str) -> tuple[HumanMotion, list[str]]:
    """One human clip of the workdir made again from its id, and what the gate says about it."""
    return remake(ws.finished("references"), ws.folder("objects"), name, ws.task.fulfilled_by_human)


def augment_stage(ws: Workspace, to: Path, config: AugmentConfig) -> Stage:
    """All clips of the workdir and variants of them in another workdir. Raises MimicbenchError if that is the same."""
    from mimicbench.references.augment import make_augmented

    other = Workspace(to, ws.slug, ws.seed, ws.workers, ws.quiet)
    if to.resolve() == ws.workdir.resolve():
        raise MimicbenchError(f"{to} holds the clips themselves; give --to another folder for the variants")
    return make_augmented(
        other.folder("objects"),
        other.folder("references"),
        ws.finished("objects"),
        ws.finished("references"),
        ws.slug,
        ws.task.fulfilled_by_human,
        config,
        ws.seed,
        ws.workers,
        ws.quiet,
    )


def reference_statistics(workdir: Path, tasks: Sequence[str]) -> list[SetStatistics]:
    """Statistics of the human clips of those tasks that have any. Raises BadFile if none has."""
    from mimicbench.references.checks.stats import set_statistics

    spaces = [Workspace(workdir, task) for task in tasks]
    there = [ws for ws in spaces if any(ws.folder("references").glob("*.npz"))] or spaces[:1]
    return [set_statistics(ws.task.name, ws.folder("objects"), ws.folder("references")) for ws in there]


def reference_motions(workdir: Path, tasks: Sequence[str]) -> dict[str, list[HumanMotion]]:
    """The human clips of those tasks that have any. Raises BadFile if none has."""
    found = {}
    for task in tasks:
        folder = Workspace(workdir, task).folder("references")
        if paths := sorted(folder.glob("*.npz")):
            found[task] = [HumanMotion.load(path) for path in paths]
    if not found:
        raise BadFile(f"{workdir} holds no human clips; run `mimicbench references --workdir {workdir}` first")
    return found


def import_stage(ws: Workspace, files: Sequence[Path], say: Say, config: ImportConfig | None = None) -> Stage:
    """Human clips from recordings instead of made ones, on objects fitted to them."""
    fulfils = ws.task.fulfilled_by_human
    return import_references(ws.folder("objects"), ws.folder("references"), ws.slug, fulfils, files, say, config)[1]


def retarget_stage(ws: Workspace, config: RetargetConfig, beside: bool = False) -> Stage:
    """Retarget the clips, judge each by its measures and by K.

    Later stages go on from `<task>/retarget`, whatever method made it. `beside`: into
    `<task>/retarget-<method>-<preset>` instead, so that
    several methods can be had side by side in one workdir.
    """
    method = METHODS.get(config.method)
    folder = ws.folder(f"retarget-{method.name}-{method.preset(config.preset)}" if beside else "retarget")
    return make_retargeted(
        folder,
        ws.finished("references"),
        ws.folder("objects"),
        ws.slug,
        ws.task.fulfilled,
        config,
        ws.workers,
        ws.quiet,
    )


def compared_stages(ws: Workspace, methods: Sequence[RetargetConfig], clips: int) -> list[Stage]:
    """The first `clips` clips by each method, in `<task>/compare/<clips>-<method>-<preset>`."""
    found = []
    for config in methods:
        method = METHODS.get(config.method)
        folder = ws.folder("compare") / f"{clips}-{method.name}-{method.preset(config.preset)}"
        references = ws.finished("references")
        found.append(
            make_retargeted(
                folder,
                references,
                ws.folder("objects"),
                ws.slug,
                ws.task.fulfilled,
                config,
                ws.workers,
                ws.quiet,
                clips,
            )
        )
    return found


def clip_set(ws: Workspace, split: str | None) -> ClipSet:
    """Retargeted clips of one split, or of both, with their objects."""
    from mimicbench.envs.clips import ClipSet

    return ClipSet(ws.task, ws.robot, ws.motions(split), ws.objects())


def env_config(ws: Workspace) -> EnvConfig:
    """Device and threads."""
    from mimicbench.envs.vec_env import EnvConfig

    return EnvConfig(device=ws.device, workers=ws.workers)


def track_stage(ws: Workspace, config: TrackConfig, say: Say = print) -> Stage:
    """Train the tracker on the clips of training objects; objects of the test split only judge it."""
    from mimicbench.track.train import train_tracker

    stage = open_stage(
        ws.folder("track"), "track", ws.slug, ws.seed, asdict(config), {"retarget": ws.finished("retarget").fingerprint}
    )
    if stage.complete:
        return stage
    train, test = clip_set(ws, "train"), clip_set(ws, "test")

    def report(row: dict) -> None:
        unseen = "" if row["k_held_out"] is None else f", on unseen objects {row['k_held_out']:.2f}"
        say(
            f"{row['samples'] / 1e6:6.2f} M samples  {row['samples'] / row['seconds']:6.0f}/s  reward "
            f"{row['reward']:.3f}  K on training clips {row['k_train']:.2f}{unseen}"
        )

    train_tracker(stage.folder, train, test, config, ws.seed, env_config(ws), report)
    return stage.finish(clips=len(train), samples=config.samples, device=ws.device)


def evaluate_tracker(ws: Workspace, checkpoint: Path, episodes: int, split: str | None) -> list[EpisodeRow]:
    """One row per clip: the tracker follows `episodes` clips of a split from their first frames, to the time limit."""
    from mimicbench.evaluate.rollout import Judged, tracker_rows
    from mimicbench.track.checkpoint import load_tracker
    from mimicbench.track.rollout import RolloutConfig, track_clips

    _one_thread()
    tracker = load_tracker(checkpoint, ws.robot)
    clips = clip_set(ws, split).first(episodes)
    rollout = track_clips(tracker, clips, RolloutConfig(settle=None), env_config(ws))
    return tracker_rows(rollout, clips, Judged("track", "tracker", tracker.spec.gains, ws.seed))


def demos_stage(ws: Workspace, config: DemosConfig) -> Stage:
    """Let the tracker turn the training clips into demonstrations."""
    from mimicbench.imitate.demos import make_demos
    from mimicbench.track.checkpoint import load_tracker

    track = ws.finished("track")
    tracker = load_tracker(track.folder / "checkpoint", ws.robot)
    made_from = {"retarget": ws.finished("retarget").fingerprint, "tracker": track.fingerprint}
    stage = open_stage(ws.folder("demos"), "demos", ws.slug, ws.seed, asdict(config), made_from)
    return make_demos(stage, tracker, clip_set(ws, "train"), config, env_config(ws), ws.quiet)


def imitate_stage(ws: Workspace, name: str, config: ImitateConfig, say: Say = print) -> Stage:
    """Learn the policy `name`, and before it what it needs: the tracker's copy, the eyes, the demonstrations."""
    from mimicbench.imitate import make

    track, folder, objects = ws.finished("track"), ws.folder("imitate"), ws.objects()
    if not (folder / "tracker" / "config.json").exists():
        copy_checkpoint(track.folder / "checkpoint", folder / "tracker")
    train = [obj for obj in objects.values() if obj.split == "train"]
    test = [obj for obj in objects.values() if obj.split == "test"]
    made_from = {"objects": ws.finished("objects").fingerprint}
    eyes = make.make_perception(
        folder / "perception", ws.slug, ws.robot, train, test, made_from, config.perception, ws.quiet
    )
    if name == "planner":
        made_from = {"track": track.fingerprint, "perception": eyes.fingerprint}
        stage = open_stage(folder / name, name, ws.slug, ws.seed, asdict(config.planner), made_from)
        return make.make_planner(stage, clip_set(ws, "train"), config.planner, say, env_config(ws))
    demos = demos_stage(ws, config.demos)
    made_from = {"demos": demos.fingerprint, "perception": eyes.fingerprint}
    return make.make_clone(
        folder / name,
        ws.robot,
        ws.task,
        name,
        demos.folder / "dataset",
        objects,
        made_from,
        config.clone,
        ws.seed,
        ws.quiet,
    )


def copy_checkpoint(source: Path, target: Path) -> None:
    """Copy a checkpoint's two files, whole or not at all."""
    from mimicbench.core.checkpoint import CONFIG, MODEL
    from mimicbench.core.files import write_atomic

    for name in (MODEL, CONFIG):  # config.json last: a folder with it is whole
        data = (source / name).read_bytes()
        write_atomic(target / name, lambda stream, data=data: stream.write(data))


def _one_thread() -> None:
    """Networks judge with one thread, whatever `workers` says: sums round differently on more."""
    import torch

    torch.set_num_threads(1)


BEST = {"sit-chair": "planner"}
"""The policy that we ship as our best, by task."""
SHIPPED = Path(__file__).parent / "checkpoints"
"""Checkpoints that come with the package, laid out as an `imitate` folder is, by task."""


def policy_folder(ws: Workspace, policy: str) -> Path:
    """Where a policy is: `best`, a name, or a path. A workdir's own comes before the shipped one.

    Raises UnknownName.
    """
    name = BEST.get(ws.slug, "planner") if policy == "best" else policy
    places = [ws.folder("imitate") / name, SHIPPED / ws.slug / name]
    if "/" in policy or policy.startswith("."):
        return Path(policy)
    for place in places:
        if (place / "config.json").exists():
            return place
    known = {
        path.parent.name for root in (ws.folder("imitate"), SHIPPED / ws.slug) for path in root.glob("*/config.json")
    }
    raise UnknownName("policy", policy, ["best", *sorted(known - {"tracker", "perception"})])


def tracker_folder(ws: Workspace) -> Path:
    """The workdir's own tracker, or the shipped one."""
    own = ws.folder("track") / "checkpoint"
    return own if (own / "config.json").exists() else SHIPPED / ws.slug / "tracker"


def evaluate_policy(
    ws: Workspace, policy: str, episodes: int, record: Sequence[int] = ()
) -> tuple[list[EpisodeRow], dict[int, np.ndarray]]:
    """One row per episode on unseen objects from unseen starts, and the states of the episodes in `record`.

    The same episodes for every policy: the first `episodes` clips of the test split.
    """
    from mimicbench.core.parallel import counter
    from mimicbench.evaluate.rollout import Judged, Protocol, policy_rows, run_policy
    from mimicbench.imitate.make import load_any

    _one_thread()
    folder = policy_folder(ws, policy)
    driver = load_any(folder, ws.robot, ws.task)
    clips = clip_set(ws, "test").first(episodes)
    with counter(len(clips), f"evaluating {folder.name}", ws.quiet) as tick:
        runs = run_policy(driver, clips, Protocol(), record, tick, env_config(ws))
    rows = policy_rows(runs, clips, Judged("imitate", folder.name, driver.gains, ws.seed))
    recordings = {}
    for number, run in enumerate(runs):
        recordings |= {number * Protocol().batch + episode: track for episode, track in run.recordings.items()}
    return rows, recordings


def prepare_episodes(ws: Workspace, episodes: int) -> None:
    """See to it that there are `episodes` retargeted clips on objects of the test split to start from.

    Does nothing if the workdir has its own.
    """
    if (ws.folder("retarget") / "header.json").exists():
        ws.finished("retarget")
        return
    objects_stage(ws, ObjectsConfig())
    # some more, for the gate and K may leave out a few
    references_stage(ws, ReferencesConfig(episodes + episodes // 20 + 2, test_only=True))
    retarget_stage(ws, RetargetConfig())
