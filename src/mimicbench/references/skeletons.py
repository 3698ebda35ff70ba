"""The human skeletons of the benchmark's sources, with the shapes of their body parts."""

from dataclasses import dataclass

import numpy as np

from mimicbench.core.motion import Skeleton

UNIHSI = Skeleton(
    name="unihsi",
    joint_names=(
        "pelvis", "torso", "head", "right_upper_arm", "right_lower_arm", "right_hand", "left_upper_arm", "left_lower_arm", "left_hand",
        "right_thigh", "right_shin", "right_foot", "left_thigh", "left_shin", "left_foot",
    ),
    parents=(-1, 0, 1, 1, 3, 4, 1, 6, 7, 0, 9, 10, 0, 12, 13),
    offsets=np.array([
        [0, 0, 0], [0, 0, 0.236151], [0, 0, 0.223894],
        [-0.02405, -0.18311, 0.2435], [0, 0, -0.274788], [0, 0, -0.258947],
        [-0.02405, 0.18311, 0.2435], [0, 0, -0.274788], [0, 0, -0.258947],
        [0, -0.084887, 0], [0, 0, -0.421546], [0, 0, -0.40987],
        [0, 0.084887, 0], [0, 0, -0.421546], [0, 0, -0.40987],
    ]),
)  # fmt: skip
"""The 15 bodies of the AMP humanoid that UniHSI moves (1.62 m tall). All joint frames are upright in the rest pose:
standing, arms straight down."""

SOLE = 0.05
"""Height of the ankle above the sole [m], at body size 1."""
TOE, HEEL = 0.1335, -0.0435
"""Ends of the sole in front of and behind the ankle [m], at body size 1."""
FOOT_HALF_WIDTH = 0.045
"""[m], at body size 1."""
BUTTOCK = 0.09
"""Radius of the pelvis about its joint [m], at body size 1: a seated pelvis is this far above the seat."""


@dataclass(frozen=True)
class Part:
    """A capsule that stands for a body part, at body size 1; a sphere where both ends agree."""

    joint: str
    start: tuple[float, float, float]
    """One end of its axis in the joint's frame [m]."""
    end: tuple[float, float, float]
    radius: float
    """[m]"""


UNIHSI_PARTS = (
    Part("pelvis", (0, 0, 0), (0, 0, 0), BUTTOCK),
    Part("torso", (0, 0, 0), (0, 0, 0.12), 0.10),
    Part("head", (0, 0, 0.175), (0, 0, 0.175), 0.095),
    *(
        part
        for side in ("left", "right")
        for part in (
            Part(f"{side}_upper_arm", (0, 0, -0.05), (0, 0, -0.23), 0.045),
            Part(f"{side}_lower_arm", (0, 0, -0.045), (0, 0, -0.21), 0.04),
            Part(f"{side}_hand", (0, 0, 0), (0, 0, 0), 0.04),
            Part(f"{side}_thigh", (0, 0, -0.06), (0, 0, -0.36), 0.055),
            Part(f"{side}_shin", (0, 0, -0.045), (0, 0, -0.355), 0.05),
            Part(f"{side}_foot", (HEEL + 0.03, 0, -0.02), (TOE - 0.03, 0, -0.02), 0.03),
        )
    ),
)
"""Body parts of `UNIHSI`, for penetration checks and for drawing."""
