"""Where a robot's own shapes are in each other."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.retarget.kinematics import Links
from mimicbench.retarget.samples import Balls
from mimicbench.robots.description import Robot, Shape


class Overlaps(NamedTuple):
    """M places in which a ball is in another part of the robot, in order of the frames."""

    frame: np.ndarray
    """(M,)"""
    link: np.ndarray
    """(M,) whose ball it is."""
    other: np.ndarray
    """(M,) whose part it is in."""
    point_w: np.ndarray
    """(M, 3) [m]."""
    normal_w: np.ndarray
    """(M, 3) the way out for the ball."""
    depth: np.ndarray
    """(M,) [m]."""


@dataclass(frozen=True)
class SelfContact:
    """Which parts of a robot may touch which: balls against balls, and balls against boxes."""

    balls: Balls
    pairs: tuple[tuple[np.ndarray, np.ndarray], ...]
    """Balls (A,) and (B,) of two groups that collide."""
    boxes: tuple[tuple[Shape, np.ndarray], ...]
    """A box, and the balls (A,) of the groups that it collides with."""

    @staticmethod
    def of(robot: Robot, balls: Balls) -> "SelfContact":
        """By the robot's groups that collide."""
        pairs, boxes = [], []
        for first, second in robot.collides:
            one, other = (np.flatnonzero((balls.group == group) & (balls.radius > 0)) for group in (first, second))
            pairs.append((one, other))
            for mine, group in ((one, second), (other, first)):
                boxes += [(shape, mine) for shape in robot.collision if shape.type == "box" and shape.group == group]
        return SelfContact(balls, tuple(pairs), tuple(boxes))

    def overlaps(self, links: Links, centers_w: np.ndarray) -> Overlaps:
        """Every ball (T, S, 3) that is in another part, with the nearest one of each kind."""
        found = [self._in_balls(centers_w, one, other) for one, other in self.pairs] + [
            self._in_box(links, centers_w, *box) for box in self.boxes
        ]
        columns = [np.concatenate(column) for column in zip(*found, strict=True)]
        order = np.argsort(columns[0], kind="stable")
        return Overlaps(*(column[order] for column in columns))

    def _in_balls(self, centers: np.ndarray, one: np.ndarray, other: np.ndarray) -> Overlaps:
        radius = self.balls.radius
        a, b, touch = centers[:, one], centers[:, other], radius[one, None] + radius[other]
        # |a - b|^2 - (r_a + r_b)^2 of all pairs by one product; only the few frames in which something overlaps are
        # looked at more closely
        size, far, ones = radius[one], radius[other], np.ones((len(centers), 1))
        left = np.stack([*np.moveaxis(a, -1, 0), (a**2).sum(-1) - size**2, ones * np.ones(len(one)), ones * size], -1)
        right = np.stack(
            [*np.moveaxis(-2 * b, -1, 0), ones * np.ones(len(other)), (b**2).sum(-1) - far**2, ones * (-2 * far)], 1
        )
        frames = np.flatnonzero((left @ right).reshape(len(centers), -1).min(-1) < 0)
        away = a[frames, :, None] - b[frames, None]
        apart = np.linalg.norm(away, axis=-1) - touch
        nearest = apart.argmin(-1)
        distance = np.take_along_axis(apart, nearest[..., None], -1)[..., 0]
        row, ball = np.nonzero(distance < 0)
        partner = nearest[row, ball]
        way = away[row, ball, partner]
        way = way / np.maximum(np.linalg.norm(way, axis=-1, keepdims=True), 1e-9)
        mine = one[ball]
        return Overlaps(
            frames[row],
            self.balls.link[mine],
            self.balls.link[other[partner]],
            centers[frames[row], mine],
            way,
            -distance[row, ball],
        )

    def _in_box(self, links: Links, centers: np.ndarray, shape: Shape, balls: np.ndarray) -> Overlaps:
        local = rot.rotate_inverse(
            links.quat[:, shape.link, None], centers[:, balls] - links.pos[:, shape.link, None]
        ) - np.array(shape.start)
        beyond = np.abs(local) - np.array(shape.size)
        outside = np.maximum(beyond, 0.0)
        away = np.linalg.norm(outside, axis=-1)
        distance = away + np.minimum(beyond.max(-1), 0.0) - self.balls.radius[balls]
        frame, ball = np.nonzero(distance < 0)
        face = np.eye(3)[beyond[frame, ball].argmax(-1)]
        way = np.where(
            away[frame, ball, None] > 1e-9, outside[frame, ball] / np.maximum(away[frame, ball, None], 1e-9), face
        )
        way = rot.rotate(links.quat[frame, shape.link], way * np.where(local[frame, ball] < 0, -1.0, 1.0))
        mine = balls[ball]
        return Overlaps(
            frame,
            self.balls.link[mine],
            np.full(len(frame), shape.link),
            centers[frame, mine],
            way,
            -distance[frame, ball],
        )
