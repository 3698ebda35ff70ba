"""Where people look while they walk: where the way leads, and at the seat before they turn their back to it."""

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.references.curves import minimum_jerk, smooth
from mimicbench.references.locomotion.gait import Footsteps
from mimicbench.references.locomotion.route import ahead_of

SOON = 0.8
"""The head is turned to where the body will be heading so much later [s]..."""
MOST = 0.6
"""...by so much at most [rad]."""
FARTHEST = 0.6
"""So far it turns to what the person will sit down on [rad]; what is farther behind is looked at no more."""
TURNS_ROUND = 1.2
"""Who turns by more over the last steps goes to something behind [rad]."""
BEFORE = 1.3
"""Who turns round looks at it so long before the first of these steps [s]."""
BEHIND, LOW, EYES = 0.3, 0.45, 1.45
"""It is so far behind the heels and so high [m]; and the eyes of a person of size 1."""


def gaze(
    steps: Footsteps, time: np.ndarray, pelvis_xy: np.ndarray, yaw: np.ndarray, size: float
) -> tuple[np.ndarray, np.ndarray]:
    """How far the head turns to the left of the pelvis' heading (T,) and how far down it nods beyond the usual (T,)
    [rad].
    """
    fps = 1.0 / float(time[1] - time[0])
    soon = int(SOON * fps)
    coming = np.concatenate([yaw[soon:], np.repeat(yaw[-1:], min(soon, len(yaw)))])[: len(yaw)]
    look, nod = np.clip(coming - yaw, -MOST, MOST), np.zeros(len(yaw))
    round_from = _turns_round(steps)
    if round_from is not None:
        end_yaw = float(steps.yaw[-1])
        seat = _last_places(steps).mean(0) - BEHIND * size * ahead_of(end_yaw)
        away = seat - pelvis_xy
        towards = rot.wrap_angle(np.arctan2(away[:, 1], away[:, 0]) - yaw)
        down = np.arctan2(EYES * size - LOW, np.maximum(np.linalg.norm(away, axis=-1), 0.4))
        begins = float(steps.lift_off[round_from]) - BEFORE
        share = minimum_jerk((time - begins) / 0.8) * (1.0 - minimum_jerk((np.abs(towards) - 1.4) / 1.2))
        look = look + share * (np.clip(towards, -FARTHEST, FARTHEST) - look)
        nod = share * np.minimum(0.4 * down, 0.3)  # the eyes do the rest
    width = round(0.25 * fps)
    return smooth(look, width), smooth(nod, width)


def _turns_round(steps: Footsteps) -> int | None:
    """The first of the last steps over which the heading turns round to what is behind, if it does."""
    yaws = np.concatenate([[steps.first_yaw], steps.yaw])
    turns = np.diff(yaws)
    first, total = len(turns), 0.0
    direction = 0.0
    for i in range(len(turns) - 1, -1, -1):
        if abs(turns[i]) < 0.1 and direction:
            break
        if direction and np.sign(turns[i]) != direction and abs(turns[i]) > 1e-6:
            break
        direction = np.sign(turns[i]) if abs(turns[i]) > 0.1 else direction
        total, first = total + turns[i], i
    return first if abs(total) > TURNS_ROUND and len(turns) else None


def _last_places(steps: Footsteps) -> np.ndarray:
    """(2, 2) where both feet stand in the end [m]."""
    places = steps.first_xy.copy()
    for side, xy in zip(steps.side, steps.xy, strict=True):
        places[side] = xy
    return places
