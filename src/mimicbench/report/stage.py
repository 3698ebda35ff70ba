"""Stage `report`: the page about a recipe's rows, with one episode shown from the human to the policy."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from mimicbench.benchmark import keys
from mimicbench.benchmark.graph import Clips, env_config
from mimicbench.benchmark.judging import episodes_of, judge_policy, who_of
from mimicbench.benchmark.keys import Run
from mimicbench.core.files import remove_unfinished
from mimicbench.core.motion import HumanMotion, RobotMotion
from mimicbench.core.stage import locked, read_stage
from mimicbench.envs.clips import ClipSet
from mimicbench.evaluate.rollout import Protocol
from mimicbench.evaluate.rows import EpisodeRow
from mimicbench.report.curves import Curve, read_curve
from mimicbench.report.provenance import Provenance, package_versions, this_machine
from mimicbench.report.showcase import Clip, Recording, Showcase
from mimicbench.report.write import ReportInputs, write_report
from mimicbench.sim.scene import CONTROL_DT
from mimicbench.track.checkpoint import load_tracker
from mimicbench.track.rollout import RolloutConfig, track_clips


def report(run: Run, rows: Sequence[EpisodeRow], policy: str) -> Path:
    """Write the report on these rows; `policy` is shown in pictures. Returns the page."""
    folder = run.workdir / run.recipe.task / "report"
    folder.mkdir(parents=True, exist_ok=True)
    with locked(folder):
        remove_unfinished(folder)
        name = who_of(run, policy).name
        of_policy = [row for row in rows if row.policy == name and row.stage == "imitate"]
        clips = episodes_of(run, len(of_policy))
        inputs = ReportInputs(
            run.recipe.task,
            tuple(rows),
            _provenance(run, clips),
            clips.set.objects,
            _curves(run, policy),
            showcase(run, of_policy, clips, policy),
        )
        return write_report(folder, inputs, run.context.say, run.context.workers, run.context.quiet)


def _provenance(run: Run, clips: Clips) -> Provenance:
    stages = {"references": read_stage(clips.human), "retarget": clips.stage}
    objects = run.workdir / run.recipe.task / stages["retarget"].header["reads"]["objects"]
    stages = {"objects": read_stage(objects), **stages}
    command = shlex.join(["mimicbench", *sys.argv[1:]])
    return Provenance(
        run.recipe.seed,
        (command,),
        {name: {**stage.header["settings"], **stage.summary} for name, stage in stages.items()},
        {name: stage.fingerprint for name, stage in stages.items()},
        package_versions(),
        this_machine(),
    )


def _curves(run: Run, policy: str) -> tuple[Curve, ...]:
    """Learning curves of what was learned here."""
    tracker = keys.tracker_folder(run)
    places = {"track": tracker and tracker.parent, f"imitate/{policy}": who_of(run, policy).folder}
    files = {name: place / "metrics.jsonl" for name, place in places.items() if place is not None}
    return tuple(
        read_curve(path, name) for name, path in files.items() if path.exists() and keys.SHIPPED not in path.parents
    )


def showcase(run: Run, rows: Sequence[EpisodeRow], clips: Clips, policy: str) -> Showcase:
    """One of the policy's episodes through all stages: the first of the first batch in which it stays; else, succeeds;
    else, the very first.
    """
    who, batch = who_of(run, policy), Protocol().batch
    chosen = max(rows[:batch], key=lambda row: (row.stays, row.success))  # the first of the best
    motion = next(m for m in clips.set.motions if m.id == chosen.reference_id)
    one = replace(clips.set, motions=[motion])
    # the whole first batch again, so that the episode runs exactly as it was judged
    seen = judge_policy(run, who, clips.set.first(batch), [chosen.episode])[1][chosen.episode]
    shown = (
        Clip("Human", "The reference, made on this object.", HumanMotion.load(clips.human / f"{motion.id}.npz")),
        Clip("Retargeted", "The same motion on the robot, before physics.", motion),
        *_tracked(run, one),
        Clip("Policy", f"{who.name} does it from its own senses, without a reference.", _recording(seen, motion)),
    )
    return Showcase(clips.set.objects[motion.object_id], run.robot.name, shown)


def _tracked(run: Run, one: ClipSet) -> list[Clip]:
    folder = keys.tracker_folder(run)
    if folder is None:
        return []
    config = RolloutConfig(record=True, settle=None)
    tracked = track_clips(load_tracker(folder, run.robot), one, config, env_config(run)).recording
    recording = _recording(tracked.qpos[0], one.motions[0])
    return [Clip("Tracked", "The tracker follows it under physics.", recording)]


def _recording(qpos: np.ndarray, motion: RobotMotion) -> Recording:
    return Recording(qpos, 1 / CONTROL_DT, motion.wrist_goal_w)
