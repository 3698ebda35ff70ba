"""Stage `report`: the page about a recipe's rows, with one episode shown from the human to the policy."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from mimicbench.benchmark import keys
from mimicbench.benchmark.graph import Clips, env_config
from mimicbench.benchmark.judging import episodes_of, episodes_to_show
from mimicbench.benchmark.keys import Run
from mimicbench.benchmark.shipped import SHIPPED
from mimicbench.benchmark.who import who_of
from mimicbench.core.checkpoint import beside
from mimicbench.core.errors import MimicbenchError
from mimicbench.core.files import remove_unfinished
from mimicbench.core.motion import HumanMotion, RobotMotion
from mimicbench.core.stage import locked, read_stage
from mimicbench.core.training import METRICS
from mimicbench.envs.clips import ClipSet
from mimicbench.evaluate.failures import failure
from mimicbench.evaluate.rows import EpisodeRow
from mimicbench.report.curves import Curve, read_curve
from mimicbench.report.pictures.gallery import Failed
from mimicbench.report.pictures.showcase import Clip, Recording, Showcase, ShowConfig
from mimicbench.report.provenance import Provenance, package_versions, this_machine, without_folders
from mimicbench.report.write import ReportInputs, write_report
from mimicbench.sim.timing import CONTROL_DT
from mimicbench.track.checkpoint import load_tracker
from mimicbench.track.rollout import RolloutConfig, track_clips

LEAST_POINTS = 3
"""Evaluations that make a learning curve: fewer show nothing."""


def report(run: Run, rows: Sequence[EpisodeRow], policy: str, show: ShowConfig | None = None) -> Path:
    """Write the report on these rows; `policy` is shown in pictures, which are drawn by `show`. Returns the page."""
    folder = run.workdir / run.recipe.task / "report"
    folder.mkdir(parents=True, exist_ok=True)
    with locked(folder):
        remove_unfinished(folder)
        judged = _judged(run, rows)
        clips = episodes_of(run, len(judged[policy]))
        motions = {name: episodes_to_show(run, name, clips, of_one) for name, of_one in judged.items()}
        if not motions[policy]:
            told = judged[policy][0].error
            raise MimicbenchError(f"{policy} moved in no episode ({told}), so there is nothing to show; mend it first")
        failed = [pair for pairs in motions.values() for pair in pairs if failure(pair[0])]
        inputs = ReportInputs(
            run.recipe.task,
            tuple(rows),
            _provenance(run, clips),
            clips.set.objects,
            _curves(run, policy),
            showcase(run, motions[policy][0][1], clips, policy),
            tuple(Failed(row, motion, clips.set.objects[row.object_id]) for row, motion in failed),
            show or ShowConfig(),
        )
        return write_report(folder, inputs, run.context.say, run.context.workers, run.context.quiet)


def _provenance(run: Run, clips: Clips) -> Provenance:
    # only told of: whoever asks for fewer clips than there are does not need them all
    stages = {"references": read_stage(clips.human, whole=False), "retarget": clips.stage}
    objects = run.workdir / run.recipe.task / stages["retarget"].header["reads"]["objects"]
    stages = {"objects": read_stage(objects, whole=False), **stages}
    command = shlex.join(["mimicbench", *map(without_folders, sys.argv[1:])])
    return Provenance(
        run.recipe.seed,
        (command,),
        {name: {**stage.header["settings"], **stage.summary} for name, stage in stages.items()},
        {name: stage.fingerprint for name, stage in stages.items()},
        package_versions(),
        this_machine(),
    )


def _curves(run: Run, policy: str) -> tuple[Curve, ...]:
    """Learning curves of what was learned here, or of what is shipped: of its last training."""
    tracker, learned = keys.tracker_folder(run), who_of(run, policy).folder
    places = {"eyes": _trained_eyes(run, learned), policy: learned}
    if tracker is not None:
        places = {"tracker": tracker if SHIPPED in tracker.parents else tracker.parent, **places}
    found = []
    for name, folder in places.items():
        if (folder / METRICS).exists():
            is_shipped = SHIPPED in folder.parents
            curve = read_curve(folder / METRICS, f"{name} (shipped): its last training" if is_shipped else name)
            if any(len(points) >= LEAST_POINTS for points in curve.series.values()):
                found.append(curve)
    return tuple(found)


def _trained_eyes(run: Run, learned: Path) -> Path:
    """Where the perception of a policy was trained: in a stage of its own, of which the policy's has a copy alone."""
    eyes, stage = beside(learned, keys.PERCEPTION), learned.parent
    shared = eyes.parent == stage and keys.is_complete(stage)  # not the policy's alone, which it learned by itself
    trained = read_stage(stage).header["reads"].get(keys.PERCEPTION) if shared else None
    place = run.workdir / run.recipe.task / keys.PERCEPTION / Path(str(trained)).name
    return place if (place / METRICS).exists() else eyes


def _judged(run: Run, rows: Sequence[EpisodeRow]) -> dict[str, list[EpisodeRow]]:
    """The rows of every policy, by what it is called on the command line."""
    found = {}
    for name in run.recipe.evaluate.policy:
        called = who_of(run, name).name
        if of_one := [row for row in rows if row.policy == called and row.stage == "imitate"]:
            found[name] = of_one
    return found


def showcase(run: Run, done: RobotMotion, clips: Clips, policy: str) -> Showcase:
    """One of the policy's episodes through all stages: `done` is what the policy did."""
    motion = next(m for m in clips.set.motions if m.id == done.reference_id)
    one = replace(clips.set, motions=[motion])
    does = f"{who_of(run, policy).name} does it from its own senses, without a reference."
    shown = (
        Clip("Human", "The reference, made on this object.", HumanMotion.load(clips.human / f"{motion.id}.npz")),
        Clip("Retargeted", "The same motion on the robot, before physics.", motion),
        *_tracked(run, one),
        Clip("Policy", does, done),
    )
    return Showcase(clips.set.objects[motion.object_id], run.robot.name, shown)


def _tracked(run: Run, one: ClipSet) -> list[Clip]:
    folder = keys.tracker_folder(run)
    if folder is None:
        return []
    config = RolloutConfig(record=True, settle=None)
    tracked = track_clips(load_tracker(folder, run.robot), one, config, env_config(run)).recording
    recording = Recording(tracked.qpos[0], 1 / CONTROL_DT, one.motions[0].wrist_goal_w)
    return [Clip("Tracked", "The tracker follows it under physics.", recording)]
