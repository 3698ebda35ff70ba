"""Judging a recipe's tracker and policies: rows in files that say whose they are, made anew where that has changed."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mimicbench.benchmark import keys
from mimicbench.benchmark.graph import Clips, env_config, retargeted
from mimicbench.benchmark.kept import keep, kept
from mimicbench.benchmark.keys import Run
from mimicbench.benchmark.recipe import Recipe, stage_type
from mimicbench.benchmark.shipped import best_shipped, shipped, shipped_for, shipped_names, shipped_trackers
from mimicbench.core.checkpoint import CONFIG, MODEL, checkpoint_kind, checkpoint_task, used_by
from mimicbench.core.errors import BadFile, BadMotion, MimicbenchError, UnknownName
from mimicbench.core.files import digest_of
from mimicbench.core.settings import identity
from mimicbench.imitate.registry import LEARNERS

if TYPE_CHECKING:
    import numpy as np

    from mimicbench.core.motion import RobotMotion
    from mimicbench.envs.clips import ClipSet
    from mimicbench.envs.policy import Policy
    from mimicbench.evaluate.rows import EpisodeRow

FILES = {".py": "a Python file with a function make_policy()", ".onnx": "an ONNX file"}
"""What policies of other people are, by the suffix of their files."""
ELSEWHERE = b"\x0a\x08location"
"""Of a tensor in an ONNX file: the name of the entry that says in which file it is."""
TRIES = 4
"""Times that more clips are made because K left too many out."""


@dataclass(frozen=True)
class Who:
    """A policy or tracker to judge."""

    name: str
    """As in rows and tables."""
    folder: Path
    """Of its checkpoint; or a Python or ONNX file."""

    @property
    def is_program(self) -> bool:
        """Whether it reads what nobody knows: a Python file, or an ONNX file whose weights are in others."""
        return self.folder.suffix == ".py" or (self.folder.suffix == ".onnx" and ELSEWHERE in self.folder.read_bytes())

    @property
    def is_tracker(self) -> bool:
        """Whether it follows clips, and is judged by how many."""
        return self.folder.suffix not in FILES and checkpoint_kind(self.folder) == keys.TRACKER

    @property
    def task(self) -> str:
        """The task at which it was learned, as far as it tells; else empty."""
        return "" if self.folder.suffix in FILES else checkpoint_task(self.folder)

    @property
    def digests(self) -> dict[str, str]:
        """Digests of the networks that it runs on: its own, and those in the folders beside it that it may use."""
        if self.folder.suffix in FILES:
            return {"program": digest_of(self.folder)}
        used = used_by(self.folder, (keys.TRACKER, keys.PERCEPTION))
        return {name: digest_of(folder / MODEL) + digest_of(folder / CONFIG) for name, folder in used.items()}


def who_of(run: Run, name: str) -> Who:
    """Whom the user means: `tracker`, `best`, a learner's name, another checkpoint that is shipped for the task, or the
    path of a checkpoint, a Python or an ONNX file.

    What this recipe has learned in this workdir comes before what is shipped. Nothing is made.

    Raises:
        UnknownName: There is no such learner.
        MimicbenchError: Nobody has learned that, here or for the package; the message has the command.
    """
    if Path(name).suffix in FILES:
        if not Path(name).is_file():
            raise BadFile(f"{name} does not exist; give the path of {FILES[Path(name).suffix]}")
        return Who(Path(name).stem, Path(name))
    if "/" in name or name.startswith("."):
        if not (Path(name) / CONFIG).exists():
            raise BadFile(f"{Path(name) / CONFIG} does not exist; give the folder of a checkpoint")
        return Who(Path(name).name, Path(name))
    tracker = keys.tracker_folder(run)
    if name == keys.TRACKER:
        if tracker is None:
            raise _nobody(run, "track", name, sorted(shipped_trackers(run.recipe.robot)))
        return Who(name, tracker)
    task, robot = run.recipe.task, run.recipe.robot
    if best := name == "best":
        name = best_shipped(robot, task) or next(iter(LEARNERS))
    if name not in LEARNERS and (other := shipped(robot, task, name)) is not None:
        return Who(name, other)
    try:
        config = stage_type("imitate", {"learner": name})()
    except UnknownName as error:
        if tasks := shipped_for(name):
            told = f"no {name} is shipped for {task} (only for {', '.join(tasks)}), and none is learned by that name"
            raise MimicbenchError(f"{told}; name another, or give the folder of a checkpoint") from None
        names = dict.fromkeys(["best", keys.TRACKER, *error.args[2], *shipped_names(task)])
        raise UnknownName("policy", name, list(names)) from None
    if not best and (tracker is not None or not config.references):
        if run.recipe.imitate is not None and run.recipe.imitate.learner == name:
            config = run.recipe.imitate
        own = run.folder(keys.imitate_key(run.changed(imitate=config), tracker if config.references else None))
        if keys.is_complete(own):
            return Who(name, own / keys.POLICY)
    if (there := shipped(robot, task, name)) is None:
        raise _nobody(run, f"imitate --learner {name}", name, shipped_for(name))
    return Who(name, there)


def _nobody(run: Run, command: str, name: str, tasks: Sequence[str]) -> MimicbenchError:
    task, robot = run.recipe.task, run.recipe.robot
    where = f"for {task} (only for {', '.join(tasks)})" if tasks else "for any task"
    told = "" if task in tasks else f"no {name} is shipped {where}, and "
    of = "" if robot == Recipe.robot else f" --robot {robot}"
    own = any(identity(run.part(stage)) != identity(stage_type(stage)()) for stage in ("retarget", "track", "demos"))
    return MimicbenchError(
        f"{told}no {name} was made by this recipe in {run.workdir}; make it with `mimicbench {command} --task {task}"
        f"{of} --workdir {run.workdir}`" + (", and the presets and settings that are given here" if own else "")
    )


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
    raise MimicbenchError(
        f"{found.stage.folder} has {len(found.set)} clips of the split {split!r} that fulfil K, not {count}; "
        "ask for fewer (--episodes of policies, --tracked of trackers), or make more clips (--references.count)"
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
    if there < count or who.is_program:  # the last, smaller batch of fewer may round differently, and is not kept
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
    folder = rows_path(run, who, _source(run, who, clips)).with_suffix("")
    first = _first_batch(len(rows))
    of_batch = [row for row in rows if row.episode in first]
    try:
        return kept(folder, of_batch)
    except (BadFile, BadMotion):
        run.context.say(f"{len(of_batch)} episodes of {who.name} run once more, to be drawn")
    positions = judge_policy(run, who, clips.set.first(len(of_batch)), first)[1]
    keep(folder, of_batch, positions, clips.set)
    return kept(folder, of_batch)


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
    from mimicbench.evaluate.rollout import Judged, tracker_rows
    from mimicbench.track.checkpoint import load_tracker
    from mimicbench.track.rollout import RolloutConfig, track_clips

    _one_thread()
    tracker = load_tracker(who.folder, run.robot)
    if not run.context.quiet:
        run.context.say(f"evaluating {who.name}, {len(clips)} clips")
    rollout = track_clips(tracker, clips, RolloutConfig(settle=None), env_config(run))
    return tracker_rows(rollout, clips, Judged("track", who.name, tracker.spec.gains, run.recipe.seed))


def _loaded(run: Run, who: Who) -> Policy:
    """The policy, to be judged at the recipe's task; it is told if it was learned at another."""
    from mimicbench.policies.loading import load_policy

    policy, learned_at = load_policy(who.folder, run.robot, run.task), who.task
    if learned_at not in ("", run.recipe.task):
        run.context.say(f"{who.name} was learned at {learned_at}, and is judged at {run.recipe.task}")
    return policy


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
    if wrong:
        run.context.say(f"{who.name} failed in {len(wrong)} of {len(rows)} episodes: {wrong[0].error}")
    recordings = {}
    for number, one in enumerate(runs):
        recordings |= {number * protocol.batch + episode: track for episode, track in one.recordings.items()}
    return rows, recordings


def _one_thread() -> None:
    """Networks judge with one thread, whatever `workers` says: sums round differently on more."""
    import torch

    torch.set_num_threads(1)
