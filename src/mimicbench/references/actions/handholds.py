"""Where the hands of somebody who sits may rest on a seat: on its arms, beside the thighs, or hanging past it."""

import numpy as np

from mimicbench.objects.shape import SceneObject
from mimicbench.references.body.body import Body

WRIST = 0.045
"""Height of a wrist over what the palm rests on [m]."""
HANGS = 0.93
"""Share of its length to which a hanging arm is stretched."""


def armrest(
    obj: SceneObject, body: Body, pelvis: np.ndarray, shoulder: np.ndarray, side: int, forward: float = 0.20
) -> np.ndarray | None:
    """Where the wrist (3,) [m] of the left (0) or right (1) hand rests on an arm beside who sits with the pelvis at
    (3,), best about `forward` [m] of it; None without one in reach.

    Looks straight down on a grid beside the body for what is between 6 and 28 cm above the seat and has nothing above
    it. `shoulder` is (3,).
    """
    height, sign = obj.require_seat(), 1.0 - 2.0 * side
    corners = (obj.corners() - pelvis) * [1.0, sign, 1.0]
    low, high = corners.min(1), corners.max(1)
    beside = (high[:, 1] > 0.2) & (low[:, 1] < 0.56) & (high[:, 0] > 0.0) & (low[:, 0] < 0.32)
    if not (beside & (high[:, 2] + pelvis[2] > height + 0.06)).any():
        return None
    x = pelvis[0] + np.arange(0.0, 0.34, 0.04)
    y = pelvis[1] + sign * np.arange(0.20, 0.56, 0.02)
    z = height + np.arange(0.06, 0.50, 0.02)
    points = np.stack(np.meshgrid(x, y, z, indexing="ij"), -1)
    solid = obj.distance(points) <= 0.0
    top = np.where(solid, z, -np.inf).max(-1)
    good = solid.any(-1) & (top < height + 0.28)
    # a hand is wide: the arm goes on to one side at least
    level = good[:, 1:] & good[:, :-1] & (np.abs(np.diff(np.where(good, top, 0.0), axis=1)) < 0.03)
    wide = np.pad(level, ((0, 0), (0, 1))) | np.pad(level, ((0, 0), (1, 0)))
    wrists = np.stack([*np.meshgrid(x, y, indexing="ij"), top + WRIST + 0.01], -1)
    away = np.linalg.norm(wrists - shoulder, axis=-1)
    reach = sum(body.length(body.arms[side]))
    fits = wide & (away < 0.94 * reach) & (away > 0.55 * reach)
    fits[fits] = obj.distance(wrists[fits]) > 0.04
    fits[fits] = obj.distance(wrists[fits] + 0.3 * (shoulder - wrists[fits])) > 0.05
    if not fits.any():
        return None
    # the most comfortable: the arm nearly straight, about as far in front of the hips as is wanted
    cost = np.where(
        fits,
        np.abs(away / reach - 0.88)
        + 1.5 * np.abs(wrists[..., 0] - pelvis[0] - forward)
        + 0.5 * np.abs(wrists[..., 1] - shoulder[1]),
        np.inf,
    )
    return wrists[np.unravel_index(int(np.argmin(cost)), cost.shape)]


def beside_thigh(
    obj: SceneObject, body: Body, pelvis: np.ndarray, side: int, along: float = 0.5, before_back: bool = False
) -> np.ndarray | None:
    """Where the wrist (3,) [m] of a hand rests on the seat beside the thighs; None if the seat ends there.

    As `along` goes from 0 to 1 that is from behind the pelvis, or beside it for who sits `before_back`, to the seat's
    front edge.
    """
    right, left = float(obj.seat_polygon[:, 1].min()), float(obj.seat_polygon[:, 1].max())
    edge = left - pelvis[1] if side == 0 else pelvis[1] - right
    # the farther behind, the wider; or on the seat's edge
    beside = min(body.hip_half_width + (0.135 + 0.12 * (1 - along)) * body.size, edge - 0.01)
    nearest = 0.04 if before_back else -0.16
    forward = nearest + along * (min(0.26, float(obj.seat_polygon[:, 0].max() - pelvis[0]) - 0.02) - nearest)
    wrist = np.array([pelvis[0] + forward, pelvis[1] + (1.0 - 2.0 * side) * beside, obj.require_seat() + WRIST])
    inside = obj.seat_polygon[:, 0].min() + 0.05 < wrist[0]
    wide = beside > body.hip_half_width + 0.10 * body.size
    return wrist if wide and inside and obj.distance(wrist) > 0.03 else None


def hanging(obj: SceneObject, body: Body, shoulder: np.ndarray, side: int) -> np.ndarray | None:
    """Where the wrist (3,) [m] of an arm is that hangs from a shoulder (3,) [m]; None if the object is there."""
    down = np.array([0.04, 0.16 * (1.0 - 2.0 * side), -1.0])
    wrist = shoulder + HANGS * sum(body.length(body.arms[side])) * down / np.linalg.norm(down)
    along = wrist - np.linspace(-0.14, 0.32, 7)[:, None] * body.size * down
    return wrist if obj.distance(along).min() > 0.06 and along[:, 2].min() > 0.03 else None
