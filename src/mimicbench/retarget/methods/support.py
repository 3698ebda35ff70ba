"""What bears a body in each frame: its feet alone, what it sits or lies on, or the hands behind who swings the legs
up.
"""

from dataclasses import dataclass

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.retarget.clip import Clip
from mimicbench.retarget.methods.anchors import Anchors
from mimicbench.retarget.methods.interaction_config import InteractionConfig
from mimicbench.retarget.samples import Balls
from mimicbench.retarget.trunk import bears, trunk_up
from mimicbench.robots.description import Robot
from mimicbench.robots.mapping import Mapping


@dataclass(frozen=True)
class Support:
    """Of a clip of T frames, for a robot made of S balls."""

    margins: np.ndarray
    """(T, S) least clearance of each ball [m]."""
    bearing: tuple[tuple[np.ndarray, np.ndarray], ...]
    """Of each part that bears, beside feet and hands with their anchors: (T,) when, and (S,) which balls it is made
    of."""
    seated: np.ndarray
    """(T,) whether the root bears and both feet stand on the floor."""
    lying: np.ndarray
    """(T,) whether the root bears and no foot stands on the floor."""
    perched: np.ndarray
    """(T,) whether the root of who is to lie bears alone, a leg in the air: the center of mass must not be behind where
    it does."""
    balanced: np.ndarray
    """(T,) whether the center of mass must be over the feet."""
    heading: np.ndarray
    """(T, 3) mean direction of the feet."""
    ankles: np.ndarray
    """(T, 3) middle of both ankles' anchors [m]."""


def support_of(clip: Clip, mapping: Mapping, balls: Balls, anchors: Anchors, config: InteractionConfig) -> Support:
    """What bears a robot that does as a clip's person does."""
    motion, robot = clip.motion, clip.robot
    bound = clip.bind("improved")
    feet, wrists = [link for _, link in bound.feet], np.array([link for _, link, _ in bound.wrists])
    margins, bearing = _bearing(clip, mapping, balls, config, feet, wrists)
    balanced, heading, ankles = _balance(motion.fps, anchors, bearing, config)
    rests = np.any(
        [when & which[balls.link == 0].any() for when, which in bearing] or [np.zeros(motion.frames, bool)], 0
    )
    seated, lying = rests & anchors.on_floor.all(-1), rests & ~anchors.on_floor.any(-1)
    tilt = np.arccos(np.clip(trunk_up(motion)[:, 2], -1.0, 1.0))
    perched = rests & ~seated & ~bears(motion, "back") & (tilt < config.lying_from) & lying[-1]
    leans = tilt > config.leaning_from
    bearing.append((perched, balls.link == 0))
    bearing += [(perched & leans, np.isin(balls.link, links)) for links in _hands(robot, mapping)]
    return Support(margins, tuple(bearing), seated, lying, perched & ~leans, balanced, heading, ankles)


def _bearing(
    clip: Clip, mapping: Mapping, balls: Balls, config: InteractionConfig, feet: list[int], wrists: np.ndarray
) -> tuple[np.ndarray, list[tuple[np.ndarray, np.ndarray]]]:
    """Distances (T, S) [m] that balls keep, and what bears beside feet and hands: when (T,) and which balls (S,)."""
    motion, robot = clip.motion, clip.robot
    margins = np.where(np.isin(balls.link, feet), 0.0, config.margin) * np.ones((motion.frames, 1))
    bearing = []
    for column, name in enumerate(motion.contact_names):
        links = [robot.link_names.index(link) for link in mapping.bearers.get(name, ())]
        when, which = motion.contacts[:, column].astype(bool), np.isin(balls.link, links)
        margins[np.ix_(when, which)] = 0.0
        if not set(links) & {*feet, *wrists}:  # feet and hands have their anchors
            bearing.append((when, which))
    return margins, bearing


def _hands(robot: Robot, mapping: Mapping) -> list[list[int]]:
    """The links that bear in place of the left and the right hand."""
    return [[robot.link_names.index(link) for link in mapping.bearers[f"{side}_hand"]] for side in ("left", "right")]


def _balance(
    fps: float, anchors: Anchors, bearing: list[tuple[np.ndarray, np.ndarray]], config: InteractionConfig
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(T,) when the feet alone bear, (T, 3) where they point on average, (T, 3) the middle of the ankles [m]."""
    alone = np.asarray(anchors.on_floor.all(-1))
    soon = round(config.before_sitting * fps)
    for when, _ in bearing:
        for shift in range(soon + 1):
            alone = alone & ~np.concatenate([when[shift:], np.repeat(when[-1:], min(shift, len(when)))])
    heading = rot.rotate(anchors.foot_quat_w, np.array([1.0, 0.0, 0.0])).mean(1) * [1.0, 1.0, 0.0]
    heading /= np.maximum(np.linalg.norm(heading, axis=-1, keepdims=True), 1e-6)
    return alone, heading, anchors.foot_pos_w.mean(1)
