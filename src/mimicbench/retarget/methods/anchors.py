"""What an interaction clip must keep: where feet stand, what hands hold, and how high a body with shorter or longer
legs can be.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.references.curves import minimum_jerk, smooth_above
from mimicbench.retarget.clip import Clip
from mimicbench.retarget.grounding import FEET, runs
from mimicbench.retarget.mapping import Bound, followed_points
from mimicbench.retarget.methods.feet import clear_of_object, footprints, on_toes, shapes_of
from mimicbench.retarget.samples import Scene
from mimicbench.retarget.trunk import bears, trunk_rests
from mimicbench.robots.mapping import Mapping

HANDS = ("left_hand", "right_hand")
STRETCH = 0.98
"""Share of its length that a standing leg may have from hip to ankle: 0.4 rad of bend in the knee."""
REACHING = 0.8
"""[s] Before and after a hand's contact, over which its path is bent towards the place of contact."""
PRESS = 0.003
"""[m] How deep a hand's ball is in what it touches."""


@dataclass(frozen=True)
class Anchors:
    """Targets in T frames that come before all others."""

    foot_pos_w: np.ndarray
    """(T, F, 3) of the robot's foot links [m]; constant while a foot stands."""
    foot_quat_w: np.ndarray
    """(T, F, 4)."""
    standing: np.ndarray
    """(T, F) whether a foot stands on the floor or the object."""
    on_floor: np.ndarray
    """(T, F) whether it stands on the floor."""
    hand_pos_w: np.ndarray
    """(T, H, 3) of the robot's wrist keypoints [m]; constant in the object's frame while a hand is in contact."""
    nearness: np.ndarray
    """(T, H) 1 in contact, falling to 0 within REACHING before and after it."""
    lowering: np.ndarray
    """(T,) how much lower than the human's the robot's hips must be for its legs to reach the feet [m]."""


def anchors_of(
    clip: Clip, mapping: Mapping, bound: Bound, pos_w: np.ndarray, quat_w: np.ndarray, heels: float = 0.0
) -> Anchors:
    """The anchors of a clip, given the human's joint poses (T, J, 3) and (T, J, 4).

    Who sits has the heels raised by an angle `heels` [rad]: a robot's shanks may be too short for a high seat.
    """
    motion = clip.motion
    followed = followed_points(bound, pos_w, quat_w)
    foot_pos, foot_quat, standing, on_floor = [], [], [], []
    for label, (joint, link) in zip(FEET, bound.feet, strict=True):
        pair = bound.links.tolist().index(link)
        rests = bears(motion, label)
        human = rot.multiply(quat_w[:, joint], bound.turn_offsets[bound.turn_links.tolist().index(link)])
        clear = partial(clear_of_object, Scene.of(motion, clip.obj), shapes_of(clip, link))
        near_floor = 2.0 * mapping.ankle_height - pos_w[:, joint, 2]
        place, turn, floor = footprints(motion.fps, rests, followed[:, pair], human, bound.sole, near_floor, clear)
        if heels:
            share = smooth_above((trunk_rests(motion) & floor).astype(float), max(1, round(0.5 * motion.fps)))
            place, turn = on_toes(place, turn, bound.sole[-1], heels * share)
        foot_pos.append(place)
        foot_quat.append(turn)
        standing.append(rests)
        on_floor.append(floor)
    hands = [_hand(clip, mapping, bound, side, pos_w, quat_w) for side in range(len(bound.wrists))]
    feet = np.stack(foot_pos, 1)
    hand_pos, nearness = (np.stack(values, 1) for values in zip(*hands, strict=True))
    floor = np.stack(on_floor, 1)
    lowering = _lowering(clip, bound, followed, quat_w, feet, floor)
    return Anchors(feet, np.stack(foot_quat, 1), np.stack(standing, 1), floor, hand_pos, nearness, lowering)


def _hand(
    clip: Clip, mapping: Mapping, bound: Bound, side: int, pos_w: np.ndarray, quat_w: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Positions (T, 3) for a wrist keypoint, and (T,) how near in time a contact of the hand is."""
    motion = clip.motion
    elbow, wrist = (motion.skeleton.index(joint) for joint in mapping.forearms[side])
    forearm = pos_w[:, wrist] - pos_w[:, elbow]
    palm = pos_w[:, wrist] + forearm * (
        mapping.palm * mapping.size_of(motion.skeleton) / np.linalg.norm(forearm, axis=-1, keepdims=True)
    )
    holds = bears(motion, HANDS[side])
    scene, radius = Scene.of(motion, clip.obj), _hand_radius(clip, bound, side)
    target = pos_w[:, wrist].copy()
    near = holds.astype(float)
    reach = max(1, round(REACHING * motion.fps))
    for start, end in runs(holds):
        if len(motion.wrist_goal_w) and np.isfinite(motion.wrist_goal_w[side]).all():
            target[start:end] = motion.wrist_goal_w[side]
        else:
            target[start:end] = _grip(scene, np.arange(start, end), palm[start:end], radius)
        for edge, step in ((start, -1), (end - 1, 1)):
            frames = edge + step * np.arange(1, reach + 1)
            frames = frames[(frames >= 0) & (frames < len(holds))]
            frames = frames[~holds[frames]]
            share = 1.0 - minimum_jerk(np.abs(frames - edge) / (reach + 1.0))
            closer = share > near[frames]
            frames, share = frames[closer], share[closer]
            target[frames] = pos_w[frames, wrist] + share[:, None] * (target[edge] - pos_w[edge, wrist])
            near[frames] = share
    return target, near


def _grip(scene: Scene, frames: np.ndarray, palm_w: np.ndarray, radius: float) -> np.ndarray:
    """(n, 3) where the hand's ball is while it holds: by the place on the object that the palm is at in the median,
    and stays there.
    """
    moving = len(scene.pos_w) > 0
    pos, quat = (scene.pos_w[frames], scene.quat_w[frames]) if moving else (np.zeros(3), rot.IDENTITY)
    local = np.median(rot.rotate_inverse(quat, palm_w - pos), 0)
    still = Scene(scene.obj, np.zeros((0, 3)), np.zeros((0, 4)))
    distance, normal = still.object_distance(np.zeros(1, int), local[None])
    if not np.isfinite(distance[0]):
        return palm_w
    center = local + normal[0] * (radius - PRESS - distance[0])
    return pos + rot.rotate(quat, np.broadcast_to(center, palm_w.shape))


def _hand_radius(clip: Clip, bound: Bound, side: int) -> float:
    """Radius of the collision shape at the wrist keypoint [m]."""
    _, link, point = bound.wrists[side]
    shapes = [shape for shape in clip.robot.collision if shape.link == link]
    return (
        min(shapes, key=lambda shape: float(np.linalg.norm(np.array(shape.end or shape.start) - point))).size[0]
        if shapes
        else 0.0
    )


def _lowering(
    clip: Clip, bound: Bound, followed: np.ndarray, quat_w: np.ndarray, feet: np.ndarray, on_floor: np.ndarray
) -> np.ndarray:
    """(T,) smooth, and nowhere less than the legs need."""
    robot = clip.robot
    pelvis = followed[:, bound.links.tolist().index(0)]
    turn = rot.multiply(quat_w[:, 0], bound.turn_offsets[bound.turn_links.tolist().index(0)])
    rest, _ = robot.forward_kinematics(np.zeros(3), rot.IDENTITY, np.zeros(len(robot.joint_names)))
    need = np.zeros(len(pelvis))
    for foot, (hip, knee, ankle) in enumerate(bound.legs):
        leg = STRETCH * (robot.reach(hip, knee) + robot.reach(knee, ankle))
        at = pelvis + rot.rotate(turn, rest[hip])
        away = ((at[:, :2] - feet[:, foot, :2]) ** 2).sum(-1)
        highest = feet[:, foot, 2] + np.sqrt(np.maximum(leg**2 - away, 0.25 * leg**2))
        need = np.maximum(need, np.where(on_floor[:, foot], at[:, 2] - highest, 0.0))
    return smooth_above(need, max(1, round(0.2 * clip.motion.fps)))
