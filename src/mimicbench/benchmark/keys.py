"""Where each stage of a recipe is and what determines it, without making anything."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from mimicbench.benchmark.recipe import Recipe, stage_type
from mimicbench.benchmark.shipped import PERCEPTION, TRACKER, expert_named, networks_under, shipped_tracker
from mimicbench.core.checkpoint import checkpoint_digest
from mimicbench.core.errors import BadFile
from mimicbench.core.names import typed
from mimicbench.core.run import RunContext
from mimicbench.core.settings import amounts, identity
from mimicbench.core.stage import Stage, StageKey, is_complete, read_stage
from mimicbench.objects.make import MADE
from mimicbench.retarget.registry import METHODS
from mimicbench.robots.description import Robot
from mimicbench.robots.registry import ROBOTS
from mimicbench.tasks.registry import TASKS
from mimicbench.tasks.task import Task

POLICY, CHECKPOINT = "policy", "checkpoint"


@dataclass(frozen=True)
class Run:
    """A recipe in a folder: what every stage is made with."""

    recipe: Recipe
    workdir: Path
    context: RunContext = RunContext()
    tracker: Path | None = None  # another's, in place of that of the recipe

    @cached_property
    def task(self) -> Task:
        """The recipe's task."""
        return TASKS.get(self.recipe.task)

    @cached_property
    def robot(self) -> Robot:
        """The recipe's robot."""
        return ROBOTS.get(self.recipe.robot)

    def part(self, name: str) -> Any:
        """The recipe's configuration of a stage, or the defaults."""
        return getattr(self.recipe, name) or stage_type(name)()

    def changed(self, **parts: Any) -> Run:
        """The same with other parts of the recipe."""
        return replace(self, recipe=replace(self.recipe, **parts))

    def key(self, stage: str, settings: Mapping[str, Any], made_from: Mapping[str, str], **more: Any) -> StageKey:
        """The key of a stage of this recipe."""
        return StageKey(stage, self.recipe.task, self.recipe.seed, settings, made_from, **more)

    def folder(self, key: StageKey) -> Path:
        """Where a stage is."""
        return key.folder(self.workdir)

    def named(self, stage: str, name: str) -> Stage:
        """A set that was imported or augmented. Raises BadFile with what makes it."""
        try:
            return read_stage(self.workdir / self.recipe.task / stage / name)
        except BadFile as error:
            how = {"objects": "objects import", "references": "import"}.get(stage)
            of = "" if self.recipe.task == Recipe.task else f" --task {self.recipe.task}"
            advice = (
                f"`mimicbench {how} FILE{of} --to {typed(name)} --workdir {typed(self.workdir)}` makes"
                if how
                else "give the --workdir that has"
            )
            raise BadFile(f"{error}; {advice} the set {name!r}") from None

    def has_named(self, stage: str, name: str) -> bool:
        """Whether there is such a set."""
        return is_complete(self.workdir / self.recipe.task / stage / name)

    def set_name(self, stage: str) -> str | None:
        """Name of the imported set that stands for `objects` or `references`; None where they are made."""
        names = [self.part("references").source, *([self.part("objects").source] if stage == "objects" else [])]
        return next((name for name in names if name != MADE), None)


def object_key(run: Run) -> StageKey:
    """Objects that are made."""
    family = run.task.family
    return run.key("objects", {"family": family}, {}, amounts=amounts(run.part("objects")), words=(family,))


def objects_of(run: Run) -> tuple[str, Path]:
    """Fingerprint and folder of the objects: made, or an imported set. Raises BadFile if there is no such set."""
    name = run.set_name("objects")
    if name is None:
        key = object_key(run)
        return key.fingerprint, run.folder(key)
    there = run.named("objects", name)
    return there.fingerprint, there.folder


def reference_key(run: Run) -> StageKey:
    """Human clips that are made."""
    config, name = run.part("references"), run.set_name("objects")
    fingerprint, folder = objects_of(run)
    return run.key(
        "references",
        {**config.flags, "objects_used": None if name else run.part("objects").count},
        {"objects": fingerprint},
        amounts=amounts(config),
        words=(name or MADE, *(flag.removesuffix("_only") for flag, on in config.flags.items() if on)),
        reads={"objects": folder},
    )


def retarget_key(run: Run) -> StageKey:
    """Robot clips."""
    config, name = run.part("retarget"), run.set_name("references")
    method = METHODS.get(config.method)
    variant = method.preset(config.variant)
    if name is None:
        human = reference_key(run)
        folders = {"references": run.folder(human), "objects": human.reads["objects"]}
    else:
        human = run.named("references", name)
        folders = {"references": human.folder, "objects": run.named("objects", name).folder}
    return run.key(
        "retarget",
        {"robot": run.robot.name, "method": method.name, "variant": variant},
        {"references": human.digest},
        amounts={} if name else amounts(run.part("references")),
        words=(method.name, variant, *([name] if name else [])),
        reads=folders,
    )


def tracked(run: Run) -> dict[str, Run]:
    """The recipe for each set of clips that its tracker learns to follow, as `sets_of`."""
    config = run.part("track")
    return sets_of(run, config.also, config.recorded)


def learned(run: Run) -> dict[str, Run]:
    """The recipe for each set of clips that its policy learns from where it clones nothing, as `sets_of`."""
    config = run.part("imitate")
    return sets_of(run, config.tasks_beside, config.sets_beside)


def sets_of(run: Run, also: Sequence[str], recorded: Sequence[str]) -> dict[str, Run]:
    """The recipe for each set of clips of its task and others, its own first, by `task`, or `task/set` for recordings.

    Raises BadFile if no task has a set of recordings that is named.
    """
    found = {task: run.changed(task=task) for task in (run.recipe.task, *also)}
    for name in recorded:
        having = [task for task in (run.recipe.task, *also) if found[task].has_named("references", name)]
        if not having:
            found[run.recipe.task].named("references", name)
        for task in having:
            references = replace(run.part("references"), source=name)
            found[f"{task}/{name}"] = found[task].changed(references=references)
    return found


def track_key(run: Run) -> StageKey:
    """The recipe's own tracker."""
    config, parts = run.part("track"), tracked(run)
    clips = {name: retarget_key(part) for name, part in parts.items()}
    names = {name: "retarget" if name == run.recipe.task else name for name in clips}
    made_from = {names[name]: key.fingerprint for name, key in clips.items()}
    # the order of what it learns from decides its random numbers; none at all is not written down
    told_apart = ("begin_from", "teachers", *(name for name in ("also", "recorded") if not getattr(config, name)))
    settings = {name: value for name, value in identity(config).items() if name not in told_apart}
    if config.learned_from:
        from mimicbench.track.checkpoint import tracker_digest

        made_from |= {name: tracker_digest(Path(folder)) for name, folder in config.learned_from.items()}
    return run.key(
        "track",
        settings,
        made_from,
        amounts=amounts(config),
        words=(config.tracker, *(("also",) if config.also else ()), *config.recorded),
        reads={names[name]: parts[name].folder(key) for name, key in clips.items()},
    )


def tracker_folder(run: Run) -> Path | None:
    """The tracker that the recipe means: trained here, or the shipped one if that was trained as the recipe says.

    None if it must be trained first.
    """
    if run.tracker is not None:
        return run.tracker
    own = run.folder(track_key(run))
    if is_complete(own):
        return own / CHECKPOINT
    same = identity(run.part("track")) == identity(stage_type("track")())
    tasks = (run.recipe.task, *run.part("imitate").tasks_beside)
    return shipped_tracker(run.recipe.robot, tasks) if same else None


def expert_folder(run: Run, tracker: Path) -> Path:
    """Who demonstrates: the tracker in a folder, or the policy that the recipe names. Raises BadFile without it."""
    config = run.part("demos")
    if (name := config.expert) == TRACKER or config.source != MADE:
        return tracker
    return expert_named(run.robot.name, run.recipe.task, name)


def demo_key(run: Run, tracker: Path) -> StageKey:
    """Demonstrations by the tracker in a folder, or by the expert that the recipe names."""
    from mimicbench.imitate.settings.demos import CLIPS, RULE

    settings, expert = identity(run.part("demos")), expert_folder(run, tracker)
    del settings["source"], settings["expert"]
    starts, begin = settings.pop("starts"), dict[str, tuple[str, Path]]()
    if starts != RULE:
        begin["retarget"] = retarget_key(run).fingerprint, run.folder(retarget_key(run))
    if starts != CLIPS:
        begin["objects"] = objects_of(run)
    used = networks_under(expert)
    by = {TRACKER: expert} if expert == tracker else {f"expert_{name}": folder for name, folder in used.items()}
    return run.key(
        "demos",
        settings,
        {**{n: mark for n, (mark, _) in begin.items()}, **{n: checkpoint_digest(folder) for n, folder in by.items()}},
        reads={**{name: folder for name, (_, folder) in begin.items()}, **by},
    )


def demos_of(run: Run, tracker: Path) -> tuple[str, Path]:
    """Fingerprint and folder of the demonstrations: by the tracker in a folder, or a named set. Raises BadFile if there
    is no such set.
    """
    name = run.part("demos").source
    if name == MADE:
        key = demo_key(run, tracker)
        return key.fingerprint, run.folder(key)
    there = run.named("demos", name)
    return there.fingerprint, there.folder


def perception_key(run: Run) -> StageKey:
    """The network that finds objects in elevation maps."""
    fingerprint, folder = objects_of(run)
    settings = identity(run.part("imitate").perception)
    return run.key("perception", settings, {"objects": fingerprint, "robot": run.robot.name}, reads={"objects": folder})


def imitate_key(run: Run, tracker: Path | None) -> StageKey:
    """The recipe's policy, learned with the tracker in a folder; None for who learns without references."""
    from mimicbench.imitate.cloning import learned_before

    config, settings = run.part("imitate"), identity(run.part("imitate"))
    made_from: dict[str, str] = {}
    reads: dict[str, Path] = {}
    before: dict[str, StageKey] = {}
    if tracker is None:
        made_from["objects"], reads["objects"] = objects_of(run)
        made_from["robot"] = run.robot.name  # which nothing else that it is made from depends on
    else:
        made_from["tracker"], reads["tracker"] = checkpoint_digest(tracker), tracker
        made_from |= learned_before(settings)
        if config.clones:
            made_from["demos"], reads["demos"] = demos_of(run, tracker)
        else:
            own = f"/{run.recipe.task}"
            before |= {f"retarget/{name}".removesuffix(own): retarget_key(p) for name, p in learned(run).items()}
    eyes = seeing(run)
    before |= {name: perception_key(part) for name, part in eyes.items()}
    if not eyes:
        del settings["perception"]
    for name in ("also", "recorded"):
        if not settings.get(name):
            settings.pop(name, None)  # without any, planners are what they were before there were any
    return run.key(
        "imitate",
        settings,
        {**made_from, **{name: key.fingerprint for name, key in before.items()}},
        amounts=amounts(config),
        words=(config.learner, *(("also",) if config.tasks_beside else ()), *config.sets_beside),
        reads={**reads, **{name: run.folder(key) for name, key in before.items()}},
    )


def seeing(run: Run) -> dict[str, Run]:
    """The recipe for each task whose goal the recipe's policy has to find, by what its perception is called."""
    tasks = {name: part for name, part in learned(run).items() if "/" not in name}
    own = f"{run.recipe.task}/"
    return {f"{name}/{PERCEPTION}".removeprefix(own): part for name, part in tasks.items() if needs_eyes(part)}


def needs_eyes(run: Run) -> bool:
    """Whether the recipe's policy remembers a goal that has to be found."""
    return run.part("imitate").remembers and not run.task.goal.given
