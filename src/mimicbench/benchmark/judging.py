"""Judging a recipe's tracker and policies: rows in files that say whose they are, made anew where that has changed."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mimicbench.benchmark import keys
from mimicbench.benchmark.finding import stages_of
from mimicbench.benchmark.graph import Clips, env_config, retargeted
from mimicbench.benchmark.kept import as_motion, forget, keep, kept, worth_keeping
from mimicbench.benchmark.keys import Run
from mimicbench.benchmark.shipped import SHIPPED
from mimicbench.benchmark.who import Who, who_of
from mimicbench.core.errors import BadFile, BadMotion, MimicbenchError
from mimicbench.core.names import typed
from mimicbench.core.stage import read_stage

if TYPE_CHECKING:
    import numpy as np

    from mimicbench.core.motion import RobotMotion
    from mimicbench.envs.clips import ClipSet
    from mimicbench.envs.policy import Policy
    from mimicbench.evaluate.rollout import Protocol
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
    if made and wanted < (there := _made_before(run)) <= 2 * wanted:
        wanted = there  # what was made for another policy's episodes is not looked through again
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
    clips = retargeted(run if wanted is None else _for_episodes(run, wanted))
    return replace(clips, set=clips.split(run.recipe.evaluate.split))


def _for_episodes(run: Run, count: int) -> Run:
    """With human clips that are the same for everybody, whoever was learned from."""
    return run.changed(references=replace(run.part("references"), count=count, test_only=True, alike=False))


def _made_before(run: Run) -> int:
    """How many human clips there are for episodes on test objects."""
    with suppress(BadFile):
        return read_stage(run.folder(keys.reference_key(_for_episodes(run, 1)))).header["amounts"]["count"]
    return 0


def judge(run: Run, name: str, protocol: Protocol | None = None) -> list[EpisodeRow]:
    """One row per episode of a policy, or per clip of a tracker: from the file if they are there, of the very same
    networks, clips and protocol; else made and kept, batch by batch, so that who is stopped goes on after the last.
    """
    from mimicbench.evaluate.rollout import Protocol
    from mimicbench.evaluate.rows import read_rows, rows_made_from, write_rows

    protocol, who, config = protocol or Protocol(), who_of(run, name), run.recipe.evaluate
    count = config.tracked if who.is_tracker else config.episodes
    _warn_of_other_task(run, who)
    _tell_of_others(run, who, name)
    policy = None if who.is_tracker else _loaded(run, who)  # which had better fail before clips are made for it
    clips = episodes_of(run, count)
    source = _source(run, who, clips, protocol)
    path = rows_path(run, who, source)
    there = rows_made_from(path).get("episodes", 0) if path.exists() else 0
    rows: list[EpisodeRow] = []
    if not who.is_program:  # whose other files may have changed: they are judged each time
        try:
            rows = read_rows(path) if there else []
        except BadFile:
            there = 0  # damaged
    if (failed := next((row.episode for row in rows if row.error), count)) < count:
        # a machine that was too busy, a GPU that was full: what failed is tried again, from its batch on
        rows = rows[: failed // protocol.batch * protocol.batch]
        there = len(rows) if there <= count else there
    if there == count and rows:
        return rows
    # those of a smaller batch may round differently, and are no part of more episodes
    rows = rows[: min(there, count) // protocol.batch * protocol.batch]
    if rows:
        run.context.say(f"the first {len(rows)} episodes of {who.name} are judged already")
    positions: dict[int, np.ndarray] = {}
    for some, recorded in batches_judged(run, who, clips.set, protocol, len(rows), policy):
        rows, positions = rows + some, positions | recorded
        # each batch as it comes, for the next may take half an hour; fewer never take the place of more, whoever it is
        if there < len(rows) or (who.is_program and there == len(rows) == count):
            if positions:
                forget(path.with_suffix(""))
            write_rows(path, rows, {**source, "episodes": len(rows)})
            if positions:
                keep(path.with_suffix(""), rows, positions, clips.set)
    _tell_of_errors(run, who, rows)
    return rows


def episodes_to_show(
    run: Run, name: str, clips: Clips, rows: Sequence[EpisodeRow]
) -> list[tuple[EpisodeRow, RobotMotion]]:
    """The motions of the first of a policy's best episodes and of some that failed, in this order.

    As they were kept when its rows were made; else its first batch runs again, exactly as it was judged.
    """
    from mimicbench.evaluate.rollout import Protocol
    from mimicbench.evaluate.rows import rows_made_from

    who, protocol = who_of(run, name), Protocol()
    path = rows_path(run, who, _source(run, who, clips, protocol))
    folder, of_batch = path.with_suffix(""), [row for row in rows if row.episode < protocol.batch]
    # what is kept of a program may be of another run than these rows, if that had more episodes
    is_of_these = not who.is_program or rows_made_from(path).get("episodes") == len(rows)
    if is_of_these:
        with suppress(BadFile, BadMotion):
            return kept(folder, of_batch)
    run.context.say(f"{len(of_batch)} episodes of {who.name} run once more, to be drawn")
    ((_, positions),) = batches_judged(run, who, clips.set.first(len(of_batch)), protocol)
    if is_of_these:
        keep(folder, of_batch, positions, clips.set)
        return kept(folder, of_batch)
    there = [row for row in of_batch if row.episode in positions]
    return [(row, as_motion(row, positions[row.episode], clips.set)) for row in worth_keeping(there)]


def rows_path(run: Run, who: Who, source: dict[str, Any]) -> Path:
    """`<workdir>/<task>/evaluate/<name>-<digest>.parquet`."""
    digest = hashlib.blake2b(json.dumps(source, sort_keys=True).encode(), digest_size=4).hexdigest()
    return run.workdir / run.recipe.task / "evaluate" / f"{who.name}-{digest}.parquet"


def _source(run: Run, who: Who, clips: Clips, protocol: Protocol) -> dict[str, Any]:
    """What rows are made from: everything that can change them, but their number."""
    import mujoco

    import mimicbench

    return {
        **who.digests,
        "clips": clips.stage.digest,
        "split": run.recipe.evaluate.split,
        "protocol": {"batch": protocol.batch, "time_limit": run.task.time_limit},
        "seed": run.recipe.seed,
        "device": run.context.device,
        "mimicbench": mimicbench.__version__,
        "mujoco": mujoco.__version__,
    }


Batch = tuple[list["EpisodeRow"], dict[int, "np.ndarray"]]
"""One row per episode, and simulator positions (T, nq) of those that were recorded, by number."""


def batches_judged(
    run: Run, who: Who, clips: ClipSet, protocol: Protocol, first: int = 0, policy: Policy | None = None
) -> Iterator[Batch]:
    """What comes of the clips from the `first` on, in batches of the protocol's size, each as soon as it is over.

    A tracker follows its clips from their first frames, and goes on to the time limit; a policy is given these frames
    alone, and the episodes of its very first batch are recorded. `policy` is the one that `who` means, if it is there
    already.
    """
    _one_thread()
    if who.is_tracker:
        yield from _tracker_batches(run, who, clips, protocol, first)
    else:
        yield from _policy_batches(run, who, clips, protocol, first, policy or _loaded(run, who))


def _tracker_batches(run: Run, who: Who, clips: ClipSet, protocol: Protocol, first: int) -> Iterator[Batch]:
    from mimicbench.evaluate.rollout import Judged, tracker_rows
    from mimicbench.track.checkpoint import load_tracker
    from mimicbench.track.rollout import RolloutConfig, track_clips
    from mimicbench.track.settings import TrackConfig

    tracker = load_tracker(who.folder, run.robot)
    if not run.context.quiet:
        run.context.say(f"evaluating {who.name}, {len(clips) - first} clips")
    # all that are learned here are called `tracker`, but one of another design than ours is another method
    another = who.name == keys.TRACKER and tracker.spec.name != TrackConfig.tracker
    name = tracker.spec.name if another else who.name
    judged = Judged("track", name, tracker.spec.gains, run.recipe.seed)
    # as many side by side as of policies, for last bits depend on that
    for begun, part in _in_batches(clips, first, protocol.batch):
        of_part = track_clips(tracker, part, RolloutConfig(settle=None), env_config(run))
        yield tracker_rows([of_part], part, judged, begun), {}


def _in_batches(clips: ClipSet, first: int, size: int) -> Iterator[tuple[int, ClipSet]]:
    """Batches from the `first` on, a multiple of their size: the number of each one's first clip, and its clips."""
    for number, part in enumerate(clips.batches(size)):
        if number * size >= first:
            yield number * size, part


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
    if name != who.name or SHIPPED not in who.folder.parents:
        return
    stage, network = ("track", keys.CHECKPOINT) if who.is_tracker else ("imitate", keys.POLICY)
    found = [one.folder for one in stages_of(run.workdir, task, stage)]
    if others := [one for one in found if who.is_tracker or one.name.rpartition("-")[0] == name]:
        run.context.say(
            f"judging the shipped {name}; {others[0]} is of other settings: to judge it, give --policy "
            f"{typed(others[0] / network)}"
        )


def _policy_batches(
    run: Run, who: Who, clips: ClipSet, protocol: Protocol, first: int, policy: Policy
) -> Iterator[Batch]:
    from mimicbench.core.progress import counter
    from mimicbench.evaluate.rollout import Judged, policy_rows, run_policy

    parts = list(_in_batches(clips, first, protocol.batch))
    label = f"evaluating {who.name}, {len(clips) - first} episodes, seconds"
    judged = Judged("imitate", who.name, policy.gains, run.recipe.seed)
    with counter(len(parts) * int(run.task.time_limit), label, run.context.quiet) as tick:
        for begun, part in parts:
            record = () if begun else range(len(part))
            runs = run_policy(policy, part, protocol, record, tick, env_config(run))
            yield policy_rows(runs, part, judged, begun), runs[0].recordings


def _tell_of_errors(run: Run, who: Who, rows: Sequence[EpisodeRow]) -> None:
    wrong = [row for row in rows if row.error]
    if 0 < len(wrong) < len(rows):  # of all, it is said in the end
        run.context.say(f"{who.name} failed in {len(wrong)} of {len(rows)} episodes: {wrong[0].error}")


def _one_thread() -> None:
    """Networks judge with one thread, whatever `workers` says: sums round differently on more."""
    import torch

    torch.set_num_threads(1)
