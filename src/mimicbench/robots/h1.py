"""The Unitree H1: 20 links, 19 joints, 51.4 kg, 1.80 m.

Kinematics, inertias and torque limits: Unitree's public description as parsed from MuJoCo Menagerie (BSD-3-Clause).
Hip pitch has the wide range (-3.14..2.53) of Unitree's description since 2024-01-22: with the older +-1.57 an H1
cannot sit as people do. Joint i drives link i + 1, the order of the paper's tables. There is no waist pitch, one ankle
axis, and no wrist joint: the wrist is a point near the end of the elbow link.

The collision shapes are our own. Unitree's and Menagerie's are made for walking; these can also sit, lie, push and
lift. The buttocks end 0.06 m below the hip pitch axis, so a seated pelvis frame is about 0.235 m above the seat.
"""

from mimicbench.robots.description import Gains, Joint, Link, Robot, Shape
from mimicbench.robots.mapping import Mapping, Pair
from mimicbench.robots.people import PEOPLE, UNIHSI, Names, mapping_from

_UPRIGHT = (1.0, 0.0, 0.0, 0.0)
_PLACES = (
    # name, parent, position, orientation
    ("pelvis", -1, (0.0, 0.0, 0.0), _UPRIGHT),
    ("left_hip_yaw_link", 0, (0.0, 0.0875, -0.1742), _UPRIGHT),
    ("left_hip_roll_link", 1, (0.039468, 0.0, 0.0), _UPRIGHT),
    ("left_hip_pitch_link", 2, (0.0, 0.11536, 0.0), _UPRIGHT),
    ("left_knee_link", 3, (0.0, 0.0, -0.4), _UPRIGHT),
    ("left_ankle_link", 4, (0.0, 0.0, -0.4), _UPRIGHT),
    ("right_hip_yaw_link", 0, (0.0, -0.0875, -0.1742), _UPRIGHT),
    ("right_hip_roll_link", 6, (0.039468, 0.0, 0.0), _UPRIGHT),
    ("right_hip_pitch_link", 7, (0.0, -0.11536, 0.0), _UPRIGHT),
    ("right_knee_link", 8, (0.0, 0.0, -0.4), _UPRIGHT),
    ("right_ankle_link", 9, (0.0, 0.0, -0.4), _UPRIGHT),
    ("torso_link", 0, (0.0, 0.0, 0.0), _UPRIGHT),
    ("left_shoulder_pitch_link", 11, (0.0055, 0.15535, 0.42999), (0.976296, 0.216438, 0.0, 0.0)),
    ("left_shoulder_roll_link", 12, (-0.0055, 0.0565, -0.0165), (0.976296, -0.216438, 0.0, 0.0)),
    ("left_shoulder_yaw_link", 13, (0.0, 0.0, -0.1343), _UPRIGHT),
    ("left_elbow_link", 14, (0.0185, 0.0, -0.198), _UPRIGHT),
    ("right_shoulder_pitch_link", 11, (0.0055, -0.15535, 0.42999), (0.976296, -0.216438, 0.0, 0.0)),
    ("right_shoulder_roll_link", 16, (-0.0055, -0.0565, -0.0165), (0.976296, 0.216438, 0.0, 0.0)),
    ("right_shoulder_yaw_link", 17, (0.0, 0.0, -0.1343), _UPRIGHT),
    ("right_elbow_link", 18, (0.0185, 0.0, -0.198), _UPRIGHT),
)
_MASSES = (
    # mass, center of mass, inertia (xx, yy, zz, xy, xz, yz); of each link, in the same order
    (5.39, (-0.0002, 4e-05, -0.04522), (0.044582, 0.0082464, 0.049021, 8.7051e-05, -1.9896e-05, 4.004e-06)),
    (2.244, (-0.04923, 0.0001, 0.0072), (0.0025731, 0.0030444, 0.0022883, 9.16e-06, -0.000519481, 1.949e-06)),
    (2.232, (-0.0058, -0.00319, -9e-05), (0.0020603, 0.00224821, 0.0024323, 3.2115e-05, 2.878e-06, -7.813e-06)),
    (4.152, (0.00746, -0.02346, -0.08193), (0.082618, 0.081579, 0.0060081, -0.00066652, 0.0040725, 0.0072024)),
    (1.721, (-0.00136, -0.00512, -0.1384), (0.012205, 0.012509, 0.00206289, -6.8429e-05, 0.0010862, 0.00022549)),
    (0.446, (0.06722, 0.00015, -0.04497), (0.00025669, 0.0022082, 0.0021474, 4.196e-06, 0.00028656, -2.87e-06)),
    (2.244, (-0.04923, -0.0001, 0.0072), (0.0025731, 0.0030444, 0.0022883, -9.16e-06, -0.000519481, -1.949e-06)),
    (2.232, (-0.0058, 0.00319, -9e-05), (0.0020603, 0.00224821, 0.0024323, -3.2115e-05, 2.878e-06, 7.813e-06)),
    (4.152, (0.00746, 0.02346, -0.08193), (0.082618, 0.081579, 0.0060081, 0.00066652, 0.0040725, -0.0072024)),
    (1.721, (-0.00136, 0.00512, -0.1384), (0.012205, 0.012509, 0.00206289, 6.8429e-05, 0.0010862, -0.00022549)),
    (0.446, (0.06722, -0.00015, -0.04497), (0.00025669, 0.0022082, 0.0021474, -4.196e-06, 0.00028656, 2.87e-06)),
    (17.789, (0.000489, 0.002797, 0.20484), (0.4873, 0.40963, 0.12785, -0.00053763, 0.0020276, -0.000745806)),
    (1.033, (0.005045, 0.053657, -0.015715), (0.0012985, 0.00087279, 0.00097338, -1.7333e-05, 8.683e-06, 3.9656e-05)),
    (0.793, (0.000679, 0.00115, -0.094076), (0.0015742, 0.0016973, 0.0010183, 2.297e-06, -7.2265e-05, -6.3691e-05)),
    (0.839, (0.01365, 0.002767, -0.16266), (0.003664, 0.0040789, 0.00066383, -1.0671e-05, 0.00034733, 7.0214e-05)),
    (0.669, (0.15908, -0.000144, -0.015776), (0.00042388, 0.0060062, 0.0060023, -3.6082e-05, 0.00029293, 4.664e-06)),
    (1.033, (0.005045, -0.053657, -0.015715), (0.0012985, 0.00087279, 0.00097338, 1.7333e-05, 8.683e-06, -3.9656e-05)),
    (0.793, (0.000679, -0.00115, -0.094076), (0.0015742, 0.0016973, 0.0010183, -2.297e-06, -7.2265e-05, 6.3691e-05)),
    (0.839, (0.01365, -0.002767, -0.16266), (0.003664, 0.0040789, 0.00066383, 1.0671e-05, 0.00034733, -7.0214e-05)),
    (0.669, (0.15908, 0.000144, -0.015776), (0.00042388, 0.0060062, 0.0060023, 3.6082e-05, 0.00029293, -4.664e-06)),
)
LINKS = tuple(Link(*place, *mass) for place, mass in zip(_PLACES, _MASSES, strict=True))

JOINTS = (
    # name, link, axis, range, torque limit, velocity limit
    Joint("left_hip_yaw_joint", 1, (0.0, 0.0, 1.0), (-0.43, 0.43), 200.0, 23.0),
    Joint("left_hip_roll_joint", 2, (1.0, 0.0, 0.0), (-0.43, 0.43), 200.0, 23.0),
    Joint("left_hip_pitch_joint", 3, (0.0, 1.0, 0.0), (-3.14, 2.53), 200.0, 23.0),
    Joint("left_knee_joint", 4, (0.0, 1.0, 0.0), (-0.26, 2.05), 300.0, 14.0),
    Joint("left_ankle_joint", 5, (0.0, 1.0, 0.0), (-0.87, 0.52), 40.0, 9.0),
    Joint("right_hip_yaw_joint", 6, (0.0, 0.0, 1.0), (-0.43, 0.43), 200.0, 23.0),
    Joint("right_hip_roll_joint", 7, (1.0, 0.0, 0.0), (-0.43, 0.43), 200.0, 23.0),
    Joint("right_hip_pitch_joint", 8, (0.0, 1.0, 0.0), (-3.14, 2.53), 200.0, 23.0),
    Joint("right_knee_joint", 9, (0.0, 1.0, 0.0), (-0.26, 2.05), 300.0, 14.0),
    Joint("right_ankle_joint", 10, (0.0, 1.0, 0.0), (-0.87, 0.52), 40.0, 9.0),
    Joint("torso_joint", 11, (0.0, 0.0, 1.0), (-2.35, 2.35), 200.0, 23.0),
    Joint("left_shoulder_pitch_joint", 12, (0.0, 1.0, 0.0), (-2.87, 2.87), 40.0, 9.0),
    Joint("left_shoulder_roll_joint", 13, (1.0, 0.0, 0.0), (-0.34, 3.11), 40.0, 9.0),
    Joint("left_shoulder_yaw_joint", 14, (0.0, 0.0, 1.0), (-1.3, 4.45), 18.0, 20.0),
    Joint("left_elbow_joint", 15, (0.0, 1.0, 0.0), (-1.25, 2.61), 18.0, 20.0),
    Joint("right_shoulder_pitch_joint", 16, (0.0, 1.0, 0.0), (-2.87, 2.87), 40.0, 9.0),
    Joint("right_shoulder_roll_joint", 17, (1.0, 0.0, 0.0), (-3.11, 0.34), 40.0, 9.0),
    Joint("right_shoulder_yaw_joint", 18, (0.0, 0.0, 1.0), (-4.45, 1.3), 18.0, 20.0),
    Joint("right_elbow_joint", 19, (0.0, 1.0, 0.0), (-1.25, 2.61), 18.0, 20.0),
)


def _per_joint(hip: float, knee: float, ankle: float, torso: float, arm: float) -> tuple[float, ...]:
    """A value for each of the 19 joints from a value for each kind."""
    leg = (hip, hip, hip, knee, ankle)
    return (*leg, *leg, torso, *(arm,) * 8)


GAINS = {
    # HumanPlus's simulation: kp 100, kd 5 everywhere, absolute targets.
    "paper": Gains(
        kp=_per_joint(100, 100, 100, 100, 100), kd=_per_joint(5, 5, 5, 5, 5), action_scale=_per_joint(1, 1, 1, 1, 1)
    ),
    # human2humanoid's gains but for the ankle (40/2 there), with the same torque limits: with its reference alone the
    # robot then stays up for 136 control steps instead of 74 (docs/notes/first-version.md), so there is less to learn.
    # An action is added to the reference joint angle; its scale is about half of the torque limit over kp.
    "improved": Gains(
        kp=_per_joint(200, 300, 200, 300, 100),
        kd=_per_joint(5, 6, 6, 6, 2),
        action_scale=_per_joint(0.4, 0.4, 0.1, 0.3, 0.3),
    ),
}


def _collision() -> tuple[Shape, ...]:
    """Shapes that bear contact. Groups name what may touch what on the robot itself."""
    shapes = [
        Shape(0, "capsule", (0.07,), (-0.03, -0.10, -0.165), (-0.03, 0.10, -0.165), "trunk"),  # buttocks
        Shape(11, "box", (0.075, 0.12, 0.21), (0.0, 0.0, 0.26), None, "trunk"),
        Shape(11, "capsule", (0.075,), (0.035, 0.0, 0.60), (0.035, 0.0, 0.68), "head"),
    ]
    for side, leg, arm, sign in (("left", 1, 12, 1.0), ("right", 6, 16, -1.0)):
        shapes += [
            Shape(
                leg + 2, "capsule", (0.06,), (0.0, -0.02 * sign, 0.0), (0.005, -0.015 * sign, -0.36), f"{side} leg"
            ),  # thigh
            Shape(leg + 3, "capsule", (0.048,), (0.0, 0.0, -0.03), (0.0, 0.0, -0.34), f"{side} leg"),  # shank
            Shape(
                leg + 4, "capsule", (0.014,), (-0.085, 0.028, -0.056), (0.185, 0.028, -0.056), f"{side} leg"
            ),  # sole, one edge
            Shape(
                leg + 4, "capsule", (0.014,), (-0.085, -0.028, -0.056), (0.185, -0.028, -0.056), f"{side} leg"
            ),  # sole, other edge
            Shape(arm + 1, "capsule", (0.05,), (0.0, 0.0, -0.01), (0.0, 0.0, -0.11), f"{side} shoulder"),
            Shape(arm + 2, "capsule", (0.04,), (0.005, 0.0, -0.03), (0.015, 0.0, -0.20), f"{side} arm"),  # upper arm
            Shape(arm + 3, "capsule", (0.033,), (0.02, 0.0, -0.010), (0.24, 0.0, -0.015), f"{side} arm"),  # forearm
            Shape(arm + 3, "sphere", (0.038,), (0.28, 0.0, -0.015), None, f"{side} arm"),  # hand
        ]
    return tuple(shapes)


def _visual() -> tuple[Shape, ...]:
    """Shapes for pictures only: housings, shells and a head, so that it reads as an H1."""
    shell, dark, metal = "0.86 0.87 0.89", "0.13 0.14 0.16", "0.52 0.54 0.58"
    shapes = [
        Shape(0, "box", (0.062, 0.075, 0.045), (0.0, 0.0, -0.045), None, dark),
        Shape(0, "capsule", (0.052,), (0.0, -0.09, -0.09), (0.0, 0.09, -0.09), metal),
        Shape(11, "capsule", (0.058,), (0.0, 0.0, 0.0), (0.0, 0.0, 0.10), dark),  # waist
        Shape(11, "ellipsoid", (0.098, 0.130, 0.190), (0.012, 0.0, 0.235), None, shell),  # chest
        Shape(11, "box", (0.070, 0.108, 0.120), (0.006, 0.0, 0.335), None, shell),
        Shape(11, "capsule", (0.060,), (0.0, -0.125, 0.425), (0.0, 0.125, 0.425), dark),  # shoulder bar
        Shape(11, "capsule", (0.036,), (0.01, 0.0, 0.44), (0.02, 0.0, 0.56), dark),  # neck
        Shape(11, "ellipsoid", (0.088, 0.075, 0.105), (0.035, 0.0, 0.645), None, shell),  # head
        Shape(11, "ellipsoid", (0.040, 0.060, 0.068), (0.092, 0.0, 0.640), None, dark),  # face
    ]
    for leg, arm, sign in ((1, 12, 1.0), (6, 16, -1.0)):
        shapes += [
            Shape(leg, "cylinder", (0.058,), (0.0, 0.0, -0.05), (0.0, 0.0, 0.08), dark),  # hip yaw motor
            Shape(leg + 1, "cylinder", (0.056,), (-0.06, 0.0, 0.0), (0.05, 0.0, 0.0), metal),  # hip roll motor
            Shape(
                leg + 2, "cylinder", (0.060,), (0.0, -0.085 * sign, 0.0), (0.0, 0.028 * sign, 0.0), dark
            ),  # hip pitch motor
            Shape(leg + 2, "capsule", (0.056,), (0.0, -0.02 * sign, -0.02), (0.004, -0.015 * sign, -0.26), shell),
            Shape(leg + 2, "capsule", (0.044,), (0.004, -0.015 * sign, -0.24), (0.0, 0.0, -0.38), metal),
            Shape(leg + 3, "cylinder", (0.050,), (0.0, -0.045, 0.0), (0.0, 0.045, 0.0), dark),  # knee
            Shape(leg + 3, "capsule", (0.046,), (0.0, 0.0, -0.04), (0.0, 0.0, -0.20), shell),
            Shape(leg + 3, "capsule", (0.030,), (0.0, 0.0, -0.18), (0.0, 0.0, -0.39), metal),
            Shape(leg + 4, "sphere", (0.034,), (0.0, 0.0, 0.0), None, dark),
            Shape(leg + 4, "box", (0.138, 0.036, 0.011), (0.050, 0.0, -0.059), None, dark),  # sole
            Shape(leg + 4, "capsule", (0.026,), (-0.055, 0.0, -0.036), (0.140, 0.0, -0.042), shell),
            Shape(arm, "sphere", (0.060,), (0.0, 0.045 * sign, -0.012), None, shell),
            Shape(arm + 1, "capsule", (0.046,), (0.0, 0.0, 0.0), (0.0, 0.0, -0.10), dark),
            Shape(arm + 2, "capsule", (0.041,), (0.0, 0.0, -0.01), (0.015, 0.0, -0.18), shell),
            Shape(arm + 3, "cylinder", (0.038,), (0.0, -0.034, 0.0), (0.0, 0.034, 0.0), dark),  # elbow
            Shape(arm + 3, "capsule", (0.033,), (0.02, 0.0, -0.010), (0.21, 0.0, -0.015), shell),
            Shape(arm + 3, "sphere", (0.038,), (0.28, 0.0, -0.015), None, dark),  # hand
        ]
    return tuple(shapes)


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


def _pairs(names: Names) -> tuple[Pair, ...]:
    """The table of one human skeleton (appendix B.1), and what `improved` adds to it."""
    # "the human shoulder is the shoulder roll link for UniHSI, the shoulder pitch link for the others" (appendix B.1)
    shoulder = "shoulder_roll_link" if names is UNIHSI else "shoulder_pitch_link"
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
    return tuple(pairs)


def _mapping(names: Names) -> Mapping:
    """From one human skeleton: its table, and the points that matter beyond it."""
    bearers = {
        # on seats higher than its knees the H1's thighs meet the front edge before its buttocks meet the seat
        "pelvis": ("pelvis", "left_hip_pitch_link", "right_hip_pitch_link"),
        "back": ("torso_link",),
        "left_hand": ("left_elbow_link",),
        "right_hand": ("right_elbow_link",),
        "left_foot": ("left_ankle_link",),
        "right_foot": ("right_ankle_link",),
    }
    feet, sole = ("left_ankle_link", "right_ankle_link"), ((-0.10, 0.0, -0.07), (0.20, 0.0, -0.07))
    return mapping_from(names, _pairs(names), feet, sole, bearers, "torso_link")


ROBOT = Robot(
    name="h1",
    links=LINKS,
    joints=JOINTS,
    gains=GAINS,
    armature=0.1,
    damping=1.0,
    keypoints={
        "left_ankle": (5, (0.0, 0.0, 0.0)),
        "right_ankle": (10, (0.0, 0.0, 0.0)),
        "left_sole": (5, (0.05, 0.0, -0.07)),
        "right_sole": (10, (0.05, 0.0, -0.07)),
        "left_wrist": (15, (0.28, 0.0, -0.015)),
        "right_wrist": (19, (0.28, 0.0, -0.015)),
        "head": (11, (0.035, 0.0, 0.64)),
    },
    rest_pose=(0, 0, -0.2, 0.4, -0.2, 0, 0, -0.2, 0.4, -0.2, 0, 0.2, 0.1, 0, 0.6, 0.2, -0.1, 0, 0.6),
    arms_down={"left_elbow_joint": 1.5707963, "right_elbow_joint": 1.5707963},
    collision=_collision(),
    visual=_visual(),
    mappings=tuple(_mapping(names) for names in PEOPLE),
    collides=(("left leg", "right leg"), ("left arm", "trunk"), ("right arm", "trunk"), ("left arm", "right arm")),
    legs=tuple((f"{side}_hip_pitch_link", f"{side}_knee_link", f"{side}_ankle_link") for side in ("left", "right")),
)
