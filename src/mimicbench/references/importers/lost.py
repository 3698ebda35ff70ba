"""Frames in which tracking was lost: for a moment the person is elsewhere, and comes back."""

from pathlib import Path

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import BadMotion

FASTEST = 15.0
"""A pelvis is slower than this [m/s]."""
LONGEST = 0.25
"""Whoever is elsewhere for longer [s] has not been lost: the file is of several takes, or damaged."""


def mend_lost_frames(
    path: Path, fps: float, root_pos_w: np.ndarray, local_quat: np.ndarray
) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Pelvis (T, 3) [m] and rotations (T, J, 4) that go evenly through frames in which tracking was lost, and what to
    say about them. Raises BadMotion where the pelvis jumps and does not come back.
    """
    speed = np.linalg.norm(np.diff(root_pos_w, axis=0), axis=-1) * fps
    root, quat, lost = root_pos_w.copy(), local_quat.copy(), []
    for first in np.flatnonzero(speed > FASTEST) + 1:
        if lost and first <= lost[-1] + 1:
            continue
        back = _comes_back(root, int(first), fps)
        if back is None:
            raise BadMotion(
                f"{path}: the person jumps by {np.linalg.norm(root[first] - root[first - 1]):.3g} m at frame {first}; "
                "cut the file there"
            )
        share = np.arange(1, back - first + 1) / (back - first + 1)
        root[first:back] = root[first - 1] + share[:, None] * (root[back] - root[first - 1])
        quat[first:back] = rot.slerp(quat[first - 1], quat[back], share[:, None])
        lost += range(first, back)
    if not lost:
        return root_pos_w, local_quat, ()
    frames = "frame" if len(lost) == 1 else "frames"
    return root, quat, (f"tracking was lost in {len(lost)} {frames} (from frame {lost[0]}), which were interpolated",)


def _comes_back(root: np.ndarray, first: int, fps: float) -> int | None:
    """The frame in which somebody is where they can have come from before `first`, if that is soon."""
    later = np.arange(first + 1, min(len(root), first + 1 + int(LONGEST * fps)))
    away = np.linalg.norm(root[later] - root[first - 1], axis=-1)
    near = later[away * fps <= FASTEST * (later - first + 1)]
    return int(near[0]) if len(near) else None
