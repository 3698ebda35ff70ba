"""What one robot may do and observe, as Gymnasium spaces."""

import numpy as np
import torch
from gymnasium import spaces
from gymnasium.vector.utils import batch_space

from mimicbench.core.errors import UnknownName
from mimicbench.envs.episodes import Episodes
from mimicbench.robots.description import Robot


def action_space(robot: Robot, control: str, action: str) -> spaces.Box:
    """The robot's limits for a control mode; -1 to 1 [rad] for residuals. Raises UnknownName."""
    torque = np.array([joint.torque_limit for joint in robot.joints])
    limits = {
        "position": robot.joint_range.T,
        "velocity": (-robot.velocity_limit, robot.velocity_limit),
        "torque": (-torque, torque),
    }
    if control not in limits:
        raise UnknownName("control mode", control, list(limits))
    low, high = limits[control]
    if action == "residual":
        low, high = -np.ones(len(robot.joints)), np.ones(len(robot.joints))
    return spaces.Box(np.asarray(low, np.float32), np.asarray(high, np.float32))


def observation_space(episodes: Episodes) -> spaces.Dict:
    """What one robot observes."""
    found = {}
    for term in episodes.terms:
        size = iter(episodes.config.cameras)
        shape = tuple(next(size) if length < 0 else length for length in term.shape(episodes.robot, episodes.task))
        kind = np.uint8 if term.dtype == torch.uint8 else np.float32
        found[term.name] = spaces.Box(term.low, term.high, shape, kind)
    return spaces.Dict(found)


def batched(single: spaces.Dict, num_envs: int) -> spaces.Dict:
    """The same of `num_envs` robots.

    They share one robot's bounds, which for maps would take as much memory as all else together.
    """
    joined = spaces.Dict({name: batch_space(space, num_envs) for name, space in single.items()})
    for space in joined.values():
        if isinstance(space, spaces.Box):
            for bounds in ("low", "high", "bounded_below", "bounded_above"):
                setattr(space, bounds, np.broadcast_to(getattr(space, bounds)[:1].copy(), space.shape))
    return joined
