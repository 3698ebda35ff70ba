"""The human skeletons whose motions robots imitate, as far as robots have to know them (references has them whole)."""

from collections.abc import Mapping as Dictionary
from dataclasses import dataclass

from mimicbench.robots.mapping import Mapping, Pair


@dataclass(frozen=True)
class Names:
    """What a human skeleton calls its joints; `{}` stands for the side. Lengths are at body size 1."""

    skeleton: str
    sides: tuple[str, str]
    """Left, right."""
    pelvis: str
    chest: str
    """What carries the arms."""
    hip: str
    knee: str
    ankle: str
    shoulder: str
    elbow: str
    wrist: str
    leg_length: float
    """From hip to ankle [m]."""
    shank: float
    """Of it, from knee to ankle [m]."""
    sole: float
    """Height of the ankle over the sole [m]."""
    hip_seat: float
    """Height of a hip over the seat under it [m]."""
    pelvis_seat: float
    """Height of the pelvis joint over the seat under it [m]."""
    palm: float
    """From the wrist to the palm's middle [m]."""


UNIHSI = Names(
    "unihsi",
    ("left", "right"),
    "pelvis",
    "torso",
    "{}_thigh",
    "{}_shin",
    "{}_foot",
    "{}_upper_arm",
    "{}_lower_arm",
    "{}_hand",
    leg_length=0.831416,
    shank=0.40987,
    sole=0.05,
    hip_seat=0.09,
    pelvis_seat=0.09,
    palm=0.06,
)
ROAM = Names(
    "roam",
    ("Left", "Right"),
    "Hips",
    "Spine3",
    "{}UpLeg",
    "{}Leg",
    "{}Foot",
    "{}Arm",
    "{}ForeArm",
    "{}Hand",
    leg_length=0.7489,
    shank=0.3754,
    sole=0.069,
    hip_seat=0.0709,
    pelvis_seat=0.10,
    palm=0.07,
)
CORE4D = Names(
    "core4d",
    ("left", "right"),
    "pelvis",
    "spine3",
    "{}_hip",
    "{}_knee",
    "{}_ankle",
    "{}_shoulder",
    "{}_elbow",
    "{}_wrist",
    leg_length=0.8769,
    shank=0.4498,
    sole=0.0863,
    hip_seat=0.0721,
    pelvis_seat=0.16,
    palm=0.08,
)

PEOPLE = (UNIHSI, ROAM, CORE4D)


def mapping_from(
    names: Names,
    pairs: tuple[Pair, ...],
    feet: tuple[str, str],
    sole: tuple[tuple[float, float, float], ...],
    bearers: Dictionary[str, tuple[str, ...]],
    trunk: str,
) -> Mapping:
    """A robot's mapping from one of these skeletons, whose wrists it follows with its keypoints `left_wrist` and
    `right_wrist`.

    Args:
        names: What the skeleton calls its joints.
        pairs: Which link follows which joint.
        feet: The robot's links of left and right foot.
        sole: Heel and toe of its sole in a foot link's frame [m].
        bearers: The links that bear in place of each part of the body that a contact label names.
        trunk: Its link that leans as the person's trunk does.
    """
    left, right = names.sides
    return Mapping(
        skeleton=names.skeleton,
        leg=(names.hip.format(left), names.knee.format(left), names.ankle.format(left)),
        leg_length=names.leg_length,
        pairs=pairs,
        wrists=((names.wrist.format(left), "left_wrist"), (names.wrist.format(right), "right_wrist")),
        feet=((names.ankle.format(left), feet[0]), (names.ankle.format(right), feet[1])),
        sole=sole,
        bearers=bearers,
        forearms=tuple((names.elbow.format(side), names.wrist.format(side)) for side in names.sides),
        palm=names.palm,
        ankle_height=names.sole,
        trunk=trunk,
    )
