"""The Unitree G1 without hands: 30 links, 29 joints, 33.3 kg, 1.32 m.

Kinematics, inertias, limits and torques: Unitree's description of revision 1.0 with 29 joints, as parsed from MuJoCo
Menagerie (BSD-3-Clause); rotor inertias: mjlab 1.6.0 (Apache-2.0), from the motors' rotors and gears. The right side is
the left one mirrored, which changes the description by less than 0.02 mm, 0.3 mrad and 1e-6 kg m^2, but for one product
of inertia of the right shank, whose sign there is the other one (4.5e-5 kg m^2). Joint i drives link i + 1. The waist
has three joints, an ankle two, a wrist three.

The collision shapes are our own, as large as Unitree's meshes: such as can sit, lie, push and lift. The pelvis ends
0.155 m below its frame, so that is how high a seated pelvis frame is above the seat. What stands for the wrist in K is
the ball at the end of the hand, as it is for robots whose forearm ends there.
"""

from typing import Any

from mimicbench.robots.description import Gains, Joint, Link, Robot, Shape, Vector
from mimicbench.robots.mapping import Mapping, Pair
from mimicbench.robots.people import PEOPLE, Names, mapping_from

_SIDES = ("left", "right")
_UPRIGHT = (1.0, 0.0, 0.0, 0.0)
_HIP, _KNEE = (0.996179, 0.0, -0.0873386, 0.0), (0.996179, 0.0, 0.0873386, 0.0)
_CLAVICLE, _SHOULDER = (0.990264, 0.139201, 0.0, 0.0), (0.990268, -0.139172, 0.0, 0.0)
_PLACES = {
    # of the left side and the middle: parent, position, orientation
    "pelvis": (None, (0.0, 0.0, 0.0), _UPRIGHT),
    "hip_pitch": ("pelvis", (0.0, 0.064452, -0.1027), _UPRIGHT),
    "hip_roll": ("hip_pitch", (0.0, 0.052, -0.030465), _HIP),
    "hip_yaw": ("hip_roll", (0.025001, 0.0, -0.12412), _UPRIGHT),
    "knee": ("hip_yaw", (-0.078273, 0.0021489, -0.17734), _KNEE),
    "ankle_pitch": ("knee", (0.0, -9.4445e-05, -0.30001), _UPRIGHT),
    "ankle_roll": ("ankle_pitch", (0.0, 0.0, -0.017558), _UPRIGHT),
    "waist_yaw": ("pelvis", (0.0, 0.0, 0.0), _UPRIGHT),
    "waist_roll": ("waist_yaw", (-0.0039635, 0.0, 0.044), _UPRIGHT),
    "torso": ("waist_roll", (0.0, 0.0, 0.0), _UPRIGHT),
    "shoulder_pitch": ("torso", (0.0039563, 0.10022, 0.24778), _CLAVICLE),
    "shoulder_roll": ("shoulder_pitch", (0.0, 0.038, -0.013831), _SHOULDER),
    "shoulder_yaw": ("shoulder_roll", (0.0, 0.00624, -0.1032), _UPRIGHT),
    "elbow": ("shoulder_yaw", (0.015783, 0.0, -0.080518), _UPRIGHT),
    "wrist_roll": ("elbow", (0.1, 0.00188791, -0.01), _UPRIGHT),
    "wrist_pitch": ("wrist_roll", (0.038, 0.0, 0.0), _UPRIGHT),
    "wrist_yaw": ("wrist_pitch", (0.046, 0.0, 0.0), _UPRIGHT),
}
_MASSES = (
    # mass, center of mass, inertia (xx, yy, zz, xy, xz, yz); of each of these links, in the same order
    (3.813, (0.0, 0.0, -0.07605), (0.010548998, 0.0093089, 0.007918402, 0.0, 2.1e-06, 0.0)),
    (1.35, (0.002741, 0.047791, -0.02606), (0.001811005, 0.001419303, 0.001281202, 3.68e-05, -3.44e-05, 0.000171)),
    (1.52, (0.029812, -0.001045, -0.087934), (0.0023773, 0.002412298, 0.001659502, -3.8e-06, -0.0003908, 1.84e-05)),
    (1.702, (-0.057709, -0.010981, -0.15078), (0.0057774, 0.0076124, 0.003149, -0.0005411, -0.0023948, -0.0007072)),
    (1.932, (0.005457, 0.003964, -0.12074), (0.01132899, 0.01127699, 0.0015168, 4.817e-05, -4.49e-05, -0.0007146)),
    (0.074, (-0.007269, 0.0, 0.011137), (8.4e-06, 1.89e-05, 1.26e-05, 0.0, -2.9e-06, 0.0)),
    (0.608, (0.026505, 0.0, -0.016425), (0.0002231, 0.0016161, 0.001666701, 2e-07, 8.9101e-05, -1e-07)),
    (0.214, (0.003494, 0.000233, 0.018034), (0.00010673, 0.00010422, 0.0001625, 2.703e-06, -7.631e-06, -2.01e-07)),
    (0.086, (0.0, 2.3e-05, 0.0), (7.079e-06, 6.339e-06, 8.245e-06, 0.0, 0.0, 0.0)),
    (
        7.818,
        (0.00203158, 0.000339683, 0.184568),
        (0.12169844, 0.10982508, 0.02752198, 3.111e-05, -0.00374229, -1.551e-05),
    ),
    (0.718, (0.0, 0.035892, -0.011628), (0.0004291, 0.000453, 0.000423, -9.2e-06, 6.4e-06, 2.26e-05)),
    (0.643, (-0.000227, 0.00727, -0.063243), (0.0006177, 0.0006912, 0.0003894, -1e-06, 8.7e-06, -5.3e-06)),
    (0.734, (0.010773, -0.002949, -0.072009), (0.000998804, 0.001060497, 0.0004354, 7.9e-06, 0.000141201, -2.86e-05)),
    (0.6, (0.064956, 0.004454, -0.010062), (0.0002891, 0.0004152, 0.0004197, 6.53e-05, 1.72e-05, -5.6e-06)),
    (0.085445, (0.0171394, 0.000537591, 4.8864e-07), (4.8215e-05, 3.7229e-05, 5.4821e-05, -4.245e-06, 5e-09, -1e-09)),
    (0.48405, (0.023, -0.00111685, -0.00111658), (0.000165797, 0.000429541, 0.000429537, -1.231e-05, 1.232e-05, 8e-07)),
    (
        0.254576,
        (0.0708244, 0.000191745, 0.00161742),
        (0.00015045, 0.00064311, 0.00056011, 3.76e-05, -2.95e-06, 3.77e-06),
    ),
)
_X, _Y, _Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
_MOTORS: dict[str, tuple[Any, ...]] = {
    # axis, range of the left side, torque limit, velocity limit, rotor inertia; `improved` kp, kd, scale of an action
    "hip_pitch": (_Y, (-2.5307, 2.8798), 88.0, 32.0, 0.01017752, 150.0, 4.0, 0.3),
    "hip_roll": (_X, (-0.5236, 2.9671), 139.0, 20.0, 0.025101925, 150.0, 4.0, 0.3),
    "hip_yaw": (_Z, (-2.7576, 2.7576), 88.0, 32.0, 0.01017752, 150.0, 4.0, 0.3),
    "knee": (_Y, (-0.087267, 2.8798), 139.0, 20.0, 0.025101925, 200.0, 5.0, 0.35),
    "ankle_pitch": (_Y, (-0.87267, 0.5236), 50.0, 30.0, 0.00721945, 90.0, 3.0, 0.2),
    "ankle_roll": (_X, (-0.2618, 0.2618), 50.0, 30.0, 0.00721945, 90.0, 3.0, 0.2),
    "waist_yaw": (_Z, (-2.618, 2.618), 88.0, 32.0, 0.01017752, 150.0, 4.0, 0.2),
    "waist_roll": (_X, (-0.52, 0.52), 50.0, 30.0, 0.00721945, 150.0, 4.0, 0.2),
    "waist_pitch": (_Y, (-0.52, 0.52), 50.0, 30.0, 0.00721945, 150.0, 4.0, 0.2),
    "shoulder_pitch": (_Y, (-3.0892, 2.6704), 25.0, 37.0, 0.003609725, 60.0, 2.0, 0.2),
    "shoulder_roll": (_X, (-1.5882, 2.2515), 25.0, 37.0, 0.003609725, 60.0, 2.0, 0.2),
    "shoulder_yaw": (_Z, (-2.618, 2.618), 25.0, 37.0, 0.003609725, 60.0, 2.0, 0.2),
    "elbow": (_Y, (-1.0472, 2.0944), 25.0, 37.0, 0.003609725, 60.0, 2.0, 0.2),
    "wrist_roll": (_X, (-1.97222, 1.97222), 25.0, 37.0, 0.003609725, 30.0, 1.0, 0.2),
    "wrist_pitch": (_Y, (-1.61443, 1.61443), 5.0, 22.0, 0.00425, 15.0, 0.8, 0.15),
    "wrist_yaw": (_Z, (-1.61443, 1.61443), 5.0, 22.0, 0.00425, 15.0, 0.8, 0.15),
}


def _full(name: str, side: str) -> str:
    """The description's name of a link."""
    return name if name == "pelvis" else f"{side}{name}_link"


_ARMS = list(_PLACES).index("shoulder_pitch")
_ORDER = (
    ("", list(_PLACES)[:1]),
    *((side, list(_PLACES)[1:7]) for side in ("left_", "right_")),
    ("", list(_PLACES)[7:_ARMS]),
    *((side, list(_PLACES)[_ARMS:]) for side in ("left_", "right_")),
)
_INDEX = {_full(name, side): i for i, (side, name) in enumerate((s, n) for s, names in _ORDER for n in names)}


def _link(name: str, side: str) -> Link:
    """A link, on the right the mirror image of the left one."""
    flip = -1.0 if side == "right_" else 1.0
    parent, (x, y, z), (w, qx, qy, qz) = _PLACES[name]
    mass, (cx, cy, cz), (xx, yy, zz, xy, xz, yz) = _MASSES[list(_PLACES).index(name)]
    above = -1 if parent is None else _INDEX.get(_full(parent, side), _INDEX.get(_full(parent, ""), -1))
    place, turn, com = (x, flip * y, z), (w, flip * qx, qy, flip * qz), (cx, flip * cy, cz)
    return Link(_full(name, side), above, place, turn, mass, com, (xx, yy, zz, flip * xy, xz, flip * yz))


LINKS = tuple(_link(name, side) for side, names in _ORDER for name in names)


def _kind(name: str) -> str:
    """A joint's name without its side."""
    return name.removesuffix("_joint").removeprefix("left_").removeprefix("right_")


def _joint(link: str) -> Joint:
    """The joint that drives a link."""
    name = link.removesuffix("_link").replace("torso", "waist_pitch")
    axis, (low, high), torque, velocity, rotor, *_ = _MOTORS[_kind(name)]
    # a turn about y mirrors into itself, one about x or z into its opposite
    limits = (-high, -low) if name.startswith("right_") and axis != _Y else (low, high)
    return Joint(f"{name}_joint", _INDEX[link], axis, limits, torque, velocity, rotor)


JOINTS = tuple(_joint(link.name) for link in LINKS[1:])


GAINS = {
    # as the paper has it for every joint of its robot: kp 100, kd 5, absolute targets
    "paper": Gains(*(tuple(value for _ in JOINTS) for value in (100.0, 5.0, 1.0))),
    # Stiff enough to stand on the reference alone; those of mjlab and BeyondMimic, a third as stiff, rely on actions
    # to hold the robot up. An action of 1 is about half of the torque limit.
    "improved": Gains(*(tuple(_MOTORS[_kind(joint.name)][column] for joint in JOINTS) for column in (5, 6, 7))),
}


def _at(link: str, kind: str, size: Vector, start: Vector, end: Vector | None, group: str) -> Shape:
    return Shape(_INDEX[link], kind, size, start, end, group)


def _collision() -> tuple[Shape, ...]:
    """Shapes that bear contact. Groups name what may touch what on the robot itself."""
    shapes = [
        _at("pelvis", "capsule", (0.07,), (0.0, -0.07, -0.085), (0.0, 0.07, -0.085), "trunk"),  # buttocks
        _at("torso_link", "box", (0.07, 0.10, 0.135), (0.005, 0.0, 0.165), None, "trunk"),
        _at("torso_link", "sphere", (0.07,), (0.01, 0.0, 0.415), None, "head"),
    ]
    for side, out in (("left", 1.0), ("right", -1.0)):
        leg, arm = f"{side} leg", f"{side} arm"
        shapes += [
            _at(f"{side}_hip_roll_link", "capsule", (0.058,), (0.02, 0.0, -0.02), (0.02, 0.0, -0.08), leg),
            _at(f"{side}_hip_yaw_link", "capsule", (0.052,), (0.0, 0.0, -0.03), (-0.06, 0.0, -0.17), leg),
            _at(f"{side}_knee_link", "capsule", (0.042,), (0.01, 0.0, 0.0), (0.01, 0.0, -0.15), leg),
            _at(f"{side}_knee_link", "capsule", (0.03,), (0.01, 0.0, -0.2), (0.01, 0.0, -0.27), leg),
            *(
                _at(f"{side}_ankle_roll_link", "capsule", (0.01,), (-0.05, y, -0.025), (0.125, y, -0.025), leg)
                for y in (-0.025, 0.025)  # edges of the sole
            ),
            _at(
                f"{side}_shoulder_roll_link",
                "capsule",
                (0.036,),
                (0.0, 0.0, -0.01),
                (0.0, 0.0, -0.08),
                f"{side} shoulder",
            ),
            _at(f"{side}_shoulder_yaw_link", "capsule", (0.035,), (0.0, 0.0, -0.01), (0.01, 0.0, -0.07), arm),
            _at(f"{side}_elbow_link", "capsule", (0.033,), (0.0, 0.0, -0.01), (0.08, 0.0, -0.01), arm),
            _at(f"{side}_wrist_pitch_link", "capsule", (0.03,), (-0.03, 0.0, 0.0), (0.06, 0.0, 0.0), arm),
            _at(f"{side}_wrist_yaw_link", "capsule", (0.035,), (0.06, 0.0, 0.0), (0.11, -0.01 * out, 0.0), arm),
        ]
    return tuple(shapes)


def _visual() -> tuple[Shape, ...]:
    """Shapes for pictures only, in the places of Unitree's housings, so that it reads as a G1."""
    shell, dark, metal = "0.80 0.81 0.83", "0.12 0.13 0.15", "0.45 0.47 0.51"
    shapes = [
        _at("pelvis", "ellipsoid", (0.060, 0.068, 0.078), (0.0, 0.0, -0.075), None, dark),
        _at("waist_yaw_link", "cylinder", (0.042,), (0.0, 0.0, 0.0), (0.0, 0.0, 0.054), metal),
        _at("torso_link", "ellipsoid", (0.072, 0.098, 0.150), (0.006, 0.0, 0.155), None, shell),
        _at("torso_link", "box", (0.060, 0.085, 0.085), (0.006, 0.0, 0.195), None, shell),
        _at("torso_link", "capsule", (0.046,), (0.004, -0.085, 0.25), (0.004, 0.085, 0.25), dark),
        _at("torso_link", "capsule", (0.034,), (0.0, 0.0, 0.28), (0.0, 0.0, 0.36), dark),
        _at("torso_link", "ellipsoid", (0.070, 0.062, 0.088), (0.005, 0.0, 0.400), None, shell),
        _at("torso_link", "ellipsoid", (0.030, 0.052, 0.060), (0.052, 0.0, 0.405), None, dark),
    ]
    for side, out in (("left", 1.0), ("right", -1.0)):
        parts = [
            ("hip_pitch", "cylinder", (0.041,), (0.0, 0.0, 0.0), (0.0, 0.098 * out, -0.012), dark),
            ("hip_roll", "capsule", (0.048,), (0.02, 0.0, -0.01), (0.025, 0.0, -0.10), shell),
            ("hip_yaw", "capsule", (0.046,), (0.0, 0.0, -0.02), (-0.055, 0.0, -0.14), shell),
            ("hip_yaw", "cylinder", (0.045,), (-0.078, -0.043, -0.177), (-0.078, 0.043, -0.177), dark),
            ("knee", "capsule", (0.040,), (0.012, 0.0, -0.03), (0.012, 0.0, -0.16), shell),
            ("knee", "capsule", (0.026,), (0.005, 0.0, -0.16), (0.0, 0.0, -0.29), metal),
            ("ankle_roll", "box", (0.090, 0.032, 0.008), (0.038, 0.0, -0.027), None, dark),
            ("ankle_roll", "capsule", (0.022,), (-0.040, 0.0, -0.010), (0.100, 0.0, -0.014), shell),
            ("shoulder_pitch", "cylinder", (0.034,), (0.0, 0.0, 0.0), (0.0, 0.065 * out, -0.012), dark),
            ("shoulder_roll", "capsule", (0.034,), (0.0, 0.004 * out, -0.01), (0.0, 0.006 * out, -0.085), shell),
            ("shoulder_yaw", "capsule", (0.035,), (0.0, 0.0, -0.01), (0.012, 0.0, -0.075), shell),
            ("elbow", "capsule", (0.031,), (0.0, 0.0, -0.005), (0.085, 0.0, -0.01), dark),
            ("wrist_roll", "capsule", (0.028,), (0.01, 0.0, 0.0), (0.045, 0.0, 0.0), shell),
            ("wrist_pitch", "capsule", (0.026,), (0.0, 0.0, 0.0), (0.06, 0.0, 0.0), metal),
            ("wrist_yaw", "box", (0.045, 0.014, 0.030), (0.085, 0.0, 0.0), None, dark),
        ]
        shapes += [_at(f"{side}_{link}_link", *rest) for link, *rest in parts]
    return tuple(shapes)


# Down to the sole from the ankles, up from there to the knees; down to the underside of the buttocks from the middle of
# the hips and from the pelvis frame, with a centimeter for thighs that slope down to the knees.
_SOLE, _SHANK, _HIP_SEAT, _PELVIS_SEAT, _WAIST = 0.035, 0.317568, 0.032, 0.165, 0.044
# Standing feet are 0.237 m apart, the human's 0.170 m.
_OUT = 0.02


def _pairs(names: Names) -> tuple[Pair, ...]:
    """Which link follows which joint of one human skeleton."""
    waist = (_PELVIS_SEAT + _WAIST, names.pelvis_seat)
    pairs = [
        Pair(names.pelvis, "pelvis", "pelvis", surface=(_PELVIS_SEAT, names.pelvis_seat)),
        Pair(names.pelvis, "torso_link", "torso_link", surface=waist, turned_by=names.chest),
    ]
    for side, theirs, out in zip(("left", "right"), names.sides, (1.0, -1.0), strict=True):
        hip, knee, ankle, shoulder, elbow, wrist = (
            joint.format(theirs)
            for joint in (names.hip, names.knee, names.ankle, names.shoulder, names.elbow, names.wrist)
        )
        link = f"{side}_{{}}_link".format
        aside = (0.0, out * _OUT, 0.0)
        seat, knees = (_HIP_SEAT, names.hip_seat), (_SHANK + _SOLE, names.shank + names.sole)
        pairs += [
            Pair(hip, link("hip_roll"), link("hip_yaw"), surface=seat, frame=names.pelvis),
            Pair(knee, link("knee"), link("knee"), aside, knees, lowered=0.0),
            Pair(ankle, link("ankle_roll"), link("ankle_roll"), aside, (_SOLE, names.sole), weight=100.0),
            Pair(shoulder, link("shoulder_roll"), link("shoulder_yaw"), frame=names.chest, at_rest=True),
            Pair(elbow, link("elbow"), link("elbow"), frame=names.chest, at_rest=True),
            # the hand turns as the person's does; where it is follows from what it touches
            Pair(elbow, link("elbow"), link("wrist_yaw"), frame=names.chest, at_rest=True, turned_by=wrist),
        ]
    return tuple(pairs)


def _mapping(names: Names) -> Mapping:
    """From one human skeleton: its table, and the points that matter beyond it."""
    bearers = {
        "pelvis": ("pelvis", *(f"{side}_hip_{axis}_link" for side in _SIDES for axis in ("roll", "yaw"))),
        "back": ("torso_link",),
        **{f"{side}_hand": (f"{side}_wrist_yaw_link",) for side in _SIDES},
        **{f"{side}_foot": (f"{side}_ankle_roll_link",) for side in _SIDES},
    }
    feet = ("left_ankle_roll_link", "right_ankle_roll_link")
    return mapping_from(names, _pairs(names), feet, ((-0.06, 0.0, -0.035), (0.135, 0.0, -0.035)), bearers, "torso_link")


def _rest(joint: Joint) -> float:
    """Of a relaxed stand [rad]."""
    bent = {"hip_pitch": -0.2, "knee": 0.4, "ankle_pitch": -0.2, "shoulder_pitch": 0.2, "elbow": 0.6}
    aside = {"left_shoulder_roll_joint": 0.2, "right_shoulder_roll_joint": -0.2}
    return aside.get(joint.name, bent.get(_kind(joint.name), 0.0))


_SOLE_POINT, _HAND, _HEAD = (0.04, 0.0, -0.035), (0.11, 0.0, 0.0), (0.01, 0.0, 0.415)
ROBOT = Robot(
    name="g1",
    links=LINKS,
    joints=JOINTS,
    gains=GAINS,
    armature=0.01,
    damping=0.0,
    keypoints={
        **{f"{side}_ankle": (_INDEX[f"{side}_ankle_roll_link"], (0.0, 0.0, 0.0)) for side in _SIDES},
        **{f"{side}_sole": (_INDEX[f"{side}_ankle_roll_link"], _SOLE_POINT) for side in _SIDES},
        **{f"{side}_wrist": (_INDEX[f"{side}_wrist_yaw_link"], _HAND) for side in _SIDES},
        "head": (_INDEX["torso_link"], _HEAD),
    },
    rest_pose=tuple(_rest(joint) for joint in JOINTS),
    arms_down={"left_elbow_joint": 1.5707963, "right_elbow_joint": 1.5707963},
    collision=_collision(),
    visual=_visual(),
    mappings=tuple(_mapping(names) for names in PEOPLE),
    collides=(("left leg", "right leg"), ("left arm", "trunk"), ("right arm", "trunk"), ("left arm", "right arm")),
    legs=tuple((f"{side}_hip_roll_link", f"{side}_knee_link", f"{side}_ankle_roll_link") for side in _SIDES),
)
