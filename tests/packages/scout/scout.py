"""A robot of somebody else: a humanoid of 1.6 m with 17 joints, whose arms do not turn about themselves."""

from mimicbench.robots.description import Gains, Joint, Link, Robot, Shape
from mimicbench.robots.mapping import Mapping, Pair
from mimicbench.robots.people import PEOPLE, Names, mapping_from

SIDES = (("l", 1.0), ("r", -1.0))
SIZE = 0.9
X, Y, Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
LIMBS = (
    # name, parent (None: the base), place in it, axis, range, torque, mass; of the left side
    ("hip_yaw", None, (0.0, 0.09, -0.17), Z, (-0.6, 0.6), 200.0, 2.0),
    ("hip_roll", "hip_yaw", (0.0, 0.0, 0.0), X, (-0.6, 0.6), 200.0, 2.0),
    ("thigh", "hip_roll", (0.0, 0.06, 0.0), Y, (-2.8, 2.2), 200.0, 3.5),
    ("shank", "thigh", (0.0, 0.0, -0.4), Y, (-0.1, 2.3), 300.0, 1.6),
    ("foot", "shank", (0.0, 0.0, -0.4), Y, (-0.9, 0.7), 60.0, 0.6),
    ("shoulder", "chest", (0.0, 0.2, 0.43), Y, (-2.9, 2.9), 40.0, 1.0),
    ("upper_arm", "shoulder", (0.0, 0.03, 0.0), X, (-0.4, 3.1), 40.0, 1.0),
    ("forearm", "upper_arm", (0.0, 0.0, -0.3), Y, (-2.6, 0.2), 20.0, 0.8),
)
NAMES = ("base", "chest", *(f"{side}_{limb[0]}" for side, _ in SIDES for limb in LIMBS))


def index(name: str) -> int:
    """Of a link."""
    return NAMES.index(name)


def scaled(place: tuple[float, float, float], sign: float = 1.0) -> tuple[float, float, float]:
    """A place on the left side, or its mirror image."""
    x, y, z = place
    return SIZE * x, SIZE * sign * y, SIZE * z


def _bodies() -> tuple[tuple[Link, ...], tuple[Joint, ...]]:
    upright = (1.0, 0.0, 0.0, 0.0)
    links = [
        Link("base", -1, (0.0, 0.0, 0.0), upright, 5.0, (0.0, 0.0, -0.04), (0.04, 0.02, 0.04, 0.0, 0.0, 0.0)),
        Link("chest", 0, (0.0, 0.0, 0.0), upright, 14.0, (0.0, 0.0, 0.2), (0.4, 0.3, 0.1, 0.0, 0.0, 0.0)),
    ]
    joints = [Joint("waist", 1, Z, (-2.0, 2.0), 200.0, 20.0)]
    for side, sign in SIDES:
        for name, parent, place, axis, (low, high), torque, mass in LIMBS:
            above = 0 if parent is None else index(parent if parent == "chest" else f"{side}_{parent}")
            long = name in ("thigh", "shank", "forearm", "upper_arm")
            com = (0.0, 0.0, -0.15) if long else (0.0, 0.0, 0.0)
            inertia = (0.03, 0.03, 0.005, 0.0, 0.0, 0.0) if long else (0.005, 0.005, 0.005, 0.0, 0.0, 0.0)
            links.append(Link(f"{side}_{name}", above, scaled(place, sign), upright, mass, com, inertia))
            limits = (low, high) if axis == Y or sign > 0 else (-high, -low)
            joints.append(Joint(f"{side}_{name}_joint", len(links) - 1, axis, limits, torque, 20.0))
    return tuple(links), tuple(joints)


LINKS, JOINTS = _bodies()


def _shapes() -> tuple[Shape, ...]:
    shapes = [
        Shape(0, "capsule", (0.07,), (-0.02, -0.08, -0.15), (-0.02, 0.08, -0.15), "trunk"),
        Shape(1, "box", (0.07, 0.11, 0.19), (0.0, 0.0, 0.23), None, "trunk"),
        Shape(1, "sphere", (0.09,), (0.03, 0.0, 0.56), None, "head"),
    ]
    for side, _ in SIDES:
        thigh, shank, foot, upper, forearm = (
            index(f"{side}_{name}") for name in ("thigh", "shank", "foot", "upper_arm", "forearm")
        )
        shapes += [
            Shape(thigh, "capsule", (0.06,), (0.0, 0.0, 0.0), (0.0, 0.0, -0.3), f"{side} leg"),
            Shape(shank, "capsule", (0.045,), (0.0, 0.0, -0.03), (0.0, 0.0, -0.3), f"{side} leg"),
            *(
                Shape(foot, "capsule", (0.014,), (-0.08, y, -0.05), (0.17, y, -0.05), f"{side} leg")
                for y in (-0.028, 0.028)
            ),
            Shape(upper, "capsule", (0.04,), (0.0, 0.0, -0.03), (0.0, 0.0, -0.2), f"{side} arm"),
            Shape(forearm, "capsule", (0.035,), (0.0, 0.0, 0.0), (0.0, 0.0, -0.24), f"{side} arm"),
        ]
    return tuple(shapes)


def _gains() -> Gains:
    kp, kd, scale = [], [], []
    for joint in JOINTS:
        arm = any(part in joint.name for part in ("shoulder", "arm"))
        kp.append(80.0 if arm else 40.0 if "foot" in joint.name else 200.0)
        kd.append(2.0 if arm or "foot" in joint.name else 5.0)
        scale.append(0.3)
    return Gains(tuple(kp), tuple(kd), tuple(scale))


def _mapping(names: Names) -> Mapping:
    pairs = [
        Pair(names.pelvis, "base", "base", surface=(0.22, names.pelvis_seat)),
        Pair(names.pelvis, "chest", "chest", surface=(0.22, names.pelvis_seat), turned_by=names.chest),
    ]
    for (side, _), theirs in zip(SIDES, names.sides, strict=True):
        hip, knee, ankle, shoulder, elbow = (
            joint.format(theirs) for joint in (names.hip, names.knee, names.ankle, names.shoulder, names.elbow)
        )
        pairs += [
            Pair(hip, f"{side}_hip_roll", f"{side}_thigh", surface=(0.07, names.hip_seat), frame=names.pelvis),
            Pair(knee, f"{side}_shank", f"{side}_shank"),
            Pair(ankle, f"{side}_foot", f"{side}_foot", surface=(0.064, names.sole), weight=100.0),
            Pair(shoulder, f"{side}_shoulder", f"{side}_upper_arm", frame=names.chest, at_rest=True),
            Pair(elbow, f"{side}_forearm", f"{side}_forearm", frame=names.chest, at_rest=True),
        ]
    bearers = {
        "pelvis": ("base", "l_thigh", "r_thigh"),
        "back": ("chest",),
        "left_hand": ("l_forearm",),
        "right_hand": ("r_forearm",),
        "left_foot": ("l_foot",),
        "right_foot": ("r_foot",),
    }
    sole = ((-0.09, 0.0, -0.064), (0.18, 0.0, -0.064))
    return mapping_from(names, tuple(pairs), ("l_foot", "r_foot"), sole, bearers, "chest")


def _rest(joint: Joint) -> float:
    bent = {"thigh": -0.2, "shank": 0.4, "foot": -0.2, "forearm": -0.6}
    return bent.get(joint.name.removesuffix("_joint")[2:], 0.0)


def _keypoints() -> dict[str, tuple[int, tuple[float, float, float]]]:
    sole, wrist = (0.05, 0.0, -0.064), (0.0, 0.0, -0.25)
    places = {"ankle": ("foot", (0.0, 0.0, 0.0)), "sole": ("foot", sole), "wrist": ("forearm", wrist)}
    return {
        f"{word}_{name}": (index(f"{side}_{link}"), place)
        for name, (link, place) in places.items()
        for word, side in (("left", "l"), ("right", "r"))
    }


ROBOT = Robot(
    name="scout",
    links=LINKS,
    joints=JOINTS,
    gains={"improved": _gains(), "paper": _gains()},
    armature=0.1,
    damping=1.0,
    keypoints={
        **_keypoints(),
        "head": (1, (0.03, 0.0, 0.56)),
    },
    rest_pose=tuple(_rest(joint) for joint in JOINTS),
    arms_down={},
    collision=_shapes(),
    visual=(),
    collides=(("l leg", "r leg"), ("l arm", "trunk"), ("r arm", "trunk")),
    legs=tuple((f"{side}_thigh", f"{side}_shank", f"{side}_foot") for side, _ in SIDES),
    mappings=tuple(_mapping(names) for names in PEOPLE),
)
