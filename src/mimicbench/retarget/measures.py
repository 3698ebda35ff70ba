"""What a retargeted clip says of its own quality."""

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.retarget.grounding import sole_heights
from mimicbench.retarget.kinematics import Links, Pose
from mimicbench.retarget.mapping import Bound, followed_points
from mimicbench.robot.description import Robot


def measure(
    links: Links, pose: Pose, bound: Bound, robot: Robot, human_pos_w: np.ndarray, human_quat_w: np.ndarray, fps: float, standing: np.ndarray
) -> dict[str, float]:
    """Quality of a robot motion against the human joint poses (T, J, 3) and (T, J, 4) that it came from.

    Args:
        links: Poses of all links.
        pose: Root and joints.
        bound: The mapping.
        robot: Its limits.
        human_pos_w: Human joint positions [m].
        human_quat_w: Human joint orientations.
        fps: Frames per second.
        standing: (T, F) stance of each foot.

    Returns:
        frames; position_error and ankle_error: means over frames of the distance to the point that each link follows [m], of all pairs and of the
        feet; orientation_error: mean angle of the pairs [rad]; limit_violation: largest excess over a joint limit [rad], 0 by construction;
        velocity_ratio: largest joint velocity as a part of its limit; acceleration: mean |joint acceleration| [rad/s^2]; skate: mean horizontal
        speed of feet in stance [m/s]; human_skate: the same of the human's; sole_height and sole_depth: mean |height| of soles in stance, and
        deepest point of a sole under the floor at any time [m]; sole_tilt: mean angle between a stance sole and the floor [rad]; knee: mean knee
        bend while a foot stands and the pelvis moves faster than 0.3 m/s, that is in walking [rad] (0 where there is no walking).
    """
    targets = followed_points(bound, human_pos_w, human_quat_w)
    errors = np.linalg.norm(links.pos[:, bound.links] - targets, axis=-1)
    is_foot = np.isin(bound.links, [link for _, link in bound.feet])
    turns = rot.angle_between(links.quat[:, bound.turn_links], rot.multiply(human_quat_w[:, bound.turn_joints], bound.turn_offsets))
    limits = robot.joint_range
    excess = np.maximum(pose.joints - limits[:, 1], limits[:, 0] - pose.joints)
    velocity = np.abs(np.diff(pose.joints, axis=0)) * fps
    acceleration = np.abs(np.diff(pose.joints, 2, axis=0)) * fps**2
    feet = [link for _, link in bound.feet]
    heights = sole_heights(links, bound)
    up = rot.rotate(links.quat[:, feet], np.array([0.0, 0.0, 1.0]))[..., 2]
    walking = np.linalg.norm(np.gradient(pose.root_pos[:, :2], axis=0), axis=-1) * fps > 0.3
    knees = [list(robot.joint_link).index(robot.link_parents[link]) for link in feet]  # the joint that drives a foot's parent is its knee
    bend = pose.joints[:, knees][walking[:, None] & standing]
    return {
        "frames": float(len(pose.joints)),
        "position_error": float(errors.mean()),
        "ankle_error": float(errors[:, is_foot].mean()),
        "orientation_error": float(turns.mean()),
        "limit_violation": float(max(0.0, excess.max())),
        "velocity_ratio": float((velocity / robot.velocity_limit).max()),
        "acceleration": float(acceleration.mean()) if acceleration.size else 0.0,
        "skate": _skate(links.pos[:, feet], standing, fps),
        "human_skate": _skate(human_pos_w[:, [joint for joint, _ in bound.feet]], standing, fps),
        "sole_height": _mean(np.abs(heights[standing])),
        "sole_depth": float(max(0.0, -heights.min())),
        "sole_tilt": _mean(np.arccos(np.clip(up[standing], -1.0, 1.0))),
        "knee": _mean(bend),
    }


def _skate(pos_w: np.ndarray, standing: np.ndarray, fps: float) -> float:
    """Mean horizontal speed [m/s] of points (T, F, 3) between frames in both of which they stand."""
    speed = np.linalg.norm(np.diff(pos_w[..., :2], axis=0), axis=-1) * fps
    return _mean(speed[standing[1:] & standing[:-1]])


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if values.size else 0.0
