"""The tables between the human skeletons and the H1 (appendix B.1), and what we add to them in `improved`."""

from dataclasses import dataclass

from mimicbench.retarget.mapping import Mapping, Pair

# Standing feet of an H1 are 0.406 m apart, those of the human 0.170 m. With no ankle roll, feet put where the human's
# are would tilt by
# 8.5 degrees; where the H1's are, the gait would be a straddle. Half way they tilt by 4 degrees, 3 mm over the width of
# a sole.
_ANKLE_OUT, _KNEE_OUT = 0.06, 0.09
# Down to the sole from the ankles, and down to the underside of the buttocks from the hips and from the pelvis frame:
# of the H1.
# The H1's pelvis frame is 0.174 m above its hips, the human's between them: without this every walk would be a crouch.
# One centimeter is added at the seat: thighs that slope down to the knees meet its front edge before the buttocks meet
# the seat.
_SOLE, _HIP_SEAT, _PELVIS_SEAT = 0.07, 0.071, 0.245
# A foot beside its place skates, a pelvis beside its place does not; and the H1 must reach the floor with legs that may
# be too short.
_ANKLE_WEIGHT = 100.0
# Where the pelvis frame comes to lie depends on how the one trunk of the H1 settles between the human's two; where the
# hips lie does not.
_PELVIS_WEIGHT = 0.25


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


def _to_h1(names: Names, shoulder: str) -> Mapping:
    """The table of one skeleton; `shoulder` is the H1's link that its shoulder goes to."""
    seat, pelvis = (_HIP_SEAT, names.hip_seat), (_PELVIS_SEAT, names.pelvis_seat)
    pairs = [
        Pair(names.pelvis, "pelvis", "pelvis", surface=pelvis, weight=_PELVIS_WEIGHT),
        # The H1 has no waist: its one trunk answers for the human's pelvis and, in `improved`, for the human's chest
        # too.
        Pair(names.pelvis, "torso_link", "torso_link", surface=pelvis, weight=_PELVIS_WEIGHT, turned_by=names.chest),
    ]
    for human, h1, out in (("left", "left", 1.0), ("right", "right", -1.0)):
        side = names.sides[0 if human == "left" else 1]
        hip, knee, ankle = (joint.format(side) for joint in (names.hip, names.knee, names.ankle))
        pairs += [
            Pair(hip, f"{h1}_hip_yaw_link", f"{h1}_hip_pitch_link", surface=seat, frame=names.pelvis),
            Pair(hip, f"{h1}_hip_roll_link", f"{h1}_hip_pitch_link", surface=seat, frame=names.pelvis),
            Pair(knee, f"{h1}_knee_link", f"{h1}_knee_link", (0.02, out * _KNEE_OUT, 0.0)),
            Pair(
                ankle,
                f"{h1}_ankle_link",
                f"{h1}_ankle_link",
                (0.0, out * _ANKLE_OUT, 0.0),
                (_SOLE, names.sole),
                weight=_ANKLE_WEIGHT,
            ),
        ]
    for h1, side in zip(("left", "right"), names.sides, strict=True):
        pairs += [
            Pair(
                names.shoulder.format(side),
                f"{h1}_{shoulder}",
                f"{h1}_shoulder_yaw_link",
                frame=names.chest,
                at_rest=True,
            ),
            Pair(names.elbow.format(side), f"{h1}_elbow_link", f"{h1}_elbow_link", frame=names.chest, at_rest=True),
        ]
    left, right = names.sides
    return Mapping(
        skeleton=names.skeleton,
        robot="h1",
        leg=(names.hip.format(left), names.knee.format(left), names.ankle.format(left)),
        leg_length=names.leg_length,
        pairs=tuple(pairs),
        wrists=((names.wrist.format(left), "left_wrist"), (names.wrist.format(right), "right_wrist")),
        feet=((names.ankle.format(left), "left_ankle_link"), (names.ankle.format(right), "right_ankle_link")),
        sole=((-0.10, 0.0, -0.07), (0.20, 0.0, -0.07)),
        bearers={
            # on seats higher than its knees the H1's thighs meet the front edge before its buttocks meet the seat
            "pelvis": ("pelvis", "left_hip_pitch_link", "right_hip_pitch_link"),
            "back": ("torso_link",),
            "left_hand": ("left_elbow_link",),
            "right_hand": ("right_elbow_link",),
            "left_foot": ("left_ankle_link",),
            "right_foot": ("right_ankle_link",),
        },
        forearms=tuple((names.elbow.format(side), names.wrist.format(side)) for side in names.sides),
        palm=names.palm,
        ankle_height=names.sole,
        trunk="torso_link",
    )


# "the human shoulder is the shoulder roll link for UniHSI, the shoulder pitch link for the others" (tables of appendix
# B.1)
UNIHSI_H1 = _to_h1(UNIHSI, "shoulder_roll_link")
ROAM_H1 = _to_h1(ROAM, "shoulder_pitch_link")
CORE4D_H1 = _to_h1(CORE4D, "shoulder_pitch_link")
