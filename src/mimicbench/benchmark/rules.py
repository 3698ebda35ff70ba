"""What a recipe must not say: each rule raises UnknownName or BadSetting, in one sentence, before any work begins."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mimicbench.core.errors import UnknownName
from mimicbench.core.settings import BadSetting
from mimicbench.objects.make import MADE
from mimicbench.robots.registry import ROBOTS

if TYPE_CHECKING:
    from mimicbench.benchmark.recipe import Recipe


def names_exist(recipe: Recipe) -> None:
    """Task, robot."""
    from mimicbench.tasks.registry import TASKS

    TASKS.get(recipe.task)
    ROBOTS.get(recipe.robot)


def sources_agree(recipe: Recipe) -> None:
    """Clips that were imported bring their objects."""
    objects = recipe.objects.source if recipe.objects else MADE
    references = recipe.references.source if recipe.references else MADE
    for part, name in (("objects", objects), ("references", references)):
        if not name or name.startswith(".") or "/" in name or "\0" in name:
            raise BadSetting(f"{part}.source is {name!r}; give `made`, or the name of an imported set")
    if references != MADE and objects not in (MADE, references):
        raise BadSetting(
            f"references.source {references!r} brings its own objects; leave objects.source ({objects!r}) out"
        )


def method_has_variant(recipe: Recipe) -> None:
    """Not every retargeting method has every variant."""
    if recipe.retarget is None:
        return
    from mimicbench.retarget.registry import METHODS

    METHODS.get(recipe.retarget.method).preset(recipe.retarget.variant)


def learner_has_its_tracker(recipe: Recipe) -> None:
    """A learner that speaks to the tracker needs the one that understands it."""
    if recipe.imitate is None and recipe.track is None:
        return
    from mimicbench.imitate.spec import ImitateConfig
    from mimicbench.track.settings import TrackConfig

    tracker = (recipe.track or TrackConfig()).tracker
    learner = recipe.imitate or ImitateConfig()
    if recipe.imitate is not None and learner.tracker not in (None, tracker):
        raise BadSetting(
            f"imitate.learner {learner.learner!r} needs the tracker {learner.tracker!r}, but track.tracker is "
            f"{tracker!r}; change one of them"
        )


def poses_are_shown(recipe: Recipe) -> None:
    """Who learns to say poses is shown some: where it drives itself, only a clip has them."""
    if recipe.imitate is None or recipe.demos is None or not recipe.imitate.says_poses:
        return
    from mimicbench.imitate.settings.demos import TRACKER

    dagger = getattr(recipe.imitate, "dagger", None)
    drives = dagger is not None and (dagger.rounds or dagger.rounds_of)
    if drives and recipe.demos.source == MADE and recipe.demos.expert != TRACKER:
        raise BadSetting(
            f"imitate.learner {recipe.imitate.learner!r} learns to say poses, and where it drives itself nobody shows "
            f"it any but a clip, which demos.expert {recipe.demos.expert!r} does not follow; leave the rounds of "
            "imitate.dagger out, or demos.expert"
        )


def expert_is_there(recipe: Recipe) -> None:
    """A policy that demonstrates is found before clips, or a tracker, are made for it. Raises BadFile."""
    if recipe.demos is None or recipe.demos.source != MADE:
        return
    from mimicbench.benchmark.shipped import expert_named
    from mimicbench.imitate.settings.demos import TRACKER

    if recipe.demos.expert != TRACKER:
        expert_named(recipe.robot, recipe.task, recipe.demos.expert)


def gains_agree(recipe: Recipe) -> None:
    """A policy drives the gains of the tracker that it learns from; who learns from none drives any of the robot's."""
    if recipe.imitate is None:
        return
    if not recipe.imitate.references:
        known = list(ROBOTS.get(recipe.robot).gains)
        if recipe.imitate.gains not in known:
            raise UnknownName("gains", str(recipe.imitate.gains), known)
        return
    from mimicbench.imitate.settings.demos import TRACKER
    from mimicbench.track.registry import TRACKERS
    from mimicbench.track.settings import TrackConfig

    if recipe.imitate.clones and recipe.demos is not None and recipe.demos.expert != TRACKER:
        if recipe.imitate.gains is not None:
            raise BadSetting(
                f"imitate.gains is {recipe.imitate.gains!r}, but a clone drives those of the policy that demonstrates; "
                "leave imitate.gains out"
            )
        return
    if recipe.imitate.clones and recipe.demos is not None and recipe.demos.source != MADE:
        return  # theirs are known when they are read
    gains = TRACKERS.get((recipe.track or TrackConfig()).tracker).gains
    if recipe.imitate.gains not in (None, gains):
        raise BadSetting(
            f"imitate.gains is {recipe.imitate.gains!r}, but the tracker of the demonstrations drives {gains!r}; "
            "leave imitate.gains out"
        )


def tracked_together(recipe: Recipe) -> None:
    """A tracker of several tasks names each once, and begins from a tracker that is there."""
    if recipe.track is None:
        return
    from mimicbench.core.checkpoint import model_file
    from mimicbench.tasks.registry import TASKS
    from mimicbench.track.learning.ppo_config import check_rounds

    also, begin_from = recipe.track.also, recipe.track.begin_from
    for name in also:
        TASKS.get(name)
    if recipe.track.num_envs < (parts := max(recipe.track.parts, 1 + len(also))):
        raise BadSetting(
            f"track.num-envs is {recipe.track.num_envs}, too few for {parts} parts; give at least one robot for each"
        )
    if not recipe.track.teachers:
        check_rounds(recipe.track.ppo, recipe.track.num_envs)
    if recipe.task in also or len(set(also)) != len(also):
        raise BadSetting(f"track.also is {', '.join(also)}; name each task beside {recipe.task!r} once")
    if len(recipe.track.shares) not in (0, 1 + len(also)):
        raise BadSetting(
            f"track.shares has {len(recipe.track.shares)} numbers for {1 + len(also)} tasks; give one each"
        )
    if begin_from and not model_file(Path(begin_from)).is_file():
        raise BadSetting(f"track.begin_from is {begin_from!r}, where no tracker is; give the folder of its checkpoint")
    taught_by(recipe.track.teachers, 1 + len(also))


def taught_by(teachers: Sequence[str], tasks: int) -> None:
    """Who learns from teachers has one for each task."""
    from mimicbench.core.checkpoint import model_file

    if teachers and len(teachers) != tasks:
        raise BadSetting(f"track.teachers are {len(teachers)} for {tasks} tasks; give the folder of a tracker for each")
    for folder in teachers:
        if not model_file(Path(folder)).is_file():
            raise BadSetting(f"track.teachers names {folder!r}, where no tracker is; give the folder of its checkpoint")


def learner_finds_policies(recipe: Recipe) -> None:
    """Who begins from another policy's weights, or learns from its rounds, finds them, before clips or demonstrations
    are made for it.
    """
    from mimicbench.core.checkpoint import model_file

    begin_from = getattr(recipe.imitate, "begin_from", "")
    if begin_from and not model_file(Path(begin_from)).is_file():
        raise BadSetting(f"imitate.begin_from is {begin_from!r}, where no policy is; give the folder of its checkpoint")
    dagger = getattr(recipe.imitate, "dagger", None)
    for driver in dagger.rounds_of if dagger else ():
        from mimicbench.imitate.cloning import rounds_of

        if not rounds_of(driver):
            raise BadSetting(
                f"imitate.dagger.rounds-of names {driver!r}, beside which no rounds are; give the folder `policy` of "
                "one that was learned with --imitate.dagger.rounds"
            )


def learned_together(recipe: Recipe) -> None:
    """A policy of several tasks names each once."""
    if recipe.imitate is None:
        return
    from mimicbench.tasks.registry import TASKS

    also = recipe.imitate.tasks_beside
    for name in also:
        TASKS.get(name)
    if recipe.task in also or len(set(also)) != len(also):
        raise BadSetting(f"imitate.also is {', '.join(also)}; name each task beside {recipe.task!r} once")


RULES: tuple[Callable[[Recipe], None], ...] = (
    names_exist,
    sources_agree,
    method_has_variant,
    learner_has_its_tracker,
    poses_are_shown,
    expert_is_there,
    gains_agree,
    tracked_together,
    learner_finds_policies,
    learned_together,
)
