"""What one robot may do and observe, as Gymnasium spaces."""

import numpy as np
from gymnasium import spaces
from gymnasium.vector.utils import batch_space

from mimicbench.core.errors import UnknownName
from mimicbench.envs.episodes import BOUND, Episodes
from mimicbench.robots.description import Robot
from mimicbench.sensors.heightmap import CELLS
from mimicbench.sensors.rays import FARTHEST
from mimicbench.sim.scene import CONTROL_DT


def action_space(robot: Robot, control: str) -> spaces.Box:
    """The robot's limits for a control mode. Raises UnknownName."""
    torque = np.array([joint.torque_limit for joint in robot.joints])
    limits = {
        "position": robot.joint_range.T,
        "velocity": (-robot.velocity_limit, robot.velocity_limit),
        "torque": (-torque, torque),
    }
    if control not in limits:
        raise UnknownName("control mode", control, list(limits))
    low, high = limits[control]
    return spaces.Box(np.asarray(low, np.float32), np.asarray(high, np.float32))


def observation_space(episodes: Episodes) -> spaces.Dict:
    """What one robot observes."""
    joints, links, limit = len(episodes.robot.joints), len(episodes.robot.links), episodes.limit * CONTROL_DT
    every = {
        "proprio": spaces.Box(-BOUND, BOUND, (10 + 2 * joints,)),
        "state": spaces.Box(-BOUND, BOUND, (3 + 3 * joints + 12 * links,)),
        "time": spaces.Box(0.0, limit, (1,)),
        "elevation": spaces.Box(-BOUND, BOUND, (CELLS, CELLS)),
        "target_elevation": spaces.Box(-BOUND, BOUND, (CELLS, CELLS)),
        "targets": spaces.Box(-BOUND, BOUND, (2, 3)),
    }
    pictures = len(episodes.task.rig.mounts), *episodes.config.cameras
    every |= {
        "depth": spaces.Box(0.0, FARTHEST, pictures),
        "color": spaces.Box(0, 255, (*pictures, 3), np.uint8),
        "labels": spaces.Box(0, 255, pictures, np.uint8),
    }
    chosen = set(episodes.config.observe)
    if episodes.task.wrist_goals:
        chosen |= {"targets", "target_elevation"} if "elevation" in chosen else {"targets"}
    return spaces.Dict({name: space for name, space in every.items() if name in chosen})


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
