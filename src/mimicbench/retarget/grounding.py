"""Standing a robot motion on the floor: one constant change of height per clip."""

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.motion import HumanMotion
from mimicbench.retarget.kinematics import Links
from mimicbench.retarget.mapping import Bound

FEET = ("left_foot", "right_foot")
"""What contact labels call the feet, in the order of every mapping."""
_NEAR = 0.12  # [m] soles higher than this all the time do not stand on the floor, whatever the clip shows
_FURNITURE = 0.28  # [m] feet that bear higher than this do so on a bed or a sofa, not on the floor


def sole_heights(links: Links, bound: Bound) -> np.ndarray:
    """(T, F) height of the lowest point of each foot's sole [m]."""
    heights = []
    for _, link in bound.feet:
        points = links.pos[:, link, None] + rot.rotate(links.quat[:, link, None], bound.sole)
        heights.append(points[..., 2].min(-1))
    return np.stack(heights, -1)


def stance(motion: HumanMotion, bound: Bound, ankle_pos_w: np.ndarray) -> np.ndarray:
    """(T, F) whether each foot bears weight: the clip's labels, or, without them, a human ankle (T, F, 3) that is
    low and slow.
    """
    if motion.contacts.size and all(name in motion.contact_names for name in FEET):
        return motion.contacts[:, [motion.contact_names.index(name) for name in FEET]].astype(bool)
    speed = np.linalg.norm(np.gradient(ankle_pos_w, axis=0), axis=-1) * motion.fps
    return (ankle_pos_w[..., 2] < _NEAR) & (speed < 0.2)


def ground(links: Links, bound: Bound, standing: np.ndarray) -> float:
    """The change of height [m] that puts the median stance sole on the floor.

    Without a stance, the lowest twentieth, if it is near the floor.
    """
    heights = sole_heights(links, bound)
    standing = standing & (heights < _FURNITURE)
    if standing.any():
        return -float(np.median(heights[standing]))
    lowest = float(np.percentile(heights.min(-1), 5))
    return -lowest if abs(lowest) < _NEAR else 0.0


def runs(values: np.ndarray) -> list[tuple[int, int]]:
    """First and one past the last index of every run of true values in (T,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.asarray(values, np.int8), [0]])))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
