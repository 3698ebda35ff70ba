"""Where a walk leads and where its feet stand: a route around the object, and footsteps on it with a bounded step
and turn.
"""

from dataclasses import dataclass

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.references.locomotion.route import Route, left_of

QUICK, WHOLE = 0.8, 0.5
"""A step on the spot takes this share of the time of one on the way, and one of this share of the usual length all of
it: who walks slower takes his steps less often, not more (Boulic et al. 1990).
"""
LONGEST = 0.62
"""Between the ankles at a touch-down, at most, unless the usual step is almost as long [m]."""


@dataclass(frozen=True)
class Gait:
    """How a person walks. Lengths are for body size 1 and grow with it."""

    speed: float = 0.7
    """Forward speed on a straight way [m/s], not scaled."""
    width: float = 0.15
    """Between the ankles [m]."""
    max_turn: float = 0.70
    """Change of heading per step [rad]."""
    first_step: float = 0.85
    """Length of the first step, as a share of the usual."""
    last_step: float = 0.85
    """And that of the last one, in which the body comes to rest."""
    stretch: float = 0.35
    """The steps to the end of the way may all be longer than usual, to be one fewer, if the last would be shorter than
    this share of one."""
    clearance: float = 0.048
    """Height of the sole in a swing, at most [m]."""
    stand: float = 0.8
    """Time before the first swing, in which the weight shifts [s]."""

    @property
    def period(self) -> float:
        """From one touch-down to the next [s]: at higher speeds cadence and step length both grow with the root of
        the speed.

        That is 0.58 s at 1.3 m/s (Boulic et al. 1990 with a leg of 0.8 m: 0.53 s; Perry & Burnfield 2010: 0.51 to 0.57
        s; 0.64 s at 1.16 m/s in a recording), and 0.8 s at 0.65 m/s (seven people on their way to a seat or bed).
        """
        return min(0.82, 0.8 * (0.65 / max(self.speed, 1e-3)) ** 0.45)

    @property
    def overlap(self) -> float:
        """Share of the step time with both feet on the floor: less at higher speeds, 20 % at 1.3 m/s (Perry &
        Burnfield 2010).
        """
        return float(np.clip(0.22 - 0.1 * (self.speed - 0.65), 0.12, 0.26))

    @property
    def swing_time(self) -> float:
        """From lift-off to touch-down of a foot [s]."""
        return self.period * (1.0 - self.overlap)


@dataclass(frozen=True)
class Footsteps:
    """Both feet's first places and every step after them; left is side 0 with sign +1, right is side 1 with sign -1."""

    first_xy: np.ndarray
    """(2, 2) ankles of left and right at the start [m]."""
    first_yaw: float
    """Heading at the start [rad]."""
    side: np.ndarray
    """(N,) which foot steps."""
    xy: np.ndarray
    """(N, 2) where its ankle lands [m]."""
    yaw: np.ndarray
    """(N,) its heading then [rad], without jumps of 2 pi."""
    lift_off: np.ndarray
    """(N,) [s]"""
    touch_down: np.ndarray
    """(N,) [s]"""
    first_feet_yaw: np.ndarray | None = None
    """(2,) headings of left and right foot at the start [rad], where they are not `first_yaw`."""

    @property
    def first_foot_yaw(self) -> np.ndarray:
        """(2,) headings of left and right foot at the start [rad]."""
        return np.full(2, self.first_yaw) if self.first_feet_yaw is None else self.first_feet_yaw

    @property
    def end(self) -> float:
        """Time of the last touch-down [s], or 0 without steps."""
        return float(self.touch_down[-1]) if len(self.side) else 0.0


def plan_footsteps(
    start_yaw: float, route: Route, goal_xy: np.ndarray, goal_yaw: float, gait: Gait, scale: float
) -> Footsteps:
    """Steps along the route, then a stepping turn that backs from its end to the goal, then a step that closes the
    feet.

    Args:
        start_yaw: Heading at the start [rad]; the start's place is the route's.
        route: The way.
        goal_xy: (2,) final place of the point between the ankles [m].
        goal_yaw: Final heading [rad].
        gait: How to walk.
        scale: Body size.
    """
    centers, yaws = body_places(start_yaw, route, goal_xy, goal_yaw, gait)
    half = 0.5 * gait.width * scale
    first_xy = np.stack([_beside(route.points[0], start_yaw, half), _beside(route.points[0], start_yaw, -half)])
    centers, yaws = [*centers, goal_xy], [*yaws, yaws[-1]]
    side, xy = place_feet(first_xy, [start_yaw, start_yaw], centers, yaws, first_side(start_yaw, yaws), gait, scale)
    times = step_times([route.points[0], *centers], gait)
    touch_down = gait.stand + np.cumsum(times) - gait.overlap * times
    lift_off = touch_down - (1.0 - gait.overlap) * times
    return Footsteps(first_xy, start_yaw, side, xy, np.array(yaws), lift_off, touch_down)


def step_times(centers: list[np.ndarray], gait: Gait) -> np.ndarray:
    """(N,) how long the steps take [s] with which a body goes through N + 1 places (2,) [m]."""
    gone = np.linalg.norm(np.diff(centers, axis=0), axis=-1) / (gait.speed * gait.period)
    return gait.period * (QUICK + (1.0 - QUICK) * np.minimum(gone / WHOLE, 1.0))


def first_side(start_yaw: float, yaws: list[float]) -> int:
    """Which foot a person who stands steps with first: the one on the side of the first turn."""
    turn = next((d for d in np.diff([start_yaw, *yaws]) if abs(d) > 0.05), 1.0)
    return 0 if turn > 0 else 1


def place_feet(
    foot_xy: np.ndarray,
    foot_yaw: list[float],
    centers: list[np.ndarray],
    yaws: list[float],
    side: int,
    gait: Gait,
    scale: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Sides (N,) and ankles (N, 2) [m] of the steps that carry the body from place to place, the first with foot
    `side`.

    Args:
        foot_xy: (2, 2) where both ankles are before [m].
        foot_yaw: Their headings [rad].
        centers: N places (2,) of the body at the touch-downs [m].
        yaws: N headings of the body then [rad].
        side: The foot that steps first.
        gait: How to walk.
        scale: Body size.
    """
    half, apart = 0.5 * gait.width * scale, min(0.185, 0.8 * gait.width) * scale
    longest = max(LONGEST, 1.2 * gait.speed * gait.period)
    foot_xy, foot_yaw = foot_xy.copy(), list(foot_yaw)
    sides, landed = [], []
    for center, yaw in zip(centers, yaws, strict=True):
        sign = 1.0 - 2.0 * side
        stance_xy, stance_yaw = foot_xy[1 - side], foot_yaw[1 - side]
        place = _beside(center, yaw, sign * half)
        # a turn towards the stance foot must not cross the legs: keep to one's own side of it
        sideways = sign * ((place - stance_xy) @ left_of(stance_yaw))
        place = place + sign * max(0.0, apart - sideways) * left_of(stance_yaw)
        # after such a turn the next step would be a lunge
        between = float(np.linalg.norm(place - stance_xy))
        if between > longest:
            place = stance_xy + longest / between * (place - stance_xy)
        foot_xy[side], foot_yaw[side] = place, yaw
        landed.append(place)
        sides.append(side)
        side = 1 - side
    return np.array(sides, int), np.array(landed).reshape(-1, 2)


def last_turn(steps: Footsteps) -> float:
    """1 if the last turn is to the left, -1 if it is to the right: a choice that flips where the way leads straight
    ahead.
    """
    turns = np.diff(np.concatenate([[steps.first_yaw], steps.yaw]))
    turns = turns[np.abs(turns) > 1e-6]
    return 1.0 if not len(turns) or turns[-1] > 0 else -1.0


def body_places(
    start_yaw: float, route: Route, goal_xy: np.ndarray, goal_yaw: float, gait: Gait, pace: float | None = None
) -> tuple[list[np.ndarray], list[float]]:
    """Place and heading of the body at every touch-down, at first with steps `pace` times as long as later, or
    `gait.first_step` times.
    """
    pace = gait.first_step if pace is None else pace
    centers: list[np.ndarray] = []
    yaws: list[float] = []
    yaw, gone, total = start_yaw, 0.0, route.length
    longest = gait.speed * gait.period
    while total - gone > 0.05 and len(yaws) < 200:
        error = rot.wrap_angle(route.at(min(gone + 0.15, total))[1] - yaw)
        turn = float(np.clip(error, -gait.max_turn, gait.max_turn))
        yaw += turn
        still = abs(error - turn)
        if still < 1.0:
            step = pace * longest * np.cos(still) ** 2 * (1.0 - 0.6 * abs(turn) / gait.max_turn)
            before = max(0.0, np.ceil((total - gone) / step - gait.last_step - gait.stretch))
            gone += (total - gone) / (before + gait.last_step) if before else total - gone
            pace = min(1.0, pace + 0.25)
        if total - gone <= 0.05:  # begin to turn while arriving
            yaw += float(np.clip(rot.wrap_angle(goal_yaw - yaw), -0.5 * gait.max_turn, 0.5 * gait.max_turn)) * (
                abs(turn) < 0.5 * gait.max_turn
            )
        centers.append(route.at(gone)[0])
        yaws.append(yaw)
    here = route.at(total)[0]
    turn = float(rot.wrap_angle(goal_yaw - yaw))
    count = int(max(1, np.ceil(abs(turn) / gait.max_turn), np.ceil(np.linalg.norm(goal_xy - here) / 0.16)))
    for share in np.arange(1, count + 1) / count:
        centers.append(here + share * (goal_xy - here))
        yaws.append(yaw + share * turn)
    return centers, yaws


def _beside(center: np.ndarray, yaw: float, sideways: float) -> np.ndarray:
    return center + sideways * left_of(yaw)
