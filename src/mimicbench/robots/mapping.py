"""Which link of a robot stands for which human joint (appendix B.1): data, which each robot has of its own."""

from collections.abc import Mapping as Dictionary
from dataclasses import dataclass

import numpy as np

from mimicbench.core.skeleton import Skeleton


@dataclass(frozen=True)
class Pair:
    """A human joint and the robot link that takes its place."""

    joint: str
    """Human joint."""
    link: str
    """Robot link whose position (and, in `paper`, orientation) follows the human joint."""
    carrier: str
    """The link after the last of the robot's joints that together make this human joint: only there does the joint's
    full rotation arrive."""
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """From the human joint to the point that the link follows [m]; no shift in `paper`."""
    surface: tuple[float, float] | None = None
    """How far below the link and below the human joint at size 1 the surface is that bears weight [m]: the shift grows
    by their difference, so that surface comes to lie on surface."""
    frame: str | None = None
    """Human joint whose axes the shift is in, if not `joint`."""
    at_rest: bool = False
    """Let the shift grow by what separates link and joint when both bodies stand, arms down, with their first pair in
    place."""
    weight: float = 1.0
    """Weight of the squared position error; 1 in `paper`."""
    lowered: float = 1.0
    """Share that its target takes of the drop of a body whose legs are shorter than the person's: 1 of what the legs
    carry, 0 of what stands where the feet do, such as knees."""
    turned_by: str | None = None
    """Human joint that the carrier's orientation follows, if not `joint`; not used in `paper`."""


@dataclass(frozen=True)
class Mapping:
    """A table of pairs between a human skeleton and the robot that has it, with the points that matter beyond it."""

    skeleton: str
    """Name of the human skeleton."""
    leg: tuple[str, str, str]
    """Human hip, knee and ankle of one leg: their rest length tells the body size."""
    leg_length: float
    """That length at size 1 [m]."""
    pairs: tuple[Pair, ...]
    wrists: tuple[tuple[str, str], ...]
    """Human joint and robot keypoint of each wrist, for L_hand."""
    feet: tuple[tuple[str, str], ...]
    """Human joint and robot link of each foot."""
    sole: tuple[tuple[float, float, float], ...]
    """Heel and toe of the robot's sole in the foot link's frame [m]."""
    bearers: Dictionary[str, tuple[str, ...]]
    """Robot links that bear in place of each part of the body that a contact label names."""
    forearms: tuple[tuple[str, str], ...]
    """Human elbow and wrist of each arm: the palm's middle is `palm` beyond the wrist, in the forearm's direction."""
    palm: float
    """[m] at size 1."""
    ankle_height: float
    """Of the human's ankle over the sole [m], at size 1."""
    trunk: str
    """The robot's link whose z axis leans as the person's trunk does."""

    def size_of(self, skeleton: Skeleton) -> float:
        """Body size of a skeleton: 1 for one as tall as the original."""
        _, knee, ankle = (skeleton.index(joint) for joint in self.leg)
        return float(np.linalg.norm(skeleton.offsets[[knee, ankle]], axis=-1).sum() / self.leg_length)
