"""Which robot link stands for which human joint (appendix B.1), and how their frames relate."""

from collections.abc import Mapping as Dictionary
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion, UnknownName
from mimicbench.core.motion import Skeleton
from mimicbench.robot.description import Robot

Preset = Literal["paper", "improved"]


@dataclass(frozen=True)
class Pair:
    """A human joint and the robot link that takes its place."""

    joint: str
    """Human joint."""
    link: str
    """Robot link whose position (and, in `paper`, orientation) follows the human joint."""
    carrier: str
    """The link after the last of the robot's joints that together make this human joint: only there does the joint's full rotation arrive."""
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Point that the link follows, in the human joint's frame [m]; the joint itself in `paper`."""
    weight: float = 1.0
    """Weight of the squared position error; 1 in `paper`."""
    turned_by: str | None = None
    """Human joint that the carrier's orientation follows, if not `joint`; not used in `paper`."""


@dataclass(frozen=True)
class Mapping:
    """A table of pairs between one human skeleton and one robot, with the points that matter beyond it."""

    skeleton: str
    robot: str
    leg: tuple[str, str, str]
    """Human hip, knee and ankle of one leg: their rest length tells the body size."""
    leg_length: float
    """That length at size 1 [m]."""
    pairs: tuple[Pair, ...]
    wrists: tuple[tuple[str, str], ...]
    """Human joint and robot keypoint of each wrist, for L_hand."""
    feet: tuple[tuple[str, str], ...]
    """Human joint and robot link of each foot."""
    ankle_height: float
    """Height of the human's foot joint above its sole at size 1 [m]."""
    sole: tuple[tuple[float, float, float], ...]
    """Heel and toe of the robot's sole in the foot link's frame [m]."""

    def size_of(self, skeleton: Skeleton) -> float:
        """Body size of a skeleton: 1 for one as tall as the original."""
        _, knee, ankle = (skeleton.index(joint) for joint in self.leg)
        return float(np.linalg.norm(skeleton.offsets[[knee, ankle]], axis=-1).sum() / self.leg_length)


# Standing feet of an H1 are 0.406 m apart, those of the human 0.170 m. With no ankle roll, feet put where the human's are would tilt by
# 8.5 degrees; where the H1's are, the gait would be a straddle. Half way they tilt by 4 degrees, 3 mm over the width of a sole.
_ANKLE_OUT, _KNEE_OUT = 0.06, 0.09
# The H1's pelvis frame is 0.174 m above its hips, the human's between them. Without the shift every walk is a crouch.
_PELVIS_UP = 0.174
# A foot beside its place skates, a pelvis beside its place does not; and the H1 must reach the floor with legs that may be too short.
_ANKLE_WEIGHT = 20.0

UNIHSI_H1 = Mapping(
    skeleton="unihsi",
    robot="h1",
    leg=("left_thigh", "left_shin", "left_foot"),
    leg_length=0.831416,
    pairs=(
        Pair("pelvis", "pelvis", "pelvis", (0.0, 0.0, _PELVIS_UP)),
        # The H1 has no waist: its one trunk answers for the human's pelvis and, in `improved`, for the human's torso too.
        Pair("pelvis", "torso_link", "torso_link", (0.0, 0.0, _PELVIS_UP), turned_by="torso"),
        Pair("left_thigh", "left_hip_yaw_link", "left_hip_pitch_link"),
        Pair("left_thigh", "left_hip_roll_link", "left_hip_pitch_link"),
        Pair("left_shin", "left_knee_link", "left_knee_link", (0.0, _KNEE_OUT, 0.0)),
        Pair("left_foot", "left_ankle_link", "left_ankle_link", (0.0, _ANKLE_OUT, 0.0), _ANKLE_WEIGHT),
        Pair("right_thigh", "right_hip_yaw_link", "right_hip_pitch_link"),
        Pair("right_thigh", "right_hip_roll_link", "right_hip_pitch_link"),
        Pair("right_shin", "right_knee_link", "right_knee_link", (0.0, -_KNEE_OUT, 0.0)),
        Pair("right_foot", "right_ankle_link", "right_ankle_link", (0.0, -_ANKLE_OUT, 0.0), _ANKLE_WEIGHT),
        Pair("left_upper_arm", "left_shoulder_roll_link", "left_shoulder_yaw_link"),
        Pair("left_lower_arm", "left_elbow_link", "left_elbow_link"),
        Pair("right_upper_arm", "right_shoulder_roll_link", "right_shoulder_yaw_link"),
        Pair("right_lower_arm", "right_elbow_link", "right_elbow_link"),
    ),
    wrists=(("left_hand", "left_wrist"), ("right_hand", "right_wrist")),
    feet=(("left_foot", "left_ankle_link"), ("right_foot", "right_ankle_link")),
    ankle_height=0.05,
    sole=((-0.10, 0.0, -0.07), (0.20, 0.0, -0.07)),
)

MAPPINGS: Dictionary[tuple[str, str], Mapping] = {(m.skeleton, m.robot): m for m in (UNIHSI_H1,)}


def find_mapping(skeleton: str, robot: str) -> Mapping:
    """The table between a human skeleton and a robot. Raises UnknownName."""
    if (skeleton, robot) not in MAPPINGS:
        raise UnknownName("retargeting from skeleton to robot", f"{skeleton} -> {robot}", [f"{s} -> {r}" for s, r in MAPPINGS])
    return MAPPINGS[skeleton, robot]


@dataclass(frozen=True)
class Bound:
    """A mapping with names looked up: K pairs of positions, and K of orientations."""

    joints: np.ndarray
    """(K,) human joint of each position pair."""
    links: np.ndarray
    """(K,) robot link of each position pair."""
    shifts: np.ndarray
    """(K, 3) followed point in the human joint's frame [m]."""
    weights: np.ndarray
    """(K,) of the squared position errors."""
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
    sole: np.ndarray
    """(P, 3) points of the sole in the foot link's frame [m]."""


def bind(mapping: Mapping, skeleton: Skeleton, robot: Robot, preset: Preset = "improved") -> Bound:
    """Look up a mapping's names in a skeleton and a robot; constant frame offsets come from both in the pose with arms down.

    `paper` is the table to the letter: every pair at the joints themselves, of equal weight, positions and orientations alike.
    """
    if preset == "paper":
        pairs = tuple(replace(pair, shift=(0.0, 0.0, 0.0), weight=1.0, carrier=pair.link, turned_by=None) for pair in mapping.pairs)
    else:
        pairs = mapping.pairs
    shifts = np.array([pair.shift for pair in pairs])
    if preset != "paper":
        # Sole lies on sole, whatever the foot's pitch: the H1's ankle is higher above its sole than the human's.
        is_foot = np.isin([pair.joint for pair in pairs], [joint for joint, _ in mapping.feet])
        shifts[is_foot, 2] -= mapping.sole[0][2] + mapping.ankle_height * mapping.size_of(skeleton)
    turn_links = np.array([_link(robot, pair.carrier) for pair in pairs])
    arms_down = np.array([robot.arms_down.get(name, 0.0) for name in robot.joint_names])
    # The human's joint frames are all parallel to the world in its rest pose, so the robot's link orientations are the offsets.
    _, offsets = robot.forward_kinematics(np.zeros(3), rot.IDENTITY, arms_down)
    carriers = sorted({_link(robot, pair.carrier): skeleton.index(pair.turned_by or pair.joint) for pair in mapping.pairs}.items())
    wrists = []
    for joint, name in mapping.wrists:
        if name not in robot.keypoints:
            raise UnknownName("keypoint", name, list(robot.keypoints))
        link, point = robot.keypoints[name]
        wrists.append((skeleton.index(joint), link, np.array(point)))
    return Bound(
        joints=np.array([skeleton.index(pair.joint) for pair in pairs]),
        links=np.array([_link(robot, pair.link) for pair in pairs]),
        shifts=shifts,
        weights=np.array([pair.weight for pair in pairs]),
        turn_joints=np.array([skeleton.index(pair.turned_by or pair.joint) for pair in pairs]),
        turn_links=turn_links,
        turn_offsets=offsets[turn_links],
        carriers=tuple((joint, link) for link, joint in carriers),
        carrier_offsets=offsets[[link for link, _ in carriers]],
        wrists=tuple(wrists),
        feet=tuple((skeleton.index(joint), _link(robot, link)) for joint, link in mapping.feet),
        sole=np.array(mapping.sole),
    )


def _link(robot: Robot, name: str) -> int:
    if name not in robot.link_names:
        raise BadMotion(f"robot {robot.name} has no link {name!r}; it has {', '.join(robot.link_names)}")
    return robot.link_names.index(name)
