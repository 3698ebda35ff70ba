"""What a retargeted clip says of its own quality."""

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.motion import HumanMotion
from mimicbench.objects.shape import SceneObject
from mimicbench.retarget.grounding import FEET, runs, sole_heights
from mimicbench.retarget.kinematics import Links, Pose
from mimicbench.retarget.mapping import Bound, followed_points
from mimicbench.retarget.samples import Balls, Masses, Scene, balls_of
from mimicbench.retarget.self_contact import SelfContact
from mimicbench.retarget.trunk import TRUNK, bears, head_rests, trunk_rests, trunk_up
from mimicbench.robots.description import Robot
from mimicbench.robots.mapping import Mapping

DEEP, CLOSE = 0.01, 0.02
"""[m] What counts as penetration, and as contact."""
NO_NECK = 0.08
"""[m] What counts as contact of a head: with the back flat the head of a robot that cannot bend its neck is in the
air."""


def measure(
    links: Links,
    pose: Pose,
    bound: Bound,
    robot: Robot,
    human_pos_w: np.ndarray,
    human_quat_w: np.ndarray,
    fps: float,
    standing: np.ndarray,
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
        frames; position_error and ankle_error: means over frames of the distance to the point that each link follows
        [m], of all pairs and of the feet; wrist_error and pelvis_error: the same between wrist keypoints and the
        human's wrist joints, and between root link and the human's pelvis joint, without any shift; orientation_error:
        mean angle of the pairs [rad]; limit_violation: largest excess over a joint limit [rad], 0 by construction;
        velocity_ratio: largest joint velocity as a part of its limit; acceleration: mean |joint acceleration|
            [rad/s^2]; skate: mean horizontal
        speed of feet in stance [m/s]; human_skate: the same of the human's; sole_height and sole_depth: mean |height|
        of soles in stance, and deepest point of a sole under the floor at any time [m]; sole_tilt: mean angle between a
        stance sole and the floor [rad]; knee: mean knee bend while a foot stands and the pelvis moves faster than 0.3
        m/s, that is in walking [rad] (0 where there is no walking).
    """
    return {
        "frames": float(len(pose.joints)),
        **_distances(links, bound, human_pos_w, human_quat_w),
        **_efforts(pose, robot, fps),
        **_steps(links, pose, bound, robot, standing, fps, human_pos_w),
    }


def _distances(links: Links, bound: Bound, human_pos_w: np.ndarray, human_quat_w: np.ndarray) -> dict[str, float]:
    """How far links are from what they follow."""
    targets = followed_points(bound, human_pos_w, human_quat_w)
    errors = np.linalg.norm(links.pos[:, bound.links] - targets, axis=-1)
    is_foot = np.isin(bound.links, [link for _, link in bound.feet])
    wrists = [
        np.linalg.norm(place - human_pos_w[:, joint], axis=-1)
        for (joint, *_), place in zip(bound.wrists, wrist_points(links, bound), strict=True)
    ]
    turns = rot.angle_between(
        links.quat[:, bound.turn_links], rot.multiply(human_quat_w[:, bound.turn_joints], bound.turn_offsets)
    )
    pelvis = np.linalg.norm(links.pos[:, bound.links[0]] - human_pos_w[:, bound.joints[0]], axis=-1)
    return {
        "position_error": float(errors.mean()),
        "ankle_error": float(errors[:, is_foot].mean()),
        "wrist_error": float(np.mean(wrists)),
        "pelvis_error": float(pelvis.mean()),
        "orientation_error": float(turns.mean()),
    }


def _efforts(pose: Pose, robot: Robot, fps: float) -> dict[str, float]:
    """What is asked of the joints."""
    limits = robot.joint_range
    excess = np.maximum(pose.joints - limits[:, 1], limits[:, 0] - pose.joints)
    velocity = np.abs(np.diff(pose.joints, axis=0)) * fps
    acceleration = np.abs(np.diff(pose.joints, 2, axis=0)) * fps**2
    return {
        "limit_violation": float(max(0.0, excess.max())),
        "velocity_ratio": float((velocity / robot.velocity_limit).max()),
        "acceleration": float(acceleration.mean()) if acceleration.size else 0.0,
    }


def _steps(
    links: Links, pose: Pose, bound: Bound, robot: Robot, standing: np.ndarray, fps: float, human_pos_w: np.ndarray
) -> dict[str, float]:
    """How feet stand, and knees bend in walking."""
    feet = [link for _, link in bound.feet]
    heights = sole_heights(links, bound)
    up = rot.rotate(links.quat[:, feet], np.array([0.0, 0.0, 1.0]))[..., 2]
    walking = np.linalg.norm(np.gradient(pose.root_pos[:, :2], axis=0), axis=-1) * fps > 0.3
    knees = [list(robot.joint_link).index(knee) for _, knee, _ in bound.legs]
    bend = pose.joints[:, knees][walking[:, None] & standing]
    return {
        "skate": _skate(links.pos[:, feet], standing, fps),
        "human_skate": _skate(human_pos_w[:, [joint for joint, _ in bound.feet]], standing, fps),
        "sole_height": _mean(np.abs(heights[standing])),
        "sole_depth": float(max(0.0, -heights.min())),
        "sole_tilt": _mean(np.arccos(np.clip(up[standing], -1.0, 1.0))),
        "knee": _mean(bend),
    }


def measure_scene(
    links: Links,
    robot: Robot,
    mapping: Mapping,
    bound: Bound,
    motion: HumanMotion,
    obj: SceneObject,
    standing: np.ndarray,
) -> dict[str, float]:
    """What a robot motion does with floor and object.

    Args:
        links: Poses of all links.
        robot: Its shapes and masses.
        mapping: Which links bear for which part of the body.
        bound: The same with names looked up.
        motion: The human clip, for its contact labels and the object's track.
        obj: The object.
        standing: (T, F) stance of each foot.

    Returns:
        penetration: share of frames in which some collision shape is more than DEEP in floor or object; depth: the
            deepest ever [m];
        goal_error: how near both wrists ever come to their goals, the larger of the two distances [m], 0 without
            goals; contact_kept: share of
        the labeled contacts (pelvis, back, hands, feet; frame by frame) in which the robot's part is within CLOSE of
        floor or object, 1 without labels; step_skate: farthest that a sole moves while it stands, mean over steps [m];
        balance: mean distance of the center of mass from the strip between heels and toes while both feet alone bear
        [m]; self_collision: share of frames in which the robot's own shapes that may collide are more than DEEP in each
        other; support_lost: of pelvis, back and head, that of whose time on the object most is lost, as a share of the
        frames in which the person's rests there and the robot's (thighs count as the pelvis) does not; lean_error:
        angle between the robot's trunk and the person's while pelvis or back bears, mean over that time or over its
        last second, whichever is more [rad].
    """
    balls, scene = balls_of(robot), Scene.of(motion, obj)
    centers = balls.place(links)
    distance, _ = scene.clearance(balls, centers)
    depth = -distance.min(-1)
    return {
        "penetration": float((depth > DEEP).mean()),
        "depth": float(max(0.0, depth.max())),
        "goal_error": _goal_error(links, bound, motion.wrist_goal_w),
        "contact_kept": _contact_kept(robot, mapping, motion, balls, distance),
        "step_skate": _step_skate(links, bound, standing),
        "balance": _balance(links, robot, bound, motion, standing),
        "self_collision": float((_self_depth(robot, links, balls, centers) > DEEP).mean()),
        "support_lost": _support_lost(robot, mapping, motion, obj, balls, distance),
        "lean_error": _lean_error(robot, mapping, links, motion),
    }


def _contact_kept(robot: Robot, mapping: Mapping, motion: HumanMotion, balls: Balls, distance: np.ndarray) -> float:
    """Share of the labeled contacts in which the robot's part is near enough; `distance` (T, S) is of the balls [m]."""
    kept, labeled = 0, 0
    for column, name in enumerate(motion.contact_names):
        when = motion.contacts[:, column].astype(bool)
        which = np.isin(balls.link, [robot.link_names.index(link) for link in mapping.bearers.get(name, ())])
        if which.any():
            labeled += int(when.sum())
            kept += int((distance[when][:, which].min(-1) < CLOSE).sum())
    return kept / labeled if labeled else 1.0


def _step_skate(links: Links, bound: Bound, standing: np.ndarray) -> float:
    """Farthest that a sole moves while it stands, mean over steps [m]."""
    feet = [link for _, link in bound.feet]
    soles = links.pos[:, feet] + rot.rotate(links.quat[:, feet], bound.sole.mean(0))
    moved = [
        np.linalg.norm(np.ptp(soles[a:b, foot, :2], axis=0))
        for foot in range(len(feet))
        for a, b in runs(standing[:, foot])
    ]
    return float(np.mean(moved)) if moved else 0.0


def wrist_points(links: Links, bound: Bound) -> list[np.ndarray]:
    """(T, 3) of each wrist keypoint [m], left first."""
    return [links.pos[:, link] + rot.rotate(links.quat[:, link], point) for _, link, point in bound.wrists]


def _goal_error(links: Links, bound: Bound, goals_w: np.ndarray) -> float:
    """Least over frames of the larger distance of the wrists from their goals (2, 3) [m]; 0 without goals."""
    if not len(goals_w):
        return 0.0
    away = [
        np.linalg.norm(place - goal, axis=-1) for place, goal in zip(wrist_points(links, bound), goals_w, strict=True)
    ]
    return float(np.nanmax(away, 0).min())


def _balance(links: Links, robot: Robot, bound: Bound, motion: HumanMotion, standing: np.ndarray) -> float:
    """Mean distance of the center of mass from over the feet while both, and nothing else, bear [m].

    Along the feet's mean direction.
    """
    others = [column for column, name in enumerate(motion.contact_names) if name not in FEET]
    alone = (
        standing.all(-1) & ~motion.contacts[:, others].astype(bool).any(-1)
        if motion.contacts.size
        else standing.all(-1)
    )
    if not alone.any():
        return 0.0
    feet = [link for _, link in bound.feet]
    heading = rot.rotate(links.quat[:, feet], np.array([1.0, 0.0, 0.0])).mean(1)
    ahead = ((Masses.of(robot).center(links) - links.pos[:, feet].mean(1)) * heading)[:, :2].sum(-1)[alone]
    low, high = bound.sole[:, 0].min(), bound.sole[:, 0].max()
    return float(np.abs(ahead - np.clip(ahead, low, high)).mean())


def _support_lost(
    robot: Robot, mapping: Mapping, motion: HumanMotion, obj: SceneObject, balls: Balls, distance: np.ndarray
) -> float:
    """Most that pelvis, back or head lose of their time on the object; `distance` (T, S) is of the balls [m]."""
    rests = trunk_rests(motion)
    parts = [
        (bears(motion, name), np.isin(balls.link, [robot.link_names.index(link) for link in mapping.bearers[name]]))
        for name in TRUNK
    ]
    lost = [
        float((distance[when][:, which].min(-1) >= CLOSE).mean()) for when, which in parts if when.any() and which.any()
    ]
    when, which = rests & head_rests(motion, obj), balls.group == "head"
    if when.any() and which.any():
        lost.append(float((distance[when][:, which].min(-1) >= NO_NECK).mean()))
    return max(lost, default=0.0)


def _lean_error(robot: Robot, mapping: Mapping, links: Links, motion: HumanMotion) -> float:
    """Of the trunk, 0 of who neither sits nor lies [rad]."""
    rests = np.flatnonzero(trunk_rests(motion))
    if not len(rests):
        return 0.0
    trunk = links.quat[rests, robot.link_names.index(mapping.trunk)]
    up = rot.rotate(trunk, np.array([0.0, 0.0, 1.0]))
    error = np.arccos(np.clip((up * trunk_up(motion)[rests]).sum(-1), -1.0, 1.0))
    return float(max(error.mean(), error[-max(1, round(motion.fps)) :].mean()))


def _self_depth(robot: Robot, links: Links, balls: Balls, centers: np.ndarray) -> np.ndarray:
    """(T,) how deep the robot's shapes are in each other, of the pairs of groups that may collide [m]."""
    deepest, found = np.zeros(len(centers)), SelfContact.of(robot, balls).overlaps(links, centers)
    np.maximum.at(deepest, found.frame, found.depth)
    return deepest


def _skate(pos_w: np.ndarray, standing: np.ndarray, fps: float) -> float:
    """Mean horizontal speed [m/s] of points (T, F, 3) between frames in both of which they stand."""
    speed = np.linalg.norm(np.diff(pos_w[..., :2], axis=0), axis=-1) * fps
    return _mean(speed[standing[1:] & standing[:-1]])


def _mean(values: np.ndarray) -> float:
    return float(values.mean()) if values.size else 0.0
