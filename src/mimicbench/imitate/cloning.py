"""Cloning demonstrations, whatever the network: how it is configured, learned, saved and loaded."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from mimicbench.core.checkpoint import beside, checkpoint_digest
from mimicbench.core.errors import BadFile, MimicbenchError
from mimicbench.core.files import digest_of_json
from mimicbench.core.seeds import digest
from mimicbench.envs.clips import ClipSet
from mimicbench.envs.vec_env import EnvConfig
from mimicbench.imitate.dataset import DemoFrames, EpisodeGoals
from mimicbench.imitate.demos import make_driven
from mimicbench.imitate.goals import goals_of, known_goal
from mimicbench.imitate.learned import load_learner, save_learner
from mimicbench.imitate.lerobot import DATASET, Demos, load_demos
from mimicbench.imitate.policy import VisionPolicy
from mimicbench.imitate.settings.cloning import DaggerConfig
from mimicbench.imitate.settings.inputs import NetworkConfig
from mimicbench.imitate.spec import CloneImitation, Given
from mimicbench.imitate.stored.digests import read_digests
from mimicbench.imitate.stored.scenery import Scenery
from mimicbench.imitate.train import Course, train
from mimicbench.robots.description import Robot
from mimicbench.sim.devices import tensor_device
from mimicbench.tasks.task import Task

ROUNDS = "rounds"
"""Folder beside a policy in which each of its rounds of DAgger has one of its own, by its number."""


def clone(folder: Path, given: Given, config: CloneImitation) -> dict[str, Any]:
    """Clone demonstrations into a folder, or go on cloning."""
    if given.demonstrations is None:
        raise MimicbenchError(f"{config.learner} clones demonstrations; make some with `mimicbench demos` first")
    clips = given.clips
    network: NetworkConfig = config.network.of(clips.robot, clips.task)
    state = network.inputs.body == "state"
    demos = load_demos(given.demonstrations, clips.robot.name, state, disk=folder)
    _check_gains(demos, given, config.dagger)
    demos = demos.joined(*_rounds_of_others(config.dagger, clips, state, folder))
    course = Course.of(config.train, given.seed, tensor_device(given.context.device))
    notes = {"seed": given.seed, "task": clips.task.name, "gains": given.gains}
    before = None
    if config.begin_from:
        before, _ = load_learner(Path(config.begin_from), clips.robot, type(network))
    for number in range(config.dagger.rounds):
        place = beside(folder, ROUNDS) / str(number)
        frames = demo_frames(demos, clips, network, config)
        before = train(network, frames, course, place, given.context.quiet, before, notes)
        save_learner(folder, before, clips.robot.name, notes)
        demos = demos.joined(*_driven(place / DATASET, folder, number, given, config.dagger, state))
    frames = demo_frames(demos, clips, network, config)
    trained = train(network, frames, course, folder, given.context.quiet, before, notes)
    told = {"demonstrations": demos.episodes, "batches": course.steps * (config.dagger.rounds + 1)}
    save_learner(folder, trained, clips.robot.name, {**notes, **told})
    return told


def _check_gains(demos: Demos, given: Given, config: DaggerConfig) -> None:
    """Raise BadFile if demonstrations, or who demonstrates in rounds of DAgger, have other gains than the policy is to
    drive: the same joint targets would mean other torques.
    """
    if demos.gains not in (None, given.gains):
        raise BadFile(
            f"{given.demonstrations} was made with the gains {demos.gains!r}, and the policy is to drive "
            f"{given.gains!r}; clone it with its own, or make demonstrations with the others"
        )
    if config.rounds and given.expert is not None and given.expert.gains != given.gains:
        raise BadFile(
            f"the demonstrations were made with the gains {given.gains!r}, and who demonstrates in the rounds of "
            f"imitate.dagger drives {given.expert.gains!r}; leave the rounds out, or choose a tracker with the "
            "same gains"
        )


def _rounds_of_others(config: DaggerConfig, clips: ClipSet, state: bool, disk: Path) -> list[Demos]:
    """What other policies got into. Raises BadFile if it is not of these clips, before anything is learned of it."""
    places = [place for policy in config.rounds_of for place in rounds_of(policy)]
    found = [_read_round(place, clips.robot.name, state, disk) for place in places]
    for driven in found:
        clips_of(driven, clips)
    return found


def _driven(place: Path, folder: Path, number: int, given: Given, config: DaggerConfig, state: bool) -> list[Demos]:
    """What who demonstrated would have done where the policy in a folder drives; nothing where it got nowhere."""
    clips, context = given.clips, given.context
    assert given.load_policy is not None and given.expert is not None, "who is to drive has to be read"
    policy = given.load_policy(folder, clips.robot, clips.task)
    env_config = EnvConfig(context.device, context.workers)
    make_driven(
        place,
        given.expert,
        policy,
        clips,
        config,
        digest(given.seed, "round", number) % (1 << 31),
        env_config,
        context.quiet,
    )
    return [_read_round(place, clips.robot.name, state, folder)] if place.exists() else []


def _read_round(place: Path, robot: str, state: bool, disk: Path) -> Demos:
    # who drove may have failed: what is learned from it is what the expert says
    return load_demos(place, robot, state, only_success=False, disk=disk)


def rounds_of(policy: str) -> list[Path]:
    """The data sets of the rounds in which a policy in a folder drove, in order."""
    found = beside(Path(policy), ROUNDS).glob(f"*/{DATASET}")
    return sorted((place for place in found if place.parent.name.isdigit()), key=lambda place: int(place.parent.name))


def demo_frames(demos: Demos, clips: ClipSet, network: NetworkConfig, config: CloneImitation) -> DemoFrames:
    """The frames of demonstrations that follow these clips, as a network is shown them."""
    scene = [clips.objects[object_id] for object_id in sorted(set(demos.object_ids) & set(clips.objects))]
    finds, inputs = network.goal_weight > 0, network.inputs
    goals = _goals(demos, clips, finds, inputs.targets) if inputs.memory or inputs.targets or finds else None
    scenery = Scenery.of(scene, clips.task, inputs, config.train.maps)
    return DemoFrames(demos, clips.objects, inputs, network.window, scenery, goals, config.plans(demos, clips))


def _goals(demos: Demos, clips: ClipSet, to_find: bool = False, are_told: bool = False) -> EpisodeGoals:
    """What the demonstrations were to do, by the clips that were tracked."""
    of = clips_of(demos, clips)
    places = np.stack([motion.wrist_goal_w for motion in clips.motions])[of.numpy()] if are_told else None
    return EpisodeGoals(clips.task.goal, goals_of(clips)[of], places, clips.task.map_cell, to_find)


def clips_of(demos: Demos, clips: ClipSet) -> Tensor:
    """(E,) which of the clips each demonstration follows. Raises BadFile if one is missing, or is beside something
    else.
    """
    place = {motion.id: i for i, motion in enumerate(clips.motions)}
    missing = sorted(set(demos.reference_ids) - set(place))
    if missing:
        raise BadFile(f"clip {missing[0]!r} of the demonstrations is missing; make the demonstrations again")
    for name, object_id in zip(demos.reference_ids, demos.object_ids, strict=True):
        if clips.motions[place[name]].object_id != object_id:
            raise BadFile(f"{name!r} of the demonstrations is beside another object; they are not of these clips")
    return torch.tensor([place[name] for name in demos.reference_ids])


def clone_loader(config_type: type[NetworkConfig]) -> Callable[[Path, Robot, Task], VisionPolicy]:
    """Reads policies whose network is built from that configuration."""

    def load(folder: Path, robot: Robot, task: Task) -> VisionPolicy:
        """The policy in a folder, with the eyes in the folder `perception` beside it if it remembers."""
        learner, notes = load_learner(folder, robot, config_type)
        goal = known_goal(beside(folder, "perception"), robot, task) if learner.inputs.memory else None
        return VisionPolicy(learner, goal, str(notes.get("gains", "improved")))

    return load


def learned_before(settings: dict[str, Any]) -> dict[str, str]:
    """What a learner goes on from, whose paths are taken out of its settings: whatever they lead to is what counts."""
    found = {}
    if policy := settings.pop("begin_from", ""):
        found["begin_from"] = checkpoint_digest(Path(policy))
    if drivers := settings.get("dagger", {}).pop("rounds_of", ()):
        places = [place for driver in drivers for place in rounds_of(driver)]
        found["rounds_of"] = digest_of_json([read_digests(place) for place in places])
    return found
