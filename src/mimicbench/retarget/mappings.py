"""Which human skeletons can become which robots."""

from collections.abc import Mapping as Dictionary

from mimicbench.core.errors import UnknownName
from mimicbench.retarget.h1_tables import CORE4D_H1, ROAM_H1, UNIHSI_H1
from mimicbench.retarget.mapping import Mapping

MAPPINGS: Dictionary[tuple[str, str], Mapping] = {(m.skeleton, m.robot): m for m in (UNIHSI_H1, ROAM_H1, CORE4D_H1)}


def find_mapping(skeleton: str, robot: str) -> Mapping:
    """The table between a human skeleton and a robot. Raises UnknownName."""
    if (skeleton, robot) not in MAPPINGS:
        raise UnknownName(
            "retargeting from skeleton to robot", f"{skeleton} -> {robot}", [f"{s} -> {r}" for s, r in MAPPINGS]
        )
    return MAPPINGS[skeleton, robot]
