"""Finds a person's limbs in a skeleton by the joints' names, and what ROAM's joints are in it.

Only arms, legs and head are looked for by name. Spine and neck are what lies between: the chest is where the ways to
both arms part.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mimicbench.core.errors import BadMotion
from mimicbench.references.body.skeletons import ROAM

END = "Site"
"""Ending of the names of ends that have none."""

_SYNONYMS = {
    "hip": ("upleg", "upperleg", "thigh", "hip", "hips", "legupper", "femur", "upperlegs", "hipjoint2"),
    "knee": ("leg", "lowleg", "lowerleg", "calf", "shin", "knee", "leglower", "tibia"),
    "ankle": ("ankle", "foot"),
    "toe": ("toebase", "toe", "toes", "ball", "toe0", "forefoot", "foot"),
    "collar": ("shoulder", "collar", "clavicle", "collarbone", "thorax"),
    "shoulder": ("arm", "uparm", "upperarm", "shldr", "shoulder", "armupper", "humerus"),
    "elbow": ("forearm", "lowarm", "lowerarm", "elbow", "armlower", "radius"),
    "wrist": ("wrist", "hand"),
}
"""What joints are called in ROAM, Mixamo, LAFAN, CMU, Rokoko, Xsens, 3ds Max, Unreal, Blender, SMPL and ASF, without
side and prefix. Of two that a limb has, the first in order is meant: SMPL's hands hang from its wrists, and its feet,
which are the balls, from its ankles."""
_HEADS = ("head", "skull")
_MARKS = ("jnt", "jt", "bn", "bind")
"""Words of a name that only say that it is a joint's."""
_SIDES = {"left": "left", "l": "left", "lft": "left", "right": "right", "r": "right", "rgt": "right", "rt": "right"}


@dataclass(frozen=True)
class Limbs:
    """Joints by role; left before right."""

    collars: tuple[int | None, int | None]
    arms: tuple[tuple[int, int, int], tuple[int, int, int]]
    """Shoulder, elbow, wrist."""
    legs: tuple[tuple[int, int, int], tuple[int, int, int]]
    """Hip, knee, ankle."""
    toes: tuple[int | None, int | None]
    head: int


def find_limbs(path: Path, names: Sequence[str], parents: Sequence[int]) -> Limbs:
    """Find a person's joints. Raises BadMotion, naming what is missing."""
    parts = [split_name(name) for name in names]

    def find(side: str, role: str, below: int | None) -> int | None:
        for synonym in _SYNONYMS[role]:
            for j, part in enumerate(parts):
                if part == (side, synonym) and (below is None or below in ancestors(parents, j)):
                    return j
        return None

    def limb(side: str, roles: tuple[str, str, str]) -> tuple[int, int, int]:
        # from the end: `shoulder` and `leg` are said of different joints
        end = find(side, roles[2], None)
        if end is None and roles[2] == "wrist":  # some forearms just end
            middle = find(side, roles[1], None)
            end = (
                next((j for j, parent in enumerate(parents) if parent == middle and names[j].endswith(END)), None)
                if middle is not None
                else None
            )
        above = ancestors(parents, end) if end is not None else []
        middle = next((j for j in above if parts[j][0] == side and parts[j][1] in _SYNONYMS[roles[1]]), None)
        rest = ancestors(parents, middle) if middle is not None else []
        root = next((j for j in rest if parts[j][0] == side and parts[j][1] in _SYNONYMS[roles[0]]), None)
        for role, joint in zip(roles, (root, middle, end), strict=True):
            if joint is None:
                raise BadMotion(
                    f"{path}: no joint could be taken for the {side} {role}; it has "
                    f"{', '.join(names)[:300]}: rename its joints"
                )
        return root, middle, end  # type: ignore[return-value]

    arms = (limb("left", ("shoulder", "elbow", "wrist")), limb("right", ("shoulder", "elbow", "wrist")))
    legs = (limb("left", ("hip", "knee", "ankle")), limb("right", ("hip", "knee", "ankle")))
    collars = tuple(
        next(
            (j for j in ancestors(parents, arm[0]) if parts[j] in [(side, name) for name in _SYNONYMS["collar"]]), None
        )
        for side, arm in zip(("left", "right"), arms, strict=True)
    )
    toes = tuple(find(side, "toe", leg[2]) for side, leg in zip(("left", "right"), legs, strict=True))
    head = next((j for j, part in enumerate(parts) if part[0] == "" and part[1] in _HEADS), None)
    if head is None:
        raise BadMotion(
            f"{path}: no joint could be taken for the head; it has {', '.join(names)[:300]}: rename its joints"
        )
    return Limbs(collars, arms, legs, toes, head)  # type: ignore[arg-type]


def split_name(name: str) -> tuple[str, str]:
    """(side, what) of a joint's name in small letters: `mixamorig:LeftUpLeg`, `lThigh`, `thigh_l` and `Bip01 L
    Thigh` are of the left.
    """
    name = re.sub(r"^(mixamorig\d*|bip\w*?\d+|character\w*|\w+)[:|]", "", name)
    name = re.sub(r"^(Bip\d+|mixamorig\d*|DEF|ORG)(?=[\s_\-A-Z])", "", name)
    words = [word.lower() for word in re.findall(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+", name)]
    if len(words) > 1:
        words = [word for word in words if word not in _MARKS] or words
    side = ""
    for place in (0, -1):
        if not side and len(words) > 1 and words[place] in _SIDES:
            side = _SIDES[words.pop(place)]
    joined = "".join(words)
    if not side:  # leftarm, rfoot
        for start in ("left", "right"):
            if joined.startswith(start) and len(joined) > len(start):
                return start, joined[len(start) :]
        if len(joined) > 1 and joined[0] in "lr" and any(joined[1:] in synonyms for synonyms in _SYNONYMS.values()):
            return _SIDES[joined[0]], joined[1:]
    return side, joined


def ancestors(parents: Sequence[int], joint: int) -> list[int]:
    """The joints above one, the nearest first."""
    found = []
    while (joint := parents[joint]) >= 0:
        found.append(joint)
    return found


def onto_roam(names: Sequence[str], parents: Sequence[int], limbs: Limbs) -> tuple[list[int | None], list[str]]:
    """For each of ROAM's joints the source's (None if it has none), and the names of the joints between them that
    ROAM does not have.
    """
    index = ROAM.index
    found: list[int | None] = [None] * len(ROAM.joint_names)
    chest = next(j for j in ancestors(parents, limbs.arms[0][0]) if j in ancestors(parents, limbs.arms[1][0]))
    pelvis = next(j for j in ancestors(parents, limbs.legs[0][0]) if j in ancestors(parents, limbs.legs[1][0]))
    found[0] = pelvis
    spine = _between(parents, chest, pelvis)
    skipped: list[int] = []
    if chest != pelvis:
        found[index("Spine3")] = chest
        kept, extra = spine[:3], spine[3:]
        skipped += extra
        for name, joint in zip(("Spine", "Spine1", "Spine2"), kept, strict=False):
            found[index(name)] = joint
    found[index("Head")] = limbs.head
    neck = _between(parents, limbs.head, chest)
    # ROAM's chest carries Spine4 and Neck below the head
    kept, extra = neck[-2:], neck[:-2]
    skipped += extra
    for name, joint in zip(("Neck", "Spine4"), reversed(kept), strict=False):
        found[index(name)] = joint
    found[index("HeadSite")] = _end(names, parents, limbs.head)
    for side, collar, arm, leg, toe in zip(
        ("Left", "Right"), limbs.collars, limbs.arms, limbs.legs, limbs.toes, strict=True
    ):
        for name, joint in zip(("Arm", "ForeArm", "Hand", "UpLeg", "Leg", "Foot"), (*arm, *leg), strict=True):
            found[index(side + name)] = joint
        found[index(f"{side}Shoulder")] = collar
        found[index(f"{side}ToeBase")] = toe
        found[index(f"{side}ToeBaseSite")] = _end(names, parents, toe) if toe is not None else None
    used = set(found)
    ways = [(limb[i + 1], limb[i]) for limb in (*limbs.arms, *limbs.legs) for i in range(2)] + [
        (leg[0], pelvis) for leg in limbs.legs
    ]
    ways += [(arm[0], chest) for arm in limbs.arms]
    skipped += [j for end, start in ways for j in _between(parents, end, start) if j not in used]
    return found, [names[j] for j in dict.fromkeys(skipped)]


def _between(parents: Sequence[int], end: int, start: int) -> list[int]:
    """Joints strictly between, from the start on; all the way to the root if `start` is not above `end`."""
    way = ancestors(parents, end)
    return way[: way.index(start)][::-1] if start in way else []


def _end(names: Sequence[str], parents: Sequence[int], joint: int) -> int | None:
    """The tip of a joint: its child without a name, or one that is called an end."""
    children = [j for j, parent in enumerate(parents) if parent == joint]
    return next(
        (j for j in children if names[j].endswith(END) or re.search(r"end|nub|tip|site", names[j], re.IGNORECASE)), None
    )
