"""What an interaction clip must keep: where feet stand, what hands hold, and how high a body with shorter or longer
legs can be.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.references.curves import minimum_jerk, smooth_above
from mimicbench.retarget.clip import Clip
from mimicbench.retarget.grounding import FEET, runs
from mimicbench.retarget.mapping import Bound, followed_points
from mimicbench.retarget.samples import Scene, balls_of
from mimicbench.retarget.trunk import bears, trunk_rests
from mimicbench.robots.mapping import Mapping

HANDS = ("left_hand", "right_hand")
STRETCH = 0.98
"""Share of its length that a standing leg may have from hip to ankle: 0.4 rad of bend in the knee."""
REACHING = 0.8
"""[s] Before and after a hand's contact, over which its path is bent towards the place of contact."""
FOOT_CLEAR = 0.004
"""[m] Between a standing foot and the object."""
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
    holding: np.ndarray
    """(T, H) whether a hand is in contact."""
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
        clear = partial(_clear_of_object, Scene.of(motion, clip.obj), _shapes_of(clip, link))
        place, turn, floor = _foot(
            motion.fps,
            rests,
            followed[:, pair],
            human,
            -float(bound.sole[:, 2].min()),
            pos_w[:, joint, 2],
            mapping,
            clear,
        )
        if heels:
            share = smooth_above((trunk_rests(motion) & floor).astype(float), max(1, round(0.5 * motion.fps)))
            place, turn = on_toes(place, turn, bound.sole[-1], heels * share)
        foot_pos.append(place)
        foot_quat.append(turn)
        standing.append(rests)
        on_floor.append(floor)
    hands = [_hand(clip, mapping, bound, side, pos_w, quat_w) for side in range(len(bound.wrists))]
    feet = np.stack(foot_pos, 1)
    hand_pos, holding, nearness = (np.stack(values, 1) for values in zip(*hands, strict=True))
    floor = np.stack(on_floor, 1)
    lowering = _lowering(clip, bound, followed, quat_w, feet, floor)
    return Anchors(feet, np.stack(foot_quat, 1), np.stack(standing, 1), floor, hand_pos, holding, nearness, lowering)


def _foot(
    fps: float,
    bears: np.ndarray,
    followed: np.ndarray,
    human: np.ndarray,
    sole: float,
    ankle_height: np.ndarray,
    mapping: Mapping,
    clear: Callable[[int, np.ndarray, np.ndarray], np.ndarray],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions (T, 3) and orientations (T, 4) of a foot that is still while it bears, and (T,) whether that is on
    the floor.

    Standing, it is flat where the human's is flattest; swinging, it follows the human's path, bent so that it leaves
    and arrives there.
    """
    frames = len(bears)
    level = rot.from_yaw(rot.yaw_of(human))
    tilt = rot.angle_between(human, level)
    place, turn, floor = followed.copy(), human.copy(), np.zeros(frames, bool)
    standing = runs(bears)
    for start, end in standing:
        flattest = start + np.flatnonzero(tilt[start:end] <= tilt[start:end].min() + 0.02)
        at = np.median(followed[flattest], 0)
        if ankle_height[flattest].min() < 2.0 * mapping.ankle_height:
            floor[start:end] = True
            at[2] = sole
            heading = level[flattest]
            turn[start:end] = rot.normalize((heading * np.sign((heading * heading[:1]).sum(-1, keepdims=True))).mean(0))
            at = clear(start, at, turn[start])
        place[start:end] = at
    moved = place - followed
    edges = [0, *[edge for run in standing for edge in run], frames]
    for start, end in zip(edges[::2], edges[1::2], strict=True):  # the swings
        if start == end:
            continue
        before = moved[start - 1] if start > 0 else (moved[end] if end < frames else np.zeros(3))
        after = moved[end] if end < frames else before
        u = (np.arange(start, end) - start + 1.0) / (end - start + 1.0)
        place[start:end] = followed[start:end] + before + minimum_jerk(u)[:, None] * (after - before)
        # the foot leaves and arrives flat
        free = np.minimum(1.0, np.minimum(u, 1 - u) * (end - start + 1.0) / fps / 0.12)
        turn[start:end] = rot.slerp(level[start:end], human[start:end], free)
    return place, turn, floor


def on_toes(place: np.ndarray, turn: np.ndarray, toe: np.ndarray, angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A foot's positions (T, 3) and orientations (T, 4), pitched by angles (T,) [rad] about its toe (3,) [m]."""
    pitched = rot.multiply(turn, rot.from_rotvec(angle[:, None] * np.array([0.0, 1.0, 0.0])))
    return place + rot.rotate(turn, toe) - rot.rotate(pitched, toe), pitched


def _shapes_of(clip: Clip, link: int) -> tuple[np.ndarray, np.ndarray]:
    """Centers (S, 3) and radii (S,) of the balls of one link [m]."""
    balls = balls_of(clip.robot)
    return balls.center[balls.link == link], balls.radius[balls.link == link]


def _clear_of_object(
    scene: Scene, shapes: tuple[np.ndarray, np.ndarray], frame: int, place: np.ndarray, turn: np.ndarray
) -> np.ndarray:
    """A foot's place (3,) moved sideways until it is out of the object: a robot's foot is longer than a person's."""
    centers, radii = shapes
    for _ in range(12):
        points = place + rot.rotate(turn, centers)
        distance, normal = scene.object_distance(np.full(len(points), frame), points)
        distance = distance - radii - FOOT_CLEAR
        worst = int(distance.argmin())
        way = normal[worst] * [1.0, 1.0, 0.0]
        if distance[worst] >= 0 or np.linalg.norm(way) < 0.5:
            break
        place = place - way / np.linalg.norm(way) * (distance[worst] - 1e-4)
    return place


def _hand(
    clip: Clip, mapping: Mapping, bound: Bound, side: int, pos_w: np.ndarray, quat_w: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions (T, 3) for a wrist keypoint, (T,) whether the hand is in contact, and (T,) how near in time a
    contact is.
    """
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
    return target, holds, near


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
