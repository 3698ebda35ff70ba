"""What a whole run is made of: from nothing, or from the shipped checkpoints, to a report."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mimicbench.core.motion import HumanMotion, RobotMotion
from mimicbench.objects.make import ObjectsConfig
from mimicbench.references.make import ReferencesConfig
from mimicbench.retarget.make import RetargetConfig
from mimicbench.retarget.mapping import Preset
from mimicbench.retarget.registry import METHODS
from mimicbench.workspace import (
    Say,
    Workspace,
    compared_stages,
    env_config,
    evaluate_policy,
    evaluate_tracker,
    imitate_stage,
    objects_stage,
    policy_folder,
    references_stage,
    retarget_stage,
    track_stage,
    tracker_folder,
)

if TYPE_CHECKING:  # these bring torch, which help does without
    from mimicbench.evaluate.rows import EpisodeRow
    from mimicbench.imitate.make import ImitateConfig
    from mimicbench.report.retargeting import Comparison
    from mimicbench.report.showcase import Showcase
    from mimicbench.track.train import TrackConfig


@dataclass(frozen=True)
class Profile:
    """How large a run is."""

    objects: int
    """Objects to make; a quarter are of the test split."""
    clips: int
    """Human clips to make."""
    tracked: int
    """Clips that the tracker is judged on."""
    episodes: int
    """Episodes that each policy is judged on."""
    policies: tuple[str, ...]
    """Which policies; the first is shown in pictures."""


PROFILES = {
    "smoke": Profile(objects=16, clips=16, tracked=16, episodes=16, policies=("planner",)),
    "default": Profile(
        objects=120, clips=128, tracked=128, episodes=128, policies=("planner", "act-clock", "bc-clock")
    ),
    "full": Profile(
        objects=400, clips=2000, tracked=256, episodes=400, policies=("planner", "act", "bc", "act-clock", "bc-clock")
    ),
}


def run_shipped(ws: Workspace, profile: Profile, say: Say) -> tuple[Path, list[EpisodeRow]]:
    """New objects and clips, retargeted, tracked and done by the shipped policies: no training.

    Returns the report's page and its rows.
    """
    objects_stage(ws, ObjectsConfig(profile.objects))
    references_stage(ws, ReferencesConfig(profile.clips, test_only=True))
    retarget_stage(ws, RetargetConfig())
    return judge_and_report(ws, profile, say)


def run_training(
    ws: Workspace, profile: Profile, track: TrackConfig, imitate: ImitateConfig, say: Say
) -> tuple[Path, list[EpisodeRow]]:
    """Everything from nothing: objects, clips, tracker, demonstrations, policies, report."""
    objects_stage(ws, ObjectsConfig(profile.objects))
    references_stage(ws, ReferencesConfig(profile.clips))
    retarget_stage(ws, RetargetConfig())
    track_stage(ws, track, say)
    for policy in profile.policies:
        say(f"learning {policy}")
        imitate_stage(ws, policy, imitate, say)
    return judge_and_report(ws, profile, say)


def judge_and_report(ws: Workspace, profile: Profile, say: Say) -> tuple[Path, list[EpisodeRow]]:
    """Judge tracker and policies on the test split and write the report. What is judged already is not run again."""
    tracker = tracker_folder(ws)
    rows = list(
        evaluated_rows(
            ws, "tracker", tracker, profile.tracked, lambda: evaluate_tracker(ws, tracker, profile.tracked, "test")
        )
    )
    for policy in profile.policies:
        folder = policy_folder(ws, policy)
        rows += evaluated_rows(
            ws, policy, folder, profile.episodes, lambda policy=policy: evaluate_policy(ws, policy, profile.episodes)[0]
        )
    return report_stage(ws, rows, profile.policies[0], say), rows


def evaluated_rows(
    ws: Workspace, name: str, checkpoint: Path, episodes: int, run: Callable[[], list[EpisodeRow]]
) -> list[EpisodeRow]:
    """The rows of `<evaluate>/<name>.parquet`.

    Made by `run` unless they are there and of this very checkpoint, clips and number.
    """
    from mimicbench.core.checkpoint import MODEL
    from mimicbench.core.files import read_json, write_json
    from mimicbench.evaluate.rows import read_rows, write_rows

    path, source = ws.folder("evaluate") / f"{name}.parquet", ws.folder("evaluate") / f"{name}.json"
    model = hashlib.blake2b((checkpoint / MODEL).read_bytes(), digest_size=8).hexdigest()
    made_from = {
        "checkpoint": model,
        "retarget": ws.finished("retarget").fingerprint,
        "episodes": episodes,
        "seed": ws.seed,
        "device": ws.device,
    }
    if path.exists() and source.exists() and read_json(source) == made_from:
        return read_rows(path)
    rows = run()
    write_rows(path, rows)
    write_json(source, made_from)
    return rows


def report_stage(ws: Workspace, rows: Sequence[EpisodeRow], policy: str, say: Say) -> Path:
    """Write the report on these rows, with one chair shown from the human to the policy."""
    from mimicbench.report.curves import read_curve
    from mimicbench.report.provenance import Provenance, package_versions, this_machine
    from mimicbench.report.write import ReportInputs, write_report

    made_from, config = {}, {}
    for stage in ("objects", "references", "retarget"):
        finished = ws.finished(stage)
        made_from[stage], config[stage] = (
            finished.fingerprint,
            {**finished.header["config"], **finished.header["summary"]},
        )
    curves = [
        read_curve(path, name)
        for name in ("track", "imitate/planner")
        if (path := ws.folder(name) / "metrics.jsonl").exists()
    ]
    provenance = Provenance(
        ws.seed, (" ".join(["mimicbench", *sys.argv[1:]]),), config, made_from, package_versions(), this_machine()
    )
    inputs = ReportInputs(ws.slug, tuple(rows), provenance, tuple(curves), showcase(ws, rows, policy))
    return write_report(ws.folder("report"), inputs, say, ws.workers, ws.quiet)


def compare_retargeting(
    workdir: Path,
    tasks: Sequence[str],
    clips: int,
    preset: Preset,
    folder: Path,
    pictures: bool,
    seed: int,
    workers: int,
    quiet: bool,
    say: Say,
) -> Comparison:
    """The first `clips` clips of each task by every method, with a page in `folder`."""
    from mimicbench.report.retargeting import Comparison, MethodResult, SideBySide, draw_side_by_side, write_comparison
    from mimicbench.retarget.baselines.speed import frames_per_second
    from mimicbench.retarget.clip import Clip
    from mimicbench.sensors.opengl import NoPictures, draw_apart

    results, sides = [], {}
    configs = [
        RetargetConfig(method=method.name, preset=preset if preset in method.presets else None)
        for method in METHODS.all()
    ]
    for slug in tasks:
        ws = Workspace(workdir, slug, seed, workers, quiet)
        stages = compared_stages(ws, configs, clips)
        name = sorted(path.name for path in stages[0].folder.glob("*.npz"))[0]
        human = HumanMotion.load(ws.folder("references") / name)
        obj = ws.objects()[human.object_id]
        shown = {}
        for stage in stages:
            method, used = METHODS.get(stage.header["config"]["method"]), stage.header["config"]["preset"]
            rate = frames_per_second([Clip(human, obj, ws.robot)], method, used)
            results.append(MethodResult(slug, method.name, used, stage.header["summary"], rate))
            shown[f"{method.title} ({used})"] = RobotMotion.load(stage.folder / name, ws.robot.name)
        sides[slug] = SideBySide(obj, human, shown)
    drawn = {}
    if pictures:
        try:
            drawn = dict(
                zip(sides, draw_apart(draw_side_by_side, list(sides.values()), workers, "drawing", quiet), strict=True)
            )
        except NoPictures as error:
            say(str(error))
    found = Comparison(tuple(results))
    write_comparison(folder, found, {slug: (sides[slug].caption(), picture) for slug, picture in drawn.items()})
    return found


def showcase(ws: Workspace, rows: Sequence[EpisodeRow], policy: str) -> Showcase:
    """One clip of the test split through all stages: the first of the first batch on which the policy succeeded, or
    the very first.
    """
    from mimicbench.envs.clips import ClipSet
    from mimicbench.evaluate.rollout import Protocol
    from mimicbench.report.showcase import Clip, Recording, Showcase
    from mimicbench.sim.scene import CONTROL_DT
    from mimicbench.track.checkpoint import load_tracker
    from mimicbench.track.rollout import RolloutConfig, track_clips

    folder = policy_folder(ws, policy)
    of_policy = [row for row in rows if row.policy == folder.name]
    chosen = next((row for row in of_policy[: Protocol().batch] if row.success), of_policy[0])
    motion = next(m for m in ws.motions("test") if m.id == chosen.reference_id)
    obj = ws.objects()[motion.object_id]
    human = HumanMotion.load(ws.folder("references") / f"{motion.id}.npz")
    tracker = load_tracker(tracker_folder(ws), ws.robot)
    clips = ClipSet(ws.task, ws.robot, [motion], {obj.id: obj})
    tracked = track_clips(tracker, clips, RolloutConfig(record=True, settle=None), env_config(ws))
    # the whole first batch again, so that the episode runs exactly as it was judged
    _, recordings = evaluate_policy(ws, policy, min(len(of_policy), Protocol().batch), [chosen.episode])
    fps = 1 / CONTROL_DT
    clips = (
        Clip("Human", "The reference, made on this object.", human),
        Clip("Retargeted", "The same motion on the H1, before physics.", motion),
        Clip(
            "Tracked",
            "The tracker follows it under physics.",
            Recording(tracked.recording.qpos[0], fps, motion.wrist_goal_w),
        ),
        Clip(
            "Policy",
            f"{folder.name} does it from its own senses, without a reference.",
            Recording(recordings[chosen.episode], fps, motion.wrist_goal_w),
        ),
    )
    return Showcase(obj, ws.robot.name, clips)
