"""The families of objects, and how an object is made again from its id alone."""

import re
from collections.abc import Callable

from mimicbench.core.errors import BadObject, UnknownName
from mimicbench.objects.families.beds import make_bed
from mimicbench.objects.families.boxes import make_box
from mimicbench.objects.families.chairs import make_chair
from mimicbench.objects.families.household import make_household
from mimicbench.objects.families.sofas import make_couch, make_sofa
from mimicbench.objects.shape import SceneObject

FAMILIES: dict[str, Callable[[int, int], SceneObject]] = {
    "chair": make_chair,
    "sofa": make_sofa,
    "couch": make_couch,
    "bed": make_bed,
    "household": make_household,
    "box": make_box,
}
"""family -> function of (index, seed). Ids are `<family>-<seed>-<index>`."""


def make_object(object_id: str) -> SceneObject:
    """The object that an id such as `chair-0-00042` names. Raises BadObject or UnknownName."""
    match = re.fullmatch(r"([a-z]+)-(0|[1-9]\d{0,17})-(\d{5}|[1-9]\d{5,17})", object_id)
    if match is None:
        raise BadObject(
            f"{object_id!r} names no object of a family; ids look like chair-0-00042, and other "
            "objects are read from their files"
        )
    family, seed, index = match.groups()
    if family not in FAMILIES:
        raise UnknownName("family of objects", family, list(FAMILIES))
    return FAMILIES[family](int(index), int(seed))
