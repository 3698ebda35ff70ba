"""Judging a recipe's tracker and policies: rows in files that say whose they are, made anew where that has changed."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mimicbench.benchmark import keys
from mimicbench.benchmark.finding import stages_of
from mimicbench.benchmark.graph import Clips, env_config, retargeted
from mimicbench.benchmark.kept import as_motion, forget, keep, kept, worth_keeping
from mimicbench.benchmark.keys import Run
from mimicbench.benchmark.shipped import shipped
from mimicbench.benchmark.who import Who, who_of
from mimicbench.core.errors import BadFile, BadMotion, MimicbenchError
from mimicbench.core.names import typed

if TYPE_CHECKING:
    import numpy as np

    from mimicbench.core.motion import RobotMotion
    from mimicbench.envs.clips import ClipSet
    from mimicbench.envs.policy import Policy
    from mimicbench.evaluate.rows import EpisodeRow

TRIES = 4
"""Times that more clips are made because K left too many out."""


def episodes_of(run: Run, count: int) -> Clips:
    """The clips whose starts, objects and goals the episodes have: as many as wanted, on the objects of a split.

    For the test split they are clips of their own that nothing was trained on, the same for every learner: more are
    made until there are enough. Raises MimicbenchError if an imported set, or a training set, has fewer.
    """
    split = run.recipe.evaluate.split
    made = run.set_name("references") is None and split == "test"
    wanted = count + count // 20 + 2  # some more, for K may leave out a few
    found = _of_split(run, wanted if made else None)
    for _ in range(TRIES if made else 0):
        if len(found.set) >= count:
            break
        wanted += 2 * (count - len(found.set))
        found = _of_split(run, wanted)
    if len(found.set) >= count:
        return replace(found, set=found.set.first(count))
    more = "make more clips (--references.count)" if run.set_name("references") is None else "import more"
    other = "" if split == "all" else " take another split (--split all),"
    raise MimicbenchError(
        f"{found.stage.folder} has {len(found.set)} clips of the split {split!r} that fulfil K, not {count}; "
        f"ask for fewer (--episodes of policies, --tracked of trackers),{other} or {more}"
    )


def _of_split(run: Run, wanted: int | None) -> Clips:
    """The recipe's clips on objects of the split; or so many human clips, retargeted, on test objects alone."""
    if wanted is not None:
        # episodes are the same for everybody, whoever was learned from
        run = run.changed(references=replace(run.part("references"), count=wanted, test_only=True, alike=False))
    clips = retargeted(run)
    return replace(clips, set=clips.split(run.recipe.evaluate.split))


def judge(run: Run, name: str) -> list[EpisodeRow]:
    """One row per episode of a policy, or per clip of a tracker: from the file if they are there, of the very same
    networks, clips and protocol; else made and kept.
    """
    from mimicbench.evaluate.rows import read_rows, rows_made_from, write_rows

    who, config = who_of(run, name), run.recipe.evaluate
    count = config.tracked if who.is_tracker else config.episodes
    _warn_of_other_task(run, who)
    _tell_of_others(run, who, name)
    policy = None if who.is_tracker else _loaded(run, who)  # which had better fail before clips are made for it
    clips = episodes_of(run, count)
    source = _source(run, who, clips)
    path = rows_path(run, who, source)
    there = rows_made_from(path).get("episodes", 0) if path.exists() else 0
    if there == count and not who.is_program:
        try:
            return read_rows(path)
        except BadFile:
            there = 0  # damaged
    if who.is_tracker:
        rows, positions = judge_tracker(run, who, clips.set), dict[int, "np.ndarray"]()
    else:
        rows, positions = judge_policy(run, who, clips.set, _first_batch(count), policy)
    # the last, smaller batch of fewer may round differently, and is not kept; programs, whose other files may have
    # changed, are judged each time, and fewer of their episodes do not take the place of more either
    if there < count or (who.is_program and there == count):
        forget(path.with_suffix(""))
        write_rows(path, rows, {**source, "episodes": count})
        if positions:
            keep(path.with_suffix(""), rows, positions, clips.set)
    return rows


def episodes_to_show(
    run: Run, name: str, clips: Clips, rows: Sequence[EpisodeRow]
) -> list[tuple[EpisodeRow, RobotMotion]]:
    """The motions of the first of a policy's best episodes and of some that failed, in this order.

    As they were kept when its rows were made; else its first batch runs again, exactly as it was judged.
    """
    who = who_of(run, name)
    from mimicbench.evaluate.rows import rows_made_from

    path = rows_path(run, who, _source(run, who, clips))
    folder, first = path.with_suffix(""), _first_batch(len(rows))
    of_batch = [row for row in rows if row.episode in first]
    # what is kept of a program may be of another run than these rows, if that had more episodes
    is_of_these = not who.is_program or rows_made_from(path).get("episodes") == len(rows)
    if is_of_these:
        with suppress(BadFile, BadMotion):
            return kept(folder, of_batch)
    run.context.say(f"{len(of_batch)} episodes of {who.name} run once more, to be drawn")
    positions = judge_policy(run, who, clips.set.first(len(of_batch)), first)[1]
    if is_of_these:
        keep(folder, of_batch, positions, clips.set)
        return kept(folder, of_batch)
    there = [row for row in of_batch if row.episode in positions]
    return [(row, as_motion(row, positions[row.episode], clips.set)) for row in worth_keeping(there)]


def _first_batch(count: int) -> range:
    from mimicbench.evaluate.rollout import Protocol

    return range(min(count, Protocol().batch))


def rows_path(run: Run, who: Who, source: dict[str, Any]) -> Path:
    """`<workdir>/<task>/evaluate/<name>-<digest>.parquet`."""
    digest = hashlib.blake2b(json.dumps(source, sort_keys=True).encode(), digest_size=4).hexdigest()
    return run.workdir / run.recipe.task / "evaluate" / f"{who.name}-{digest}.parquet"


def _source(run: Run, who: Who, clips: Clips) -> dict[str, Any]:
    """What rows are made from: everything that can change them, but their number."""
    import mujoco

    import mimicbench
    from mimicbench.evaluate.rollout import Protocol

    return {
        **who.digests,
        "clips": clips.stage.digest,
        "split": run.recipe.evaluate.split,
        "protocol": {"batch": Protocol().batch, "time_limit": run.task.time_limit},
        "seed": run.recipe.seed,
        "device": run.context.device,
        "mimicbench": mimicbench.__version__,
        "mujoco": mujoco.__version__,
    }


def judge_tracker(run: Run, who: Who, clips: ClipSet) -> list[EpisodeRow]:
    """One row per clip: the tracker follows it from its first frame, and goes on to the time limit."""
    from mimicbench.evaluate.rollout import Judged, Protocol, tracker_rows
    from mimicbench.track.checkpoint import load_tracker
    from mimicbench.track.rollout import RolloutConfig, track_clips
    from mimicbench.track.settings import TrackConfig

    _one_thread()
    tracker = load_tracker(who.folder, run.robot)
    if not run.context.quiet:
        run.context.say(f"evaluating {who.name}, {len(clips)} clips")
    # as many side by side as of policies, for last bits depend on that
    parts, config = clips.batches(Protocol().batch), RolloutConfig(settle=None)
    runs = [track_clips(tracker, part, config, env_config(run)) for part in parts]
    # all that are learned here are called `tracker`, but one of another design than ours is another method
    another = who.name == keys.TRACKER and tracker.spec.name != TrackConfig.tracker
    name = tracker.spec.name if another else who.name
    return tracker_rows(runs, clips, Judged("track", name, tracker.spec.gains, run.recipe.seed))


def _loaded(run: Run, who: Who) -> Policy:
    """The policy, to be judged at the recipe's task. Raises BadFile if it does not fit that."""
    from mimicbench.policies.loading import load_policy

    return load_policy(who.folder, run.robot, run.task)


def _warn_of_other_task(run: Run, who: Who) -> None:
    """Say if a policy or tracker was learned at other tasks than it is judged at: it may well fit, and fail there."""
    if who.tasks and run.recipe.task not in who.tasks:
        learned = " and ".join(who.tasks)
        run.context.say(f"warning: {who.name} was learned at {learned}, and is judged at {run.recipe.task}")


def _tell_of_others(run: Run, who: Who, name: str) -> None:
    """Say if what is shipped is judged by a name by which the workdir has some, of other recipes."""
    task = run.recipe.task
    if who.is_tracker or name != who.name or who.folder != shipped(run.recipe.robot, task, name):
        return
    stages = stages_of(run.workdir, task, "imitate")
    if others := [one.folder for one in stages if one.folder.name.rpartition("-")[0] == name]:
        run.context.say(
            f"judging the shipped {name}; {others[0]} is of other settings: to judge it, give --policy "
            f"{typed(others[0] / keys.POLICY)}"
        )


def judge_policy(
    run: Run, who: Who, clips: ClipSet, record: Sequence[int] = (), policy: Policy | None = None
) -> tuple[list[EpisodeRow], dict[int, np.ndarray]]:
    """One row per episode, from the first frames of the clips alone, and the positions of the episodes in `record`.

    `policy` is the one that `who` means, if it is there already.
    """
    from mimicbench.core.progress import counter
    from mimicbench.evaluate.rollout import Judged, Protocol, policy_rows, run_policy

    _one_thread()
    policy = policy or _loaded(run, who)
    protocol = Protocol()
    seconds = math.ceil(len(clips) / protocol.batch) * int(run.task.time_limit)
    label = f"evaluating {who.name}, {len(clips)} episodes, seconds"
    with counter(seconds, label, run.context.quiet) as tick:
        runs = run_policy(policy, clips, protocol, record, tick, env_config(run))
    rows = policy_rows(runs, clips, Judged("imitate", who.name, policy.gains, run.recipe.seed))
    wrong = [row for row in rows if row.error]
    if 0 < len(wrong) < len(rows):  # of all, it is said in the end
        run.context.say(f"{who.name} failed in {len(wrong)} of {len(rows)} episodes: {wrong[0].error}")
    recordings = {}
    for number, one in enumerate(runs):
        recordings |= {number * protocol.batch + episode: track for episode, track in one.recordings.items()}
    return rows, recordings


def _one_thread() -> None:
    """Networks judge with one thread, whatever `workers` says: sums round differently on more."""
    import torch

    torch.set_num_threads(1)
