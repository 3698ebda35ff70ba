"""The families of objects, and how an object is made again from its id alone."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from mimicbench.core.errors import BadObject
from mimicbench.core.registry import Registry

if TYPE_CHECKING:
    from mimicbench.objects.family import Family
    from mimicbench.objects.shape import SceneObject

FAMILIES: Registry[Family] = Registry(
    what="family of objects",
    package="mimicbench.objects.families",
    attribute="FAMILY",
    kind="mimicbench.objects.family:Family",
    group="mimicbench.families",
    first=("chair", "sofa", "couch", "bed", "household", "box"),
)


def make_object(object_id: str) -> SceneObject:
    """The object that an id such as `chair-0-00042` names. Raises BadObject or UnknownName."""
    match = re.fullmatch(r"([a-z]+)-(0|[1-9]\d{0,17})-(\d{5}|[1-9]\d{5,17})", object_id)
    if match is None:
        raise BadObject(
            f"{object_id!r} names no object of a family; ids look like chair-0-00042, and other "
            "objects are read from their files"
        )
    family, seed, index = match.groups()
    return FAMILIES.get(family).make(int(index), int(seed))
