"""Small parts of learning, for tests: a clip of any task, and trackers of any that have learned nothing."""

import torch

from mimicbench.envs.clips import ClipSet
from mimicbench.envs.vec_env import EnvConfig
from mimicbench.objects.registry import FAMILIES
from mimicbench.references.synthesis.registry import synthesize
from mimicbench.retarget.clip import Clip
from mimicbench.retarget.methods.optimization import optimize
from mimicbench.robots.registry import ROBOTS
from mimicbench.track.checkpoint import TrackerConfig, build_tracker
from mimicbench.track.registry import TRACKERS
from mimicbench.track.tracker import Layout, Tracker

ROBOT, ONE = ROBOTS.get("h1"), EnvConfig(workers=1)


def clip_of(task, index=0, robot=ROBOT):
    """One clip beside its object."""
    obj = FAMILIES.get(task.family).make(index, 0)
    motion = optimize(Clip(synthesize(task.name, index, obj, 0), obj, robot))
    return ClipSet(task, robot, [task.trimmed(motion, obj, robot)], {obj.id: obj})


def shape_of(name, *tasks, robot=ROBOT):
    """What a small tracker of a design is made of that serves all of the tasks."""
    layout = Layout.of(TRACKERS.get(name), robot, tasks)
    return TrackerConfig(name, layout.names, layout.widths, len(robot.joints), (16,), frames=layout.frames)


def tracker(shape) -> Tracker:
    """It has learned nothing, but always the same."""
    torch.manual_seed(0)
    return build_tracker(shape, shape.blueprint().network(shape.actions).tensors())
