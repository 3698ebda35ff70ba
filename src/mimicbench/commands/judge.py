"""`mimicbench evaluate`, `run`: what the policies can do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal, get_args

from mimicbench.commands.parsing import Call, Options, read_call, said
from mimicbench.commands.telling import tell, tell_rates
from mimicbench.core.errors import MimicbenchError
from mimicbench.core.names import printable

if TYPE_CHECKING:
    from mimicbench.benchmark.keys import Run
    from mimicbench.evaluate.rows import EpisodeRow


def evaluate(argv: Sequence[str]) -> None:
    """Judge policies, or a tracker, by K and P on objects and starts that they have never seen."""
    call = read_call("evaluate", argv)
    from mimicbench.benchmark.graph import start
    from mimicbench.benchmark.judging import judge
    from mimicbench.benchmark.who import who_of

    runs = [start(recipe, call.options.workdir, call.options.context()) for recipe in call.recipes]
    # who there is, before any work; `best` and another name may well mean the same
    wanted: dict[tuple[int, Path], str] = {}
    for at, run in enumerate(runs):
        for name in run.recipe.evaluate.policy:
            wanted.setdefault((at, who_of(run, name).folder), name)
    _tell_apart([(at, who_of(runs[at], name).name, name) for (at, _), name in wanted.items()])
    judged: list[list[EpisodeRow]] = []
    failed: list[MimicbenchError] = []
    for (at, _), name in wanted.items():
        try:
            judged.append(judge(runs[at], name))
            check_acted(judged[-1])
        except MimicbenchError as error:  # the others have their results
            failed.append(error)
    acted = [rows for rows in judged if call.options.json or not all(row.error for row in rows)]
    if acted:
        tell_rates(acted, call.options.json)
    if len(failed) == 1:
        raise failed[0]
    if failed:
        raise MimicbenchError("; ".join(dict.fromkeys(str(error) for error in failed)))


def check_acted(rows: Sequence[EpisodeRow]) -> None:
    """Raises MimicbenchError if a policy failed in every episode, which is no result but a mistake in it."""
    if all(row.error for row in rows):
        raise MimicbenchError(f"{rows[0].policy} failed in all of {len(rows)} episodes: {rows[0].error}; mend it first")


def _tell_apart(judged: Sequence[tuple[int, str, str]]) -> None:
    """Raises MimicbenchError if two of one recipe have the same name, by which rows and tables tell them apart."""
    seen: dict[tuple[int, str], str] = {}
    for at, called, given in judged:
        if other := seen.get((at, called)):
            told = f"{other} and {given} are both called {called!r} in rows and tables"
            raise MimicbenchError(f"{told}; rename one of them, or judge each by a command of its own")
        seen[at, called] = given


Profile = Literal["smoke", "default", "full"]


@dataclass(frozen=True)
class RunOptions(Options):
    """How and where to run, and how much of it."""

    train: bool = False
    """Learn everything from nothing (hours; minutes of `smoke`, which learns next to nothing) instead of using the
    shipped checkpoints (minutes)."""
    profile: Profile | None = None
    """How much; by default `default`, with --train `full`."""


def run(argv: Sequence[str]) -> None:
    """Do the whole task: new objects and human clips, retargeted, tracked, done by the policies, judged, reported.

    Without --train its seed is 1, so that the shipped policies meet new objects. With it, `smoke` trains briefly, too.
    """
    call, train, profile = read_run(argv)
    from mimicbench.benchmark.graph import start
    from mimicbench.report.pictures.showcase import QUICK
    from mimicbench.report.stage import report
    from mimicbench.report.table import to_terminal
    from mimicbench.report.tables.registry import TABLES
    from mimicbench.report.tables.spec import Episodes

    runs = [start(recipe, call.options.workdir, call.options.context()) for recipe in call.recipes]
    runs = [_each_once(one, train) for one in runs]
    for one in runs:
        _shown(one, train)
    found = []
    for one in runs:
        if train:
            _learn(one)
        rows = _judged(one)
        page = report(one, rows, _shown(one, train), QUICK if profile == "smoke" else None)
        judged = Episodes(tuple(rows))
        results = [s.to_dict() for s in judged.summaries]
        found.append({"task": one.recipe.task, "report": str(page), "results": results})
        if not call.options.json:
            for name in ("beside-paper", "results"):
                print(*map(to_terminal, TABLES.get(name).of(judged)), sep="\n")
            print(f"report: {printable(str(page))}")
    if call.options.json:
        tell(found, True, "")


def read_run(argv: Sequence[str]) -> tuple[Call, bool, str]:
    """What follows `run`, whether to learn anew, and how much. Raises MimicbenchError."""
    train, asked = "--train" in argv, said(argv, "profile")
    profile = asked or ("full" if train else "default")
    if profile not in get_args(Profile):
        raise MimicbenchError(f"--profile is {profile!r}; give one of {', '.join(get_args(Profile))}")
    presets = [profile, "new-objects" if not train else "brief" if profile == "smoke" else "ours"]
    # what nobody asked for gives way to the presets of a file
    named, implied = (presets, []) if asked else ([], presets)
    call = read_call("evaluate", argv, RunOptions, named, "run", implied)
    learner = said(argv, "imitate.learner")
    for recipe in call.recipes:
        if learner and learner not in recipe.evaluate.policy:
            raise MimicbenchError(
                f"--imitate.learner {learner} is not among what is judged; give --policy {learner}, too"
            )
    return call, train, profile


def _each_once(one: Run, train: bool) -> Run:
    """The same with each policy once, as two names may mean one. Found out before any work: whether all are there, or
    can be learned.

    Raises MimicbenchError if the rows of two of them would bear one name.
    """
    from mimicbench.benchmark.recipe import stage_type
    from mimicbench.benchmark.shipped import shipped_names
    from mimicbench.benchmark.who import is_place, who_of
    from mimicbench.imitate.registry import LEARNERS

    config = one.recipe.evaluate
    if train:
        there = {"best", *shipped_names(one.recipe.task)} - {"tracker", *LEARNERS}
        for name in config.policy:
            if is_place(name) or name in there:
                raise MimicbenchError(
                    f"with --train the report is of what is learned here, which {name!r} is not; name learners "
                    f"({', '.join(LEARNERS)}), or judge it without --train"
                )
            if name != "tracker":
                stage_type("imitate", {"learner": name})
        return one.changed(evaluate=replace(config, policy=tuple(dict.fromkeys(config.policy))))
    wanted: dict[Path, str] = {}
    for name in config.policy:
        wanted.setdefault(who_of(one, name).folder, name)
    _tell_apart([(0, who_of(one, name).name, name) for name in wanted.values()])
    return one.changed(evaluate=replace(config, policy=tuple(wanted.values())))


def _shown(one: Run, train: bool) -> str:
    """The policy that the report shows in pictures: the first. Who is yet to be trained is told by the name alone."""
    from mimicbench.benchmark.who import who_of

    names = (name for name in one.recipe.evaluate.policy if name != "tracker")
    name = next((name for name in names if train or not who_of(one, name).is_tracker), None)
    if name is None:
        raise MimicbenchError("a report shows a policy; name one beside the tracker (--evaluate.policy)")
    return name


def _learn(one: Run) -> None:
    from mimicbench.benchmark.graph import make_imitate_stage, make_track_stage
    from mimicbench.benchmark.recipe import stage_type

    make_track_stage(one)
    for name in one.recipe.evaluate.policy:
        if name == "tracker":
            continue
        one.context.say(f"learning {name}")
        same = one.recipe.imitate is not None and one.recipe.imitate.learner == name
        make_imitate_stage(one if same else one.changed(imitate=stage_type("imitate", {"learner": name})()))


def _judged(one: Run) -> list[EpisodeRow]:
    from mimicbench.benchmark.judging import judge

    judged = [judge(one, name) for name in one.recipe.evaluate.policy]
    for rows in judged:
        check_acted(rows)
    return [row for rows in judged for row in rows]
