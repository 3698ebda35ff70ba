"""A robot's mappings from human skeletons with all names looked up, and how the frames of both relate."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion, UnknownName
from mimicbench.core.skeleton import Skeleton, forward_kinematics
from mimicbench.robots.description import Robot
from mimicbench.robots.mapping import Mapping, Pair

Preset = Literal["paper", "improved"]


@dataclass(frozen=True)
class Bound:
    """A mapping with names looked up: K pairs of positions, and K of orientations."""

    joints: np.ndarray
    """(K,) human joint of each position pair."""
    links: np.ndarray
    """(K,) robot link of each position pair."""
    shifts: np.ndarray
    """(K, 3) from the human joint to the point that the link follows [m]."""
    frames: np.ndarray
    """(K,) human joint whose axes each shift is in."""
    weights: np.ndarray
    """(K,) of the squared position errors."""
    lowered: np.ndarray
    """(K,) share that each target takes of the drop of a body with shorter legs."""
    turn_joints: np.ndarray
    """(K,) human joint of each orientation pair."""
    turn_links: np.ndarray
    """(K,) robot link of each orientation pair."""
    turn_offsets: np.ndarray
    """(K, 4) q_link = q_joint * offset when the two bodies stand alike, arms down."""
    carriers: tuple[tuple[int, int], ...]
    """Human joint and carrier link, each carrier once, in the robot's order: what a start by copied rotations needs."""
    carrier_offsets: np.ndarray
    """(C, 4) as turn_offsets, for the carriers."""
    wrists: tuple[tuple[int, int, np.ndarray], ...]
    """Human joint, robot link and point (3,) in the link frame [m] of each wrist."""
    feet: tuple[tuple[int, int], ...]
    """Human joint and robot link of each foot."""
    legs: tuple[tuple[int, int, int], ...]
    """Links of the middle of the hip, of the knee and of the foot, of each leg in the order of `feet`."""
    sole: np.ndarray
    """(P, 3) points of the sole in the foot link's frame [m]."""


def find_mapping(skeleton: str, robot: Robot) -> Mapping:
    """The robot's mapping from a human skeleton. Raises UnknownName."""
    found = {mapping.skeleton: mapping for mapping in robot.mappings}
    if skeleton not in found:
        raise UnknownName(f"skeleton for {robot.name}", skeleton, list(found))
    return found[skeleton]


def bind(mapping: Mapping, skeleton: Skeleton, robot: Robot, preset: Preset = "improved") -> Bound:
    """Look up a mapping's names in a skeleton and a robot.

    Constant frame offsets come from both in the pose with arms down.

    `paper` is the table to the letter: every pair at the joints themselves, of equal weight, positions and orientations
    alike.
    """
    pairs = (
        tuple(Pair(pair.joint, pair.link, pair.link) for pair in mapping.pairs) if preset == "paper" else mapping.pairs
    )
    joints, links = (
        np.array([skeleton.index(pair.joint) for pair in pairs]),
        np.array([_link(robot, pair.link) for pair in pairs]),
    )
    turn_links = np.array([_link(robot, pair.carrier) for pair in pairs])
    # The human's joint frames are all parallel to the world in its rest pose, so the robot's link orientations are the
    # offsets.
    arms_down = np.array([robot.arms_down.get(name, 0.0) for name in robot.joint_names])
    rest, offsets = robot.forward_kinematics(np.zeros(3), rot.IDENTITY, arms_down)
    human_rest, _ = forward_kinematics(skeleton, np.zeros(3), np.tile(rot.IDENTITY, (len(skeleton.joint_names), 1)))
    shifts, size = np.array([pair.shift for pair in pairs]), mapping.size_of(skeleton)
    for i, pair in enumerate(pairs):
        if pair.surface:
            shifts[i, 2] += pair.surface[0] - pair.surface[1] * size
        if pair.at_rest:
            shifts[i] += (rest[links[i]] - rest[links[0]]) - (human_rest[joints[i]] - human_rest[joints[0]]) + shifts[0]
    carriers = sorted(
        {_link(robot, pair.carrier): skeleton.index(pair.turned_by or pair.joint) for pair in mapping.pairs}.items()
    )
    wrists = []
    for joint, name in mapping.wrists:
        if name not in robot.keypoints:
            raise UnknownName("keypoint", name, list(robot.keypoints))
        link, point = robot.keypoints[name]
        wrists.append((skeleton.index(joint), link, np.array(point)))
    return Bound(
        joints=joints,
        links=links,
        shifts=shifts,
        frames=np.array([skeleton.index(pair.frame or pair.joint) for pair in pairs]),
        weights=np.array([pair.weight for pair in pairs]),
        lowered=np.array([pair.lowered for pair in pairs]),
        turn_joints=np.array([skeleton.index(pair.turned_by or pair.joint) for pair in pairs]),
        turn_links=turn_links,
        turn_offsets=offsets[turn_links],
        carriers=tuple((joint, link) for link, joint in carriers),
        carrier_offsets=offsets[[link for link, _ in carriers]],
        wrists=tuple(wrists),
        feet=tuple((skeleton.index(joint), _link(robot, link)) for joint, link in mapping.feet),
        legs=_legs(mapping, robot),
        sole=np.array(mapping.sole),
    )


def followed_points(bound: Bound, pos_w: np.ndarray, quat_w: np.ndarray) -> np.ndarray:
    """World points (T, K, 3) [m] that the links follow, from the human's joint poses (T, J, 3) and (T, J, 4)."""
    return pos_w[:, bound.joints] + rot.rotate(quat_w[:, bound.frames], bound.shifts)


def _legs(mapping: Mapping, robot: Robot) -> tuple[tuple[int, int, int], ...]:
    """Links of hip, knee and foot of each leg, in the order of the mapping's feet."""
    found = {foot: (_link(robot, hip), _link(robot, knee), _link(robot, foot)) for hip, knee, foot in robot.legs}
    for _, foot in mapping.feet:
        if foot not in found:
            raise BadMotion(f"robot {robot.name} has no leg that ends in {foot!r}; its legs end in {', '.join(found)}")
    return tuple(found[foot] for _, foot in mapping.feet)


def _link(robot: Robot, name: str) -> int:
    if name not in robot.link_names:
        raise BadMotion(f"robot {robot.name} has no link {name!r}; it has {', '.join(robot.link_names)}")
    return robot.link_names.index(name)
