"""The human skeletons whose motions robots imitate, as far as robots have to know them (references has them whole)."""

from dataclasses import dataclass


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
    sole=0.0863,
    hip_seat=0.0721,
    pelvis_seat=0.16,
    palm=0.08,
)

PEOPLE = (UNIHSI, ROAM, CORE4D)
