"""How far who walks gets, beside how long the steps are: what positions and bones in different units do not fit."""

from pathlib import Path

import numpy as np

from mimicbench.core.errors import BadMotion
from mimicbench.core.skeleton import Skeleton
from mimicbench.references.body.body import body_of

AGREED = 0.5
"""Three quarters of the time, pelvis and steps must go the same way by this cosine to compare how far they go."""


def check_stride(path: Path, skeleton: Skeleton, pos: np.ndarray, fps: float) -> None:
    """Legs that walk must move the pelvis as far as their steps are long: otherwise positions and bones are in
    different units. Raises BadMotion.
    """
    scale = stride_scale(skeleton, pos, fps)
    if scale is not None and not 1 / 3 < scale < 3:
        raise BadMotion(
            f"{path} mixes units of length, or is from a treadmill: its pelvis moves {scale:.3g} "
            "times as far as its steps are long; mend it"
        )


def stride_scale(skeleton: Skeleton, pos: np.ndarray, fps: float) -> float | None:
    """How many times as long as they are the legs would have to be, so that standing feet stand still.

    None if nobody walks, or only on the spot.

    The pelvis moves as the lower foot moves the other way, relative to it; the median over the frames in which that
    foot is flat. For the real recordings that we know it is 1 within 8 %, mostly within 3 %.
    """
    body = body_of(skeleton)
    ankles = np.stack([pos[:, leg.end] for leg in body.legs], 1)
    pelvis = np.gradient(pos[:, 0, :2], 1 / fps, axis=0)
    relative = np.gradient(ankles[..., :2] - pos[:, None, 0, :2], 1 / fps, axis=0)
    lower = ankles[..., 2].argmin(-1)
    moves = -relative[np.arange(len(pos)), lower]
    pace = np.linalg.norm(moves, axis=-1)
    walks = (np.abs(ankles[:, 0, 2] - ankles[:, 1, 2]) > 0.02) & (pace > 0.3)
    if walks.sum() < 1.0 * fps:
        return None
    # a heel that has left the floor goes ahead of the foot
    walks &= ankles[..., 2].min(-1) <= np.quantile(ankles[walks, :, 2].min(-1), 0.4)
    along = (pelvis[walks] * moves[walks]).sum(-1)
    # who dances on the spot goes another way than the lower foot says
    if np.quantile(along / np.maximum(np.linalg.norm(pelvis[walks], axis=-1) * pace[walks], 1e-12), 0.25) < AGREED:
        return None
    return float(np.median(along / pace[walks] ** 2))
