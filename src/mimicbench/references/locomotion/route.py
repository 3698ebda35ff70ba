"""Ways on the floor, as polylines: straight, or past the corner of a rectangle."""

from dataclasses import dataclass

import numpy as np

from mimicbench.core import rotations as rot


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

    def after(self, distance: float) -> np.ndarray:
        """(N, 2) the points that are left after some distance along it, the one at that distance first [m]."""
        starts = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.points, axis=0), axis=-1))])
        left = self.points[starts > distance + 1e-6]
        return np.concatenate([self.at(distance)[0][None], left if len(left) else self.points[-1:]])


def around_box(
    start: np.ndarray,
    goal: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    margin: float,
    start_yaw: float | None = None,
    goal_yaw: float | None = None,
) -> Route:
    """The shortest way (2,) to (2,) that stays `margin` [m] away from the rectangle low..high, past one of its front
    (+x) corners.

    Both ends must be outside of the rounded rectangle, and the goal in front of it. With `start_yaw` or `goal_yaw`
    [rad] the way leaves or arrives on a curve that is tangent to that heading, as far as the rectangle allows it.
    """
    points = _shortest(start, goal, low, high, margin)
    if start_yaw is not None:
        points = _bent(points, start_yaw, low, high, margin)
    if goal_yaw is not None:
        points = _bent(points[::-1], goal_yaw + np.pi, low, high, margin)[::-1]
    return Route(points)


def _shortest(start: np.ndarray, goal: np.ndarray, low: np.ndarray, high: np.ndarray, margin: float) -> np.ndarray:
    """Straight to a circle around the corner, along it, and straight to the goal: (N, 2) [m]."""
    side = 1.0 if start[1] >= 0 else -1.0
    corner = np.array([high[0], high[1] if side > 0 else low[1]])
    to_start, to_goal = start - corner, goal - corner
    near, far = np.linalg.norm(to_start), np.linalg.norm(to_goal)
    straight = goal - start
    closest = start + straight * np.clip(-(to_start @ straight) / max(straight @ straight, 1e-12), 0, 1)
    outside = (closest - corner) @ np.array([1.0, side]) >= 0 and np.linalg.norm(closest - corner) >= margin
    if outside or start[0] >= high[0] + margin - 1e-9:
        return np.stack([start, goal])
    # angles seen from the corner, measured from its sideways direction towards the front
    first = np.arctan2(to_start[0], side * to_start[1]) + np.arccos(min(1.0, margin / near))
    last = np.arctan2(to_goal[0], side * to_goal[1]) - np.arccos(min(1.0, margin / far))
    if last <= first:
        return np.stack([start, goal])
    angle = np.linspace(first, last, 2 + int((last - first) / 0.15))
    arc = corner + margin * np.stack([np.sin(angle), side * np.cos(angle)], -1)
    return np.concatenate([start[None], arc, goal[None]])


def _bent(points: np.ndarray, yaw: float, low: np.ndarray, high: np.ndarray, margin: float) -> np.ndarray:
    """The same way, its beginning replaced by a cubic that leaves in direction `yaw` [rad], if one stays clear of
    the rectangle.

    Who would have to leave at more than 1.9 rad from the way turns on the spot instead.
    """
    route = Route(points)
    heading = route.at(0.0)[1]
    error = rot.wrap_angle(yaw - heading)
    if abs(error) > 1.9 or abs(error) < 0.05 or route.length < 0.3:
        return points
    joins = min(1.2, 0.5 * route.length)
    join, onward = route.at(joins)
    leave = heading + np.clip(error, -1.2, 1.2)
    u = np.linspace(0.0, 1.0, 13)[:, None]
    for handle in (0.45 * joins, 0.25 * joins):
        knots = points[0], points[0] + handle * ahead_of(leave), join - handle * ahead_of(onward), join
        curve = (
            (1 - u) ** 3 * knots[0] + 3 * u * (1 - u) ** 2 * knots[1] + 3 * u**2 * (1 - u) * knots[2] + u**3 * knots[3]
        )
        gap = np.linalg.norm(np.maximum(np.maximum(low - curve, curve - high), 0), axis=-1)
        if gap.min() >= min(margin, float(gap[0]), float(gap[-1])) - 1e-9:
            return np.concatenate([curve, route.after(joins)[1:]])
    return points


def left_of(yaw: float) -> np.ndarray:
    """(2,) what is to the left of heading `yaw` [rad]."""
    return np.array([-np.sin(yaw), np.cos(yaw)])


def ahead_of(yaw: float) -> np.ndarray:
    """(2,) what is ahead with heading `yaw` [rad]."""
    return np.array([np.cos(yaw), np.sin(yaw)])
