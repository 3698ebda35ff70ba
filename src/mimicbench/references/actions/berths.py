"""Where on an object a body lies: the place, how it perches on the edge before, and where its feet find room."""

from dataclasses import dataclass

import numpy as np

from mimicbench.references.body.body import Body

SINK = 0.004
"""How far the pelvis of who lies sinks in [m]."""
SLANT = 0.10
"""How far people lie from parallel to the edge [rad], feet farther in: robots turn less than they are told, by 0.07 rad
in the median, which would leave an ankle over the edge.
"""


@dataclass(frozen=True)
class Berth:
    """Where on an object a body lies, and where it sits down before; directions and places seen from above [m]."""

    height: float
    """H, of the surface."""
    pillow: float
    """Height of the pillow above it; 0 without one."""
    head: np.ndarray
    """(2,) unit vector from pelvis to pillow."""
    out: np.ndarray
    """(2,) unit vector off the free edge, across `head` or nearly so: where who sits there faces."""
    pelvis_xy: np.ndarray
    """(2,) of who lies."""
    seat_xy: np.ndarray
    """(2,) of who sits on the edge."""
    stop_xy: np.ndarray
    """(2,) between the ankles of who is about to sit down."""
    room: float
    """From the lying pelvis to where the foot end stops the feet."""
    board: bool
    """Whether something stands up there, over which the legs cannot swing."""
    wide: bool
    """Whether there is room for an elbow on the side that is not free."""

    @property
    def turn(self) -> float:
        """From facing outwards to facing the feet of who lies [rad]."""
        across = self.out[1] * self.head[0] - self.out[0] * self.head[1]
        return float(np.arctan2(across, -self.out @ self.head))


def aslant(along: np.ndarray, out: np.ndarray) -> np.ndarray:
    """(2,) where the head of who lies aslant points, nearly `along` (2,) the free edge, which is towards `out` (2,)."""
    return np.cos(SLANT) * along + np.sin(SLANT) * out


def perch(body: Body, height: float, gap: float) -> tuple[float, float]:
    """How deep behind a seat's edge the pelvis sits, and how far in front of it the ankles stand [m].

    As deep as thighs that slope down to feet on the floor do not press into the edge; on high beds with the feet
    farther out.

    Args:
        body: Who sits.
        height: Of the seat [m].
        gap: The ankles must be at least this far in front of the edge [m].
    """
    upper, lower = body.length(body.legs[0])
    hip = height + body.buttock - 0.01 - body.hip_drop
    depth, ahead = (
        grid.ravel()
        for grid in np.meshgrid(np.linspace(0.17, 0.05, 9), gap + np.array([0.0, 0.05, 0.10, 0.16]), indexing="ij")
    )
    across, down = depth + ahead, hip - body.sole
    length = np.hypot(across, down)
    bend = np.arccos(np.clip((upper**2 + length**2 - lower**2) / (2 * upper * length), -1, 1))
    thigh = np.arctan2(across, down) + bend  # from straight down, forwards
    along = np.linspace(0.15, 0.85, 8)[:, None] * upper
    x, z = along * np.sin(thigh) - depth, hip - along * np.cos(thigh) - height
    clear = np.where((x < 0) & (z < 0), np.maximum(x, z), np.hypot(np.maximum(x, 0), np.maximum(z, 0))).min(0)
    pressed = np.maximum(0.055 * body.size - clear, 0.02) + 10 * np.maximum(length - 0.97 * (upper + lower), 0.0)
    best = int(np.argmin(pressed.round(4)))  # the first of equals: the deepest seat, the nearest feet
    return float(depth[best]), float(ahead[best])


def lifted_share(body: Body, berth: Berth) -> float:
    """Distance of the lifted ankles from the pelvis, as a share of the legs' length: less where the feet would sweep
    over an end that stands up.
    """
    return (
        min(0.66, max((berth.room - 0.95 * body.toe - 0.04) / sum(body.length(body.legs[0])), 0.49))
        if berth.board
        else 0.66
    )


def resting_foot(body: Body, berth: Berth, stretch: float) -> tuple[np.ndarray, float]:
    """Distance from the pelvis, side and height of the resting ankle [m], and how far the toes point up [rad].

    From hip to ankle it is `stretch` of the leg's length, as far as there is room; otherwise the knees stay up.
    """
    upper, lower = body.length(body.legs[0])
    hip = berth.height + body.back - SINK + float(body.skeleton.offsets[body.legs[0].root, 0])
    room = berth.room - body.hip_drop - 0.03
    distance, pitch = min(stretch * (upper + lower), room - body.sole), 0.9
    sole, corner = np.hypot(body.toe, body.sole), np.arctan2(body.sole, body.toe)
    for _ in range(12):
        # the ankle's height depends on the foot's pitch, and this on the leg's bend
        ankle = berth.height + _ankle_height(body, pitch)
        length = min(np.hypot(distance, hip - ankle), 0.985 * (upper + lower))
        shin = (
            np.pi / 2
            - np.arctan2(hip - ankle, distance)
            - np.arccos((lower**2 + length**2 - upper**2) / (2 * lower * length))
        )
        fits = corner + np.arccos(np.clip((room - distance) / sole, -1.0, 1.0))
        pitch = float(np.clip(max(shin - 0.30, fits), 0.0, max(shin, 0.0) + 0.40))
        if fits > pitch + 0.01:  # the toes cannot be drawn in so far: the knees are
            distance = max(distance - 0.025, 0.68 * upper)
    return np.array(
        [distance + body.hip_drop, body.hip_half_width + 0.025, berth.height + _ankle_height(body, pitch)]
    ), pitch


def _ankle_height(body: Body, pitch: float) -> float:
    """Of the ankle over what the heel lies on, toes up by `pitch` [rad]: of the rounded foot, which sinks in a
    little.
    """
    radius = 0.6 * body.sole
    return (
        float(-(body.heel + radius) * np.sin(pitch) + (body.sole - radius) * np.cos(pitch))
        + radius
        + 0.010 * np.sin(pitch)
        - 0.004
    )
