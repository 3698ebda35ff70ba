"""From a recipe to its stages: each function makes one stage, and before it what is missing of those that it reads."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mimicbench.benchmark import keys
from mimicbench.benchmark.experts import cloned_gains, expert_of, tell_unfinished, who_demonstrated
from mimicbench.benchmark.finding import objects_of_split, training_objects
from mimicbench.benchmark.keys import Run
from mimicbench.benchmark.published import published_clips
from mimicbench.benchmark.recipe import Recipe, check_recipe
from mimicbench.benchmark.shipped import SHIPPED
from mimicbench.core.checkpoint import CONFIG, copy_checkpoint
from mimicbench.core.errors import BadFile, BadMotion
from mimicbench.core.files import read_json
from mimicbench.core.names import typed
from mimicbench.core.parallel import end_if_imported_by_worker
from mimicbench.core.run import RunContext
from mimicbench.core.stage import Stage, StageKey, opened
from mimicbench.envs.clips import ClipSet, learned_and_judged
from mimicbench.objects.make import MADE, make_objects, read_objects
from mimicbench.references import make as references
from mimicbench.retarget import make as retargeting

if TYPE_CHECKING:
    from mimicbench.envs.vec_env import EnvConfig
    from mimicbench.imitate.spec import ImitateConfig


def start(recipe: Recipe, workdir: Path | str, context: RunContext | None = None) -> Run:
    """A recipe that has been checked, in a folder. Raises MimicbenchError if it contradicts itself, or there is no such
    device.
    """
    check_recipe(recipe)
    end_if_imported_by_worker()
    run = Run(recipe, Path(workdir), context or RunContext())
    if run.context.device != "cpu":
        from mimicbench.sim.backends import check_device

        check_device(run.context.device)
    return run


def make_object_stage(run: Run) -> Stage:
    """The objects: made, or an imported set, or the one that comes with imported clips."""
    name = run.set_name("objects")
    if name is not None:
        return run.named("objects", name)
    with _opened(run, keys.object_key(run), "objects") as stage:
        return stage if stage.complete else make_objects(stage, run.task.family, run.part("objects"))


def make_reference_stage(run: Run) -> Stage:
    """Human clips on the objects, or an imported set."""
    name, config = run.set_name("references"), run.part("references")
    if name is not None:
        return run.named("references", name)
    objects = make_object_stage(run)
    with _opened(run, keys.reference_key(run), "objects", "references") as stage:
        if stage.complete:
            return stage
        ids = references.used_objects(objects.folder, config, stage.header["settings"]["objects_used"])
        places = references.Places(objects.folder, run.task.fulfilled_by_human)
        return references.make_references(stage, ids, places, config.count, run.context)


def make_retarget_stage(run: Run) -> Stage:
    """Robot clips of the human ones. Raises BadMotion if there is none to retarget."""
    human, objects = make_reference_stage(run), make_object_stage(run)
    if run.set_name("references") and human.header["made_from"].get("objects") != objects.fingerprint:
        raise BadFile(f"{human.folder} was made on other objects than {objects.folder} holds now; make both again")
    clips = clips_of(human)
    if not clips:
        raise BadMotion(f"there are no clips in {human.folder}; make it again, or import some")
    with _opened(run, keys.retarget_key(run), "objects", "references", "retarget") as stage:
        if stage.complete:
            return stage
        places = retargeting.Places(run.robot.name, objects.folder, run.task.fulfilled)
        return retargeting.make_retargeted(stage, clips, places, run.part("retarget"), run.context)


def clips_of(human: Stage) -> list[Path]:
    """Files of the human clips that are wanted of a stage, in order of their ids."""
    return sorted(human.folder.glob("*.npz"))[: human.header["amounts"].get("count")]


@dataclass(frozen=True)
class Clips:
    """Retargeted clips that fulfil K, and where they come from."""

    set: ClipSet
    stage: Stage
    human: Path
    """Folder of the human clips of the same ids."""

    def split(self, name: str) -> ClipSet:
        """The clips on objects of a split, or of both for `all`."""
        return self.set.split(None if name == "all" else name)


def some_retargeted(run: Run) -> Stage:
    """The robot clips. Raises BadMotion if none is solved and fulfils K."""
    stage = make_retarget_stage(run)
    if not stage.summary["kept"]:
        reasons = ", ".join(f"{name} {count}" for name, count in stage.summary["rejected_for"].items())
        raise BadMotion(
            f"none of the {stage.summary['clips']} clips in {stage.folder} is solved and fulfils {run.recipe.task} "
            f"({reasons}); try another --retarget.method, or make other clips"
        )
    return stage


def retargeted(run: Run) -> Clips:
    """The recipe's retargeted clips, each without the long rest after K is fulfilled.

    Raises BadMotion if none is solved and fulfils K.
    """
    stage, human = some_retargeted(run), make_reference_stage(run)
    objects = read_objects(make_object_stage(run).folder)
    motions = retargeting.read_retargeted(stage.folder, run.robot.name, len(clips_of(human)))
    trimmed = [run.task.trimmed(m, objects[m.object_id], run.robot) for m in motions]
    return Clips(ClipSet(run.task, run.robot, trimmed, objects), stage, human.folder)


def make_track_stage(run: Run) -> Stage:
    """Train the tracker on the clips of training objects; objects of the test split only judge it."""
    from mimicbench.track.evaluation import in_words
    from mimicbench.track.learning.ppo_config import ppo_learner
    from mimicbench.track.train import check_given, train_tracker

    config, sets = run.part("track"), keys.tracked(run)
    if not config.teachers:
        ppo_learner()  # which had better be missing before clips are made for it
    check_given(config, run.robot, [part.task for part in sets.values()])
    for part in sets.values():  # made before this stage is held, and read only if it is not finished
        some_retargeted(part)

    def report(row: dict) -> None:
        run.context.say(in_words(row))

    with _opened(run, keys.track_key(run), *PARTS[:4], trained=True) as stage:
        if stage.complete:
            return stage
        train, test = training_clips(sets)
        say = run.context.say
        made = train_tracker(stage.folder, train, test, config, run.recipe.seed, env_config(run), report, say)
        samples = read_json(made / CONFIG)["notes"]["samples"]
        return stage.finish(clips=sum(map(len, train)), samples=samples, device=run.context.device)


def env_config(run: Run) -> EnvConfig:
    """Device and threads of environments."""
    from mimicbench.envs.vec_env import EnvConfig

    return EnvConfig(device=run.context.device, workers=run.context.workers)


def tracker_for_learning(run: Run) -> Path:
    """Folder of the tracker that demonstrations and planners are learned with; trained now if there is none."""
    folder = keys.tracker_folder(run)
    if folder is None:
        return make_track_stage(run).folder / keys.CHECKPOINT
    if folder == run.folder(wanted := keys.track_key(run)) / keys.CHECKPOINT:
        tell_unfinished(run, folder.parent, wanted)
    if SHIPPED in folder.parents:
        of = "several tasks" if run.part("imitate").tasks_beside else run.recipe.task
        run.context.say(f"taking the shipped tracker of {of}; `mimicbench track` trains one here")
    return folder


def _tell_tracker(run: Run) -> None:
    """Say before the first stage if a tracker has to be trained on the way, which takes hours."""
    if keys.tracker_folder(run) is None:
        run.context.say(
            f"no tracker of this recipe is here, nor one shipped for {run.recipe.task}: one is trained first, as by "
            f"`mimicbench track --task {run.recipe.task} --workdir {typed(run.workdir)}`"
        )


def make_demo_stage(run: Run) -> Stage:
    """Let an expert turn the training clips into demonstrations."""
    from mimicbench.imitate.demos import make_demos

    if run.part("demos").source != MADE:
        return run.named("demos", run.part("demos").source)
    _tell_tracker(run)
    clips, folder = demonstrated(run), tracker_for_learning(run)
    with _opened(run, keys.demo_key(run, folder), *PARTS[:5]) as stage:
        if stage.complete:
            return stage
        train, config = clips.split("train"), run.part("demos")
        return make_demos(stage, expert_of(run, folder), train, config, env_config(run), run.context.quiet)


def demonstrated(run: Run) -> ClipSet:
    """The clips in whose first frames the recipe's demonstrations begin, and which trackers follow."""
    from mimicbench.envs.rule_starts import standing
    from mimicbench.imitate.settings.demos import CLIPS, POSES

    config, published = run.part("demos"), published_clips(run)
    if published is not None:
        return published
    if config.starts == CLIPS:
        return retargeted(run).set
    objects = training_objects(make_object_stage(run))
    people = retargeted(run).set.split("train").motions if config.starts == POSES else ()
    poses = [motion.joint_pos[0] for motion in people]
    return standing(run.task, run.robot, objects, config.clips, run.recipe.seed, poses)


def make_perception_stage(run: Run) -> Stage:
    """Learn to find the objects of the training split in elevation maps."""
    from mimicbench.imitate.learn_perception import make_perception

    objects = make_object_stage(run)
    with _opened(run, keys.perception_key(run), "objects", "imitate") as stage:
        if stage.complete:
            return stage
        train, test = list(training_objects(objects).values()), list(objects_of_split(objects, "test").values())
        config, quiet = run.part("imitate").perception, run.context.quiet
        return stage.finish(**make_perception(stage.folder, run.task, run.robot, train, test, config, quiet))


def _learned_from(run: Run) -> tuple[list[ClipSet], Path | None]:
    """What a learner is given: training clips of each of its tasks, its own first, and the folder of a tracker; or
    training objects alone, and no tracker.

    Raises BadObject if it wants objects, and BadMotion if it wants clips, and there is none.
    """
    if run.part("imitate").references:
        _tell_tracker(run)
        clips = (
            [demonstrated(run).split("train")] if run.part("imitate").clones else training_clips(keys.learned(run))[0]
        )
        return clips, tracker_for_learning(run)
    return [ClipSet(run.task, run.robot, [], training_objects(make_object_stage(run)))], None


def training_clips(parts: Mapping[str, Run]) -> tuple[list[ClipSet], list[ClipSet]]:
    """Of each task, clips to learn from and clips that only judge. Raises BadMotion if there is none to learn from."""
    train, test = learned_and_judged({name: retargeted(part).set for name, part in parts.items()})
    for some in train:
        if not len(some):
            raise BadMotion(f"no clip of {some.task.name} is on an object of the training split; make more objects")
    return train, test


def make_imitate_stage(run: Run) -> Stage:
    """Learn the recipe's policy: its folder holds copies of the tracker and of the eyes, if it uses any."""
    from mimicbench.imitate.lerobot import DATASET
    from mimicbench.imitate.registry import LEARNERS
    from mimicbench.imitate.spec import Given
    from mimicbench.policies.loading import load_policy
    from mimicbench.track.checkpoint import load_tracker

    config: ImitateConfig = run.part("imitate")
    clips, tracker = _learned_from(run)
    eyes = {name: make_perception_stage(part) for name, part in keys.seeing(run).items()}
    demos = make_demo_stage(run) if config.clones else None
    with _opened(run, keys.imitate_key(run, tracker), *PARTS, trained=True) as stage:
        if stage.complete:
            return stage
        gains, expert, follows = config.gains or "", None, True
        if tracker is not None and demos is not None:
            gains, (expert, follows) = cloned_gains(run, demos, tracker), who_demonstrated(run, demos, tracker)
        elif tracker is not None:
            gains = gains or load_tracker(tracker, run.robot).spec.gains
        if tracker is not None:
            copy_checkpoint(tracker, stage.folder / keys.TRACKER)
        for name, seen in eyes.items():
            copy_checkpoint(seen.folder, stage.folder / name)
        dataset = None if demos is None else demos.folder / DATASET
        given = Given(clips[0], dataset, run.recipe.seed, gains, run.context, load_policy, expert, follows, clips[1:])
        summary = LEARNERS.get(config.learner).learn(stage.folder / keys.POLICY, given, config)
        return stage.finish(**summary, device=run.context.device)


PARTS = ("objects", "references", "retarget", "track", "demos", "imitate")


def _opened(run: Run, key: StageKey, *parts: str, trained: bool = False) -> AbstractContextManager[Stage]:
    return opened(run.folder(key), key, run.recipe.tree(*parts), trained)


STAGES: Mapping[str, Callable[[Run], Stage]] = {
    "objects": make_object_stage,
    "references": make_reference_stage,
    "retarget": some_retargeted,
    "track": make_track_stage,
    "demos": make_demo_stage,
    "perception": make_perception_stage,
    "imitate": make_imitate_stage,
}
