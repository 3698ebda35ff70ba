"""Per-frame differential inverse kinematics with `mink`, the usual way of open retargeting tools: the other thing
that we are measured against.

Every frame is solved for itself, from the frame before: quadratic programs that bring the same links to the same
targets as `optimization` within the joint limits. Nothing joins the frames. `mink` is optional (`pip install
mimicbench[bench]`).
"""

from importlib import import_module
from typing import Any

import mujoco
import numpy as np

from mimicbench.core.errors import MimicbenchError
from mimicbench.retarget.kinematics import Pose
from mimicbench.retarget.methods.optimization import Problem
from mimicbench.robots.description import Robot
from mimicbench.sim.scene import add_links

DT = 0.02
"""[s] Of one step; only the product of velocity and step matters."""
DAMPING = 1e-3


def load_mink() -> Any:
    """The library. Raises MimicbenchError if it is not installed."""
    try:
        return import_module("mink")
    except ImportError:
        raise MimicbenchError(
            "the comparison with per-frame inverse kinematics needs mink; run `pip install 'mimicbench[bench]'`"
        ) from None


def solve_frames(
    problem: Problem, robot: Robot, start: Pose, steps: int = 10, enough: float = 1e-3
) -> tuple[Pose, float]:
    """Follow the targets of an optimization problem frame by frame.

    Args:
        problem: Its links, targets and weights; without wrists and soles, that are no frames of links.
        robot: Whose links and joint limits.
        start: Only its first frame is used.
        steps: At most so many quadratic programs per frame.
        enough: A frame is done when a step moves nothing by more than this [m], [rad].

    Returns:
        The configurations, and how many programs a frame took in the mean.
    """
    mink = load_mink()
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    add_links(spec, robot)
    configuration = mink.Configuration(spec.compile())
    qpos = np.concatenate([start.root_pos[0], start.root_quat[0], start.joints[0]])
    configuration.update(qpos)
    weight_of_turn = dict(zip(problem.turn_links.tolist(), problem.turn_weights.tolist(), strict=True))
    column_of_turn = {int(link): column for column, link in enumerate(problem.turn_links)}
    followed = [
        column for column in range(len(problem.point_links) - problem.soles) if not problem.point_offsets[column].any()
    ]
    unit = problem.point_weights.max()
    tasks = [
        mink.FrameTask(
            robot.link_names[link],
            "body",
            position_cost=float(np.sqrt(problem.point_weights[column] / unit)),
            orientation_cost=float(np.sqrt(weight_of_turn.get(link, 0.0) / unit)),
        )
        for column in followed
        if (link := int(problem.point_links[column])) >= 0
    ]
    limits = [mink.ConfigurationLimit(configuration.model)]
    frames, programs = len(problem.point_targets), 0
    found = np.empty((frames, len(qpos)))
    for frame in range(frames):
        for task, column in zip(tasks, followed, strict=True):
            turn = column_of_turn.get(int(problem.point_links[column]))
            quat = problem.turn_targets[frame, turn] if turn is not None else np.array([1.0, 0.0, 0.0, 0.0])
            task.set_target(mink.SE3(np.concatenate([quat, problem.point_targets[frame, column]])))
        for _ in range(steps):
            velocity = mink.solve_ik(configuration, tasks, DT, "daqp", damping=DAMPING, limits=limits)
            configuration.integrate_inplace(velocity, DT)
            programs += 1
            if np.abs(velocity).max() * DT < enough:
                break
        found[frame] = configuration.q
    joints = np.clip(found[:, 7:], problem.limits[:, 0], problem.limits[:, 1])
    return Pose(
        found[:, :3], found[:, 3:7] / np.linalg.norm(found[:, 3:7], axis=-1, keepdims=True), joints
    ), programs / frames
