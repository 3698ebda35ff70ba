"""A robot's kinematic tree for least squares: link poses and geometric Jacobians of all frames of a clip at once.

A configuration is a free root and N joints; a small change of it is the V = 6 + N numbers (dp, dw, dq): root
translation [m] and rotation vector [rad] in world axes, joint angles [rad].
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.robots.description import Robot


class Pose(NamedTuple):
    """A configuration in each of T frames."""

    root_pos: np.ndarray
    """(T, 3) [m]."""
    root_quat: np.ndarray
    """(T, 4)."""
    joints: np.ndarray
    """(T, N) [rad]."""


class Links(NamedTuple):
    """Where all links are in each of T frames."""

    pos: np.ndarray
    """(T, L, 3) [m]."""
    quat: np.ndarray
    """(T, L, 4)."""


@dataclass(frozen=True)
class Tree:
    """What stays the same from frame to frame."""

    levels: tuple[tuple[np.ndarray, np.ndarray], ...]
    """Links of each depth below the root, and their parents: links of one depth are placed together."""
    link_pos: np.ndarray
    """(L, 3) in the parent's frame [m]."""
    link_quat: np.ndarray
    """(L, 4) in the parent's frame."""
    joint_link: np.ndarray
    """(N,) link that each joint drives."""
    joint_axis: np.ndarray
    """(N, 3) in the link's frame."""
    moves: np.ndarray
    """(L, N) whether a joint moves a link."""

    def place(self, pose: Pose) -> Links:
        """Forward kinematics."""
        half = 0.5 * pose.joints[..., None]
        local = np.broadcast_to(self.link_quat, (len(half), *self.link_quat.shape)).copy()
        turn = np.concatenate([np.cos(half), np.sin(half) * self.joint_axis], -1)
        local[:, self.joint_link] = rot.multiply(self.link_quat[self.joint_link], turn)
        pos, quat = np.empty((*local.shape[:2], 3)), np.empty(local.shape)
        pos[:, 0], quat[:, 0] = pose.root_pos, pose.root_quat
        for links, parents in self.levels:
            up = quat[:, parents]
            pos[:, links] = pos[:, parents] + rot.rotate(up, self.link_pos[links])
            quat[:, links] = rot.multiply(up, local[:, links])
        return Links(pos, quat)


def tree_of(robot: Robot) -> Tree:
    """The tree of a robot."""
    parents = np.array(robot.link_parents)
    depth = np.zeros(len(parents), int)
    moves = np.zeros((len(parents), len(robot.joint_names)), bool)
    driver = {int(link): j for j, link in enumerate(robot.joint_link)}
    for i, parent in enumerate(parents):
        if parent >= 0:
            depth[i], moves[i] = depth[parent] + 1, moves[parent]
        if i in driver:
            moves[i, driver[i]] = True
    levels = tuple((np.flatnonzero(depth == d), parents[depth == d]) for d in range(1, depth.max() + 1))
    return Tree(levels, robot.link_pos, robot.link_quat, robot.joint_link, robot.joint_axis, moves)


class Jacobian:
    """World-frame Jacobian of P points on links and of Q link orientations, as rows (3 P + 3 Q) by V columns."""

    def __init__(self, tree: Tree, point_links: np.ndarray, turn_links: np.ndarray, frames: int) -> None:
        """Reserve room for up to `frames` frames; the pattern of zeros is the tree's and never changes."""
        self.tree, self.points = tree, len(point_links)
        rows, columns = 3 * (len(point_links) + len(turn_links)), 6 + len(tree.joint_link)
        self.values = np.zeros((frames, rows, columns))
        point, turn = 3 * np.arange(self.points), 3 * (self.points + np.arange(len(turn_links)))
        for axis in range(3):
            self.values[:, point + axis, axis] = 1.0  # the root carries every point along
            self.values[:, turn + axis, 3 + axis] = 1.0  # and turns every link
        self.point, self.point_joint = np.nonzero(tree.moves[point_links])
        turned, self.turn_joint = np.nonzero(tree.moves[turn_links])
        self.point_rows, self.point_columns = _rows(self.point), np.repeat(6 + self.point_joint, 3)
        self.turn_rows, self.turn_columns = _rows(self.points + turned), np.repeat(6 + self.turn_joint, 3)

    def fill(self, links: Links, points_w: np.ndarray) -> np.ndarray:
        """Rows (T, 3 P + 3 Q, V) at link poses of T frames and their points (T, P, 3).

        The array is reused by the next call.
        """
        tree, frames = self.tree, len(points_w)
        out = self.values[:frames]
        axis = rot.rotate(links.quat[:, tree.joint_link], tree.joint_axis)
        arm = points_w - links.pos[:, :1]
        row = 3 * np.arange(self.points)
        # dp = dw x arm
        out[:, row, 4], out[:, row, 5] = arm[..., 2], -arm[..., 1]
        out[:, row + 1, 3], out[:, row + 1, 5] = -arm[..., 2], arm[..., 0]
        out[:, row + 2, 3], out[:, row + 2, 4] = arm[..., 1], -arm[..., 0]
        hinge = links.pos[:, tree.joint_link]
        swept = np.cross(axis[:, self.point_joint], points_w[:, self.point] - hinge[:, self.point_joint])
        out[:, self.point_rows, self.point_columns] = swept.reshape(frames, -1)
        out[:, self.turn_rows, self.turn_columns] = axis[:, self.turn_joint].reshape(frames, -1)
        return out


def _rows(index: np.ndarray) -> np.ndarray:
    """The three rows of each indexed point or link, in order."""
    return (3 * index[:, None] + np.arange(3)).ravel()
