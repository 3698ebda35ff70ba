"""Walking and turning in closed form: a route, footsteps on it, feet that never skate, and a pelvis that balances over them.

The route is the shortest way around the object; the footsteps follow it with a bounded step and a bounded turn. The feet stand
exactly still between swings. The pelvis moves as a linear inverted pendulum whose support point goes from foot to foot, so the
walk is balanced, and starts and stops smoothly, by construction.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_banded

from mimicbench.core import rotations as rot
from mimicbench.references.limbs import minimum_jerk, smooth

GRAVITY = 9.81


@dataclass(frozen=True)
class Gait:
    """How a person walks. Lengths are for body size 1 and grow with it."""

    speed: float = 0.6
    """Forward speed on a straight way [m/s], not scaled."""
    step_time: float = 0.64
    """From one touch-down to the next [s]."""
    double_support: float = 0.26
    """Share of the step time with both feet on the floor."""
    width: float = 0.235
    """Between the ankles [m]."""
    max_turn: float = 0.59
    """Change of heading per step [rad]."""
    clearance: float = 0.062
    """Height of the sole at mid swing [m]."""
    forefoot: float = 0.035
    """The support point lies this far in front of the ankle [m]."""
    outward: float = 0.06
    """And this far outside of it while it bears the weight [m]: a careful walk that carries the hips well over the standing leg, which
    a body with wide hips needs."""
    stand: float = 0.8
    """Time before the first swing, in which the weight shifts [s]."""


@dataclass(frozen=True)
class Route:
    """A polyline on the floor."""

    points: np.ndarray
    """(N, 2) [m]."""

    @property
    def length(self) -> float:
        """Of the whole way [m]."""
        return float(np.linalg.norm(np.diff(self.points, axis=0), axis=-1).sum())

    def at(self, distance: float) -> tuple[np.ndarray, float]:
        """Position (2,) [m] and heading [rad] after some distance along it."""
        pieces = np.diff(self.points, axis=0)
        lengths = np.linalg.norm(pieces, axis=-1)
        starts = np.concatenate([[0.0], np.cumsum(lengths)])
        i = int(np.clip(np.searchsorted(starts, distance, "right") - 1, 0, len(pieces) - 1))
        share = np.clip((distance - starts[i]) / max(lengths[i], 1e-12), 0.0, 1.0)
        return self.points[i] + share * pieces[i], float(np.arctan2(pieces[i, 1], pieces[i, 0]))


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

    @property
    def end(self) -> float:
        """Time of the last touch-down [s], or 0 without steps."""
        return float(self.touch_down[-1]) if len(self.side) else 0.0


@dataclass(frozen=True)
class Feet:
    """Both ankles over time; axis 1 is left, right."""

    pos_w: np.ndarray
    """(T, 2, 3) ankles [m]."""
    yaw: np.ndarray
    """(T, 2) [rad]"""
    pitch: np.ndarray
    """(T, 2) toe down positive [rad]."""
    contact: np.ndarray
    """(T, 2) bool, flat on the floor and still."""


def around_box(start: np.ndarray, goal: np.ndarray, low: np.ndarray, high: np.ndarray, margin: float) -> Route:
    """The shortest way (2,) to (2,) that stays `margin` [m] away from the rectangle low..high, past one of its front (+x) corners.

    Both ends must be outside of the rounded rectangle, and the goal in front of it.
    """
    side = 1.0 if start[1] >= 0 else -1.0
    corner = np.array([high[0], high[1] if side > 0 else low[1]])
    to_start, to_goal = start - corner, goal - corner
    near, far = np.linalg.norm(to_start), np.linalg.norm(to_goal)
    straight = goal - start
    closest = start + straight * np.clip(-(to_start @ straight) / max(straight @ straight, 1e-12), 0, 1)
    outside = (closest - corner) @ np.array([1.0, side]) >= 0 and np.linalg.norm(closest - corner) >= margin
    if outside or start[0] >= high[0] + margin - 1e-9:
        return Route(np.stack([start, goal]))
    # angles seen from the corner, measured from its sideways direction towards the front
    first = np.arctan2(to_start[0], side * to_start[1]) + np.arccos(min(1.0, margin / near))
    last = np.arctan2(to_goal[0], side * to_goal[1]) - np.arccos(min(1.0, margin / far))
    if last <= first:
        return Route(np.stack([start, goal]))
    angle = np.linspace(first, last, 2 + int((last - first) / 0.15))
    arc = corner + margin * np.stack([np.sin(angle), side * np.cos(angle)], -1)
    return Route(np.concatenate([start[None], arc, goal[None]]))


def plan_footsteps(start_yaw: float, route: Route, goal_xy: np.ndarray, goal_yaw: float, gait: Gait, scale: float) -> Footsteps:
    """Steps along the route, then a stepping turn that backs from its end to the goal, then a step that closes the feet.

    Args:
        start_yaw: Heading at the start [rad]; the start's place is the route's.
        route: The way.
        goal_xy: (2,) final place of the point between the ankles [m].
        goal_yaw: Final heading [rad].
        gait: How to walk.
        scale: Body size.
    """
    centers, yaws = _body_places(start_yaw, route, goal_xy, goal_yaw, gait)
    turn = next((d for d in np.diff([start_yaw, *yaws]) if abs(d) > 0.05), 1.0)
    half = 0.5 * gait.width * scale
    foot_xy = np.stack([_beside(route.points[0], start_yaw, half), _beside(route.points[0], start_yaw, -half)])
    foot_yaw = [start_yaw, start_yaw]
    first_xy, side, landed_xy = foot_xy.copy(), 0 if turn > 0 else 1, []
    sides = []
    for center, yaw in zip([*centers, goal_xy], [*yaws, yaws[-1] if yaws else start_yaw], strict=True):
        sign = 1.0 - 2.0 * side
        stance_xy, stance_yaw = foot_xy[1 - side], foot_yaw[1 - side]
        place = _beside(center, yaw, sign * half)
        # a turn towards the stance foot must not cross the legs: keep to one's own side of it
        sideways = sign * ((place - stance_xy) @ _left(stance_yaw))
        place = place + sign * max(0.0, 0.185 * scale - sideways) * _left(stance_yaw)
        foot_xy[side], foot_yaw[side] = place, yaw
        landed_xy.append(place)
        sides.append(side)
        side = 1 - side
    touch_down = gait.stand + gait.step_time * (np.arange(len(sides)) + 1.0 - gait.double_support)
    lift_off = touch_down - gait.step_time * (1.0 - gait.double_support)
    return Footsteps(first_xy, start_yaw, np.array(sides), np.array(landed_xy), np.array([*yaws, yaws[-1] if yaws else start_yaw]), lift_off, touch_down)


def last_turn(steps: Footsteps) -> float:
    """1 if the last turn is to the left, -1 if it is to the right: a choice that flips where the way leads straight ahead."""
    turns = np.diff(np.concatenate([[steps.first_yaw], steps.yaw]))
    turns = turns[np.abs(turns) > 1e-6]
    return 1.0 if not len(turns) or turns[-1] > 0 else -1.0


def swing_feet(steps: Footsteps, time: np.ndarray, gait: Gait, scale: float, sole: float, toe: float, heel: float) -> Feet:
    """Both feet at times (T,): exactly still in stance; in swing minimum jerk over the floor, on an arc, heel off first and down first.

    `sole`, `toe` and `heel` are the ankle's height and the sole's ends in front of and behind it [m], already of this body's size.
    """
    pos = np.empty((len(time), 2, 3))
    pos[..., :2], pos[..., 2] = steps.first_xy, sole
    yaw = np.full((len(time), 2), steps.first_yaw)
    pitch = np.zeros((len(time), 2))
    contact = np.ones((len(time), 2), bool)
    foot_xy, foot_yaw = steps.first_xy.copy(), [steps.first_yaw, steps.first_yaw]
    for side, xy, heading, start, end in zip(steps.side, steps.xy, steps.yaw, steps.lift_off, steps.touch_down, strict=True):
        u = (time - start) / (end - start)
        swinging, after = (u > 0) & (u < 1), u >= 1
        share = minimum_jerk(u[swinging])
        sign = 1.0 - 2.0 * side
        sideways = _left(foot_yaw[1 - side])
        path = foot_xy[side] + share[:, None] * (xy - foot_xy[side])
        # swing around the stance foot, not through it
        middle = sign * (0.5 * (foot_xy[side] + xy) - foot_xy[1 - side]) @ sideways
        path = path + sign * max(0.0, 0.20 * scale - middle) * _bump(u[swinging])[:, None] * sideways
        stride = min(1.0, float(np.linalg.norm(xy - foot_xy[side])) / (0.6 * scale))
        tilt = stride * (0.20 * _bump(u[swinging] / 0.6) - 0.13 * _bump((u[swinging] - 0.5) / 0.5))
        pos[swinging, side, :2], pos[after, side, :2] = path, xy
        # the tilted foot's lowest end keeps the clearance
        lift = np.where(tilt > 0, toe, -heel) * np.abs(np.sin(tilt))
        pos[swinging, side, 2] = sole + gait.clearance * scale * _bump(u[swinging]) + lift
        yaw[swinging, side] = foot_yaw[side] + share * (heading - foot_yaw[side])
        yaw[after, side] = heading
        pitch[swinging, side] = tilt
        contact[swinging, side] = False
        foot_xy[side], foot_yaw[side] = xy, heading
    return Feet(pos, yaw, pitch, contact)


def balance(steps: Footsteps, time: np.ndarray, gait: Gait, scale: float, height: float) -> np.ndarray:
    """Floor position (T, 2) [m] of a pendulum of some height [m] that is in balance over the feet.

    Solves c - (height / g) c'' = support(t), at rest over both feet at either end (Kajita et al. 2001; the two-point form, so
    nothing can run away). The support point is the stance foot during a swing and moves over during double support.
    """
    support = support_point(steps, time, gait, scale)
    rate = height / GRAVITY / float(time[1] - time[0]) ** 2
    bands = np.array([[-rate], [1 + 2 * rate], [-rate]]) * np.ones(len(time))
    bands[1, [0, -1]] = 1.0  # the ends are given, not solved for
    bands[0, 1] = bands[2, -2] = 0.0
    return solve_banded((1, 1), bands, support)


def support_point(steps: Footsteps, time: np.ndarray, gait: Gait, scale: float) -> np.ndarray:
    """Center of pressure (T, 2) [m] that the plan intends."""

    def under(xy: np.ndarray, yaw: float, side: int) -> np.ndarray:
        return xy + scale * (gait.forefoot * np.array([np.cos(yaw), np.sin(yaw)]) + (1 - 2 * side) * gait.outward * _left(yaw))

    feet = [under(xy, steps.first_yaw, side) for side, xy in enumerate(steps.first_xy)]
    support = np.broadcast_to(0.5 * (feet[0] + feet[1]), (len(time), 2)).copy()
    shift = gait.double_support * gait.step_time
    begin = steps.lift_off - shift
    for i, (side, xy, yaw) in enumerate(zip(steps.side, steps.xy, steps.yaw, strict=True)):
        share = minimum_jerk((time - begin[i]) / shift)[:, None]
        support = support + share * (feet[1 - side] - support)
        feet[side] = under(xy, yaw, side)
    if len(steps.side):
        share = minimum_jerk((time - steps.end) / (2 * shift))[:, None]
        support = support + share * (0.5 * (feet[0] + feet[1]) - support)
    return support


def body_yaw(feet: Feet, fps: float) -> np.ndarray:
    """Heading of the pelvis (T,) [rad]: between the feet, without their haste."""
    return smooth(feet.yaw.mean(-1), round(0.2 * fps))


def stride_difference(feet: Feet, yaw: np.ndarray, fps: float) -> np.ndarray:
    """How far the left foot is in front of the right one (T,) [m], along the heading, smoothed."""
    between = feet.pos_w[:, 0, :2] - feet.pos_w[:, 1, :2]
    return smooth(between[:, 0] * np.cos(yaw) + between[:, 1] * np.sin(yaw), round(0.13 * fps))


def _body_places(start_yaw: float, route: Route, goal_xy: np.ndarray, goal_yaw: float, gait: Gait) -> tuple[list[np.ndarray], list[float]]:
    """Place and heading of the body at every touch-down."""
    centers: list[np.ndarray] = []
    yaws: list[float] = []
    yaw, gone, total = start_yaw, 0.0, route.length
    longest = gait.speed * gait.step_time
    pace = 0.6
    while total - gone > 0.05 and len(yaws) < 200:
        error = rot.wrap_angle(route.at(min(gone + 0.15, total))[1] - yaw)
        turn = float(np.clip(error, -gait.max_turn, gait.max_turn))
        yaw += turn
        still = abs(error - turn)
        if still < 1.0:
            step = pace * longest * np.cos(still) ** 2 * (1.0 - 0.6 * abs(turn) / gait.max_turn)
            gone += (total - gone) / max(1.0, np.ceil((total - gone) / step - 0.15))
            pace = min(1.0, pace + 0.25)
        if total - gone <= 0.05:  # begin to turn while arriving
            yaw += float(np.clip(rot.wrap_angle(goal_yaw - yaw), -0.5 * gait.max_turn, 0.5 * gait.max_turn)) * (abs(turn) < 0.5 * gait.max_turn)
        centers.append(route.at(gone)[0])
        yaws.append(yaw)
    here = route.at(total)[0]
    turn = float(rot.wrap_angle(goal_yaw - yaw))
    count = int(max(1, np.ceil(abs(turn) / gait.max_turn), np.ceil(np.linalg.norm(goal_xy - here) / 0.16)))
    for share in np.arange(1, count + 1) / count:
        centers.append(here + share * (goal_xy - here))
        yaws.append(yaw + share * turn)
    return centers, yaws


def _left(yaw: float) -> np.ndarray:
    return np.array([-np.sin(yaw), np.cos(yaw)])


def _beside(center: np.ndarray, yaw: float, sideways: float) -> np.ndarray:
    return center + sideways * _left(yaw)


def _bump(u: np.ndarray) -> np.ndarray:
    """From 0 to 1 at u = 0.5 and back, at rest and without a kink at both ends."""
    u = np.clip(u, 0.0, 1.0)
    return (4 * u * (1 - u)) ** 3
