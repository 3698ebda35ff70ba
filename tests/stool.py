"""What several tests start from: a stool, and an H1 that stands before it or sits on it."""

import numpy as np
import torch

from mimicbench.core import rotations as rot
from mimicbench.objects.shape import SceneObject
from mimicbench.robots.registry import ROBOTS
from mimicbench.sim.physics import RobotState
from mimicbench.sim.rows import Rows

H1 = ROBOTS.get("h1")
JOINT = {name.removesuffix("_joint"): i for i, name in enumerate(H1.joint_names)}


def block(height=0.42, half=0.25, movable=False, mass=None):
    """A stool: one box."""
    ones = np.ones((1, 3))
    square = half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return SceneObject(
        f"block-{height}-{movable}",
        "chair",
        "stool",
        np.array([[0, 0, height / 2]]),
        rot.IDENTITY[None],
        np.array([[half, half, height / 2]]),
        0.5 * ones,
        height,
        square,
        movable=movable,
        mass=mass,
    )


def seated(height):
    """Root position and joints of an H1 that sits upright on a seat, thighs level, shanks upright."""
    joints = np.zeros(19)
    for side in ("left", "right"):
        joints[JOINT[f"{side}_hip_pitch"]], joints[JOINT[f"{side}_knee"]] = -np.pi / 2, np.pi / 2
    return np.array([0.0, 0.0, height + 0.237]), joints


def standing():
    """Root position and joints of an H1 that stands in front of a stool, soles just above the floor."""
    joints = np.array(H1.rest_pose)
    pos, quat = H1.forward_kinematics(np.zeros(3), rot.IDENTITY, joints)
    return np.array([-1.2, 0.0, -H1.keypoint_pos("left_sole", pos, quat)[2] + 0.005]), joints


def place(physics, pos, joints, **velocities):
    """Put all robots of a simulation into one pose."""
    n = physics.num_envs
    put(
        physics,
        np.arange(n),
        np.tile(pos, (n, 1)),
        np.tile(rot.IDENTITY, (n, 1)),
        np.tile(joints, (n, 1)),
        **velocities,
    )


def put(physics, ids, *state, **velocities):
    """Put the robots of scenes `ids` into a state given as arrays."""
    rows = Rows.of(list(ids), physics.num_envs, physics.device)
    physics.reset(rows, RobotState.of(*state, **velocities, device=physics.device))


def exchange(physics, objects, ids=None):
    """Exchange the objects of scenes `ids`, all by default."""
    rows = Rows.of(list(range(physics.num_envs) if ids is None else ids), physics.num_envs, physics.device)
    physics.set_objects(rows, torch.tensor(physics.add_objects(objects), device=physics.device))
