"""The robot's collision shapes as balls, and what their distance from floor and object says of a pose."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.motion import HumanMotion
from mimicbench.objects.shape import SceneObject
from mimicbench.objects.surface import signed_distance
from mimicbench.retarget.kinematics import Links, Tree
from mimicbench.robots.description import Robot, Shape

SPACING = 0.05
"""[m] Most distance between the centers of neighboring balls."""
FAR = 0.15
"""[m] What is farther from the object than this is not looked at more closely."""


@dataclass(frozen=True)
class Balls:
    """S balls that fill the collision shapes of a robot; corners and edges of boxes are balls without size."""

    link: np.ndarray
    """(S,)"""
    center: np.ndarray
    """(S, 3) in the link's frame [m]."""
    radius: np.ndarray
    """(S,) [m]"""
    group: np.ndarray
    """(S,) self-collision group of each one's shape."""

    def place(self, links: Links) -> np.ndarray:
        """(T, S, 3) centers in the world [m]."""
        turns = rot.to_matrix(links.quat)
        out = links.pos[:, self.link]
        edges = np.flatnonzero(np.diff(self.link, prepend=-1, append=-1))
        for start, end in pairwise(edges.tolist()):  # one product for neighbors on one link
            out[:, start:end] += self.center[start:end] @ np.swapaxes(turns[:, self.link[start]], 1, 2)
        return out


def balls_of(robot: Robot) -> Balls:
    """The balls of a robot's collision shapes."""
    centers = [_centers(shape) for shape in robot.collision]
    radius = [
        np.full(len(c), 0.0 if shape.type == "box" else shape.size[0])
        for shape, c in zip(robot.collision, centers, strict=True)
    ]
    link = [np.full(len(c), shape.link) for shape, c in zip(robot.collision, centers, strict=True)]
    group = np.repeat([shape.group for shape in robot.collision], [len(c) for c in centers])
    return Balls(np.concatenate(link), np.concatenate(centers), np.concatenate(radius), group)


def _centers(shape: Shape) -> np.ndarray:
    start = np.array(shape.start)
    if shape.type == "box":
        grid = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3, indexing="ij"), -1).reshape(-1, 3)
        return start + grid[(grid != 0).any(-1)] * np.array(shape.size)
    if shape.end is None:
        return start[None]
    span = np.array(shape.end) - start
    return start + np.linspace(0, 1, 1 + int(np.ceil(np.linalg.norm(span) / SPACING)))[:, None] * span


@dataclass(frozen=True)
class Scene:
    """Floor and object around a clip of T frames."""

    obj: SceneObject
    pos_w: np.ndarray
    """(T, 3) of the object [m], or empty if it stays at the origin."""
    quat_w: np.ndarray
    """(T, 4), or empty."""

    @staticmethod
    def of(motion: HumanMotion, obj: SceneObject) -> "Scene":
        """The scene of a clip."""
        return Scene(obj, motion.object_pos_w, motion.object_quat_w)

    def object_distance(self, frame: np.ndarray, points_w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Signed distances (M,) [m] of points (M, 3) in frames (M,) from the object, and world normals (M, 3).

        Infinite beyond FAR of its bounds.
        """
        points = points_w
        if len(self.pos_w):
            points = rot.rotate_inverse(self.quat_w[frame], points_w - self.pos_w[frame])
        low, high = self.obj.bounds()
        inside = np.ones(len(points), bool)
        for axis in range(3):  # much faster than `all` over an axis of three
            inside &= (points[:, axis] > low[axis] - FAR) & (points[:, axis] < high[axis] + FAR)
        near = np.flatnonzero(inside)
        distance, normal = np.full(len(points), np.inf), np.zeros((len(points), 3))
        if len(near):
            distance[near], normal[near] = signed_distance(self.obj, points[near])
            if len(self.pos_w):
                normal[near] = rot.rotate(self.quat_w[frame[near]], normal[near])
        return distance, normal

    def clearance(self, balls: Balls, centers_w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How far the balls' surfaces are from what is nearest, floor or object (T, S) [m], negative inside, and its
        normal there (T, S, 3).
        """
        frames, count = centers_w.shape[:2]
        frame = np.repeat(np.arange(frames), count)
        away, normal = self.object_distance(frame, centers_w.reshape(-1, 3))
        away, normal = away.reshape(frames, count), normal.reshape(frames, count, 3)
        floor = centers_w[..., 2] < away
        distance = np.where(floor, centers_w[..., 2], away) - balls.radius
        return distance, np.where(floor[..., None], np.array([0.0, 0.0, 1.0]), normal)


def point_rows(
    tree: Tree, links: Links, frame: np.ndarray, link: np.ndarray, points_w: np.ndarray, direction_w: np.ndarray
) -> np.ndarray:
    """(M, V) how fast points (M, 3) on links (M,) in frames (M,) move along directions (M, 3), per change of the
    configuration.
    """
    # of a joint with axis a at h: d . (a x (p - h)) = a . (p x d) - d . (a x h), and only the last term knows the
    # joint's frame alone
    axis = rot.rotate(links.quat[:, tree.joint_link], tree.joint_axis)  # (T, N, 3)
    moment = np.cross(axis, links.pos[:, tree.joint_link])
    turning = np.cross(points_w, direction_w)
    joints = (axis[frame] @ turning[:, :, None] - moment[frame] @ direction_w[:, :, None])[..., 0] * tree.moves[link]
    return np.concatenate([direction_w, turning - np.cross(links.pos[frame, 0], direction_w), joints], 1)


@dataclass(frozen=True)
class Masses:
    """Where a robot's weight is."""

    mass: np.ndarray
    """(L,) [kg]"""
    com: np.ndarray
    """(L, 3) in the link frames [m]."""

    @staticmethod
    def of(robot: Robot) -> "Masses":
        """The masses of a robot's links."""
        return Masses(np.array([link.mass for link in robot.links]), np.array([link.com for link in robot.links]))

    def center(self, links: Links) -> np.ndarray:
        """(T, 3) center of mass [m]."""
        return np.einsum("l,tli->ti", self.mass, links.pos + rot.rotate(links.quat, self.com)) / self.mass.sum()

    def rows(self, tree: Tree, links: Links, direction_w: np.ndarray) -> np.ndarray:
        """(T, V) how fast the center of mass moves along directions (T, 3), per change of the configuration."""
        total = self.mass.sum()
        at = links.pos + rot.rotate(links.quat, self.com)
        share = tree.moves * self.mass[:, None]  # (L, N)
        carried = share.sum(0)
        center = np.einsum("ln,tli->tni", share, at) / carried[:, None]
        axis = rot.rotate(links.quat[:, tree.joint_link], tree.joint_axis)
        lever = center - links.pos[:, tree.joint_link]
        joints = np.einsum("tni,tni->tn", axis, np.cross(lever, direction_w[:, None])) * carried / total
        arm = self.center(links) - links.pos[:, 0]
        return np.concatenate([direction_w, np.cross(arm, direction_w), joints], 1)
