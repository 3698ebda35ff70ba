"""Clips in the files of whole_body_tracking (BeyondMimic) and mjlab, whose trackers follow a motion by its bodies.

An `.npz` without pickles at the control rate:

    fps             (1,)         frames per second
    joint_pos       (T, N)       [rad]
    joint_vel       (T, N)       [rad/s]
    body_pos_w      (T, L, 3)    of the links' frames, world, z up [m]
    body_quat_w     (T, L, 4)    wxyz
    body_lin_vel_w  (T, L, 3)    of the links' frames' origins [m/s]
    body_ang_vel_w  (T, L, 3)    world axes [rad/s]
    joint_names     (N,)
    body_names      (L,)

Joints and bodies are in the robot's order: depth first, as MuJoCo has them and mjlab expects them. Isaac Lab goes
breadth first; whoever reads a file there has to sort by the names. What moves beside the robot is not told.
"""

from pathlib import Path

import numpy as np
import torch

from mimicbench.core.errors import BadMotion
from mimicbench.core.files import write_arrays
from mimicbench.core.motion import RobotMotion
from mimicbench.envs.reference import ReferenceBank
from mimicbench.robots.description import Robot
from mimicbench.sensors.reference import reference_links
from mimicbench.sim.timing import CONTROL_DT


def tracking_arrays(motion: RobotMotion, robot: Robot) -> dict[str, np.ndarray]:
    """The arrays of such a file, single precision: what our own trackers are given of a clip.

    Velocities are the derivatives of the clip's splines; in the last frame, where it comes to rest, they are zero.

    Raises:
        BadMotion: The clip is of another robot, or shorter than two control steps.
    """
    bank = ReferenceBank([motion], robot)
    length = int(bank.lengths[0])
    if length < 2:
        raise BadMotion(
            f"clip {motion.id} lasts {motion.duration:.3f} s; two frames at {1 / CONTROL_DT:.0f} Hz need more"
        )
    frame = bank.frame(torch.zeros(length, dtype=torch.long), torch.arange(length))
    links = reference_links(robot, frame)
    return {
        "fps": np.array([round(1 / CONTROL_DT)]),
        "joint_pos": frame.joint_pos.numpy(),
        "joint_vel": frame.joint_vel.numpy(),
        "body_pos_w": links.pos_w.numpy(),
        "body_quat_w": links.quat_w.numpy(),
        "body_lin_vel_w": links.lin_vel_w.numpy(),
        "body_ang_vel_w": links.ang_vel_w.numpy(),
        "joint_names": np.array(robot.joint_names),
        "body_names": np.array(robot.link_names),
    }


def write_tracking_file(path: Path, motion: RobotMotion, robot: Robot) -> dict[str, np.ndarray]:
    """Write a clip as such a file, atomically, and return its arrays. Raises BadMotion."""
    arrays = tracking_arrays(motion, robot)
    write_arrays(path, arrays)
    return arrays
