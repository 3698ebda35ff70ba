"""Collects the boxes of one piece of furniture. Frame of every part: x to the front, y left, z up, metres."""

from dataclasses import dataclass, field

import numpy as np

from mimicbench.core import rotations as rot

Color = tuple[float, float, float]


@dataclass
class Parts:
    """A growing list of boxes."""

    pos: list[np.ndarray] = field(default_factory=list)
    quat: list[np.ndarray] = field(default_factory=list)
    half: list[np.ndarray] = field(default_factory=list)
    rgb: list[np.ndarray] = field(default_factory=list)

    def add(self, center: np.ndarray, half: np.ndarray, rgb: Color, quat: np.ndarray = rot.IDENTITY) -> None:
        """A box by its centre (3,), half sizes (3,) and orientation (4,)."""
        self.pos.append(np.asarray(center, float))
        self.half.append(np.asarray(half, float))
        self.quat.append(np.asarray(quat, float))
        self.rgb.append(np.asarray(rgb, float))

    def box(self, x: tuple[float, float], y: tuple[float, float], z: tuple[float, float], rgb: Color) -> None:
        """An upright box by its limits along the three axes."""
        low, high = np.array([x[0], y[0], z[0]]), np.array([x[1], y[1], z[1]])
        self.add((low + high) / 2, (high - low) / 2, rgb)

    def leg(self, top: np.ndarray, foot_xy: np.ndarray, thickness: float, rgb: Color) -> None:
        """A square leg from the floor at foot_xy (2,) to `top` (3,).

        A slanting one still ends on the floor with its lowest edge.
        """
        axis = np.array([top[0] - foot_xy[0], top[1] - foot_xy[1], top[2]])
        length = float(np.linalg.norm(axis))
        axis /= length
        # the shortest turn that takes z to the leg's axis
        quat = rot.normalize(np.array([1 + axis[2], -axis[1], axis[0], 0.0]))
        edges = rot.rotate(quat, np.eye(3)[:2])
        drop = thickness / 2 * np.abs(edges[:, 2]).sum() / axis[2]
        bottom = np.array([foot_xy[0], foot_xy[1], 0.0]) + axis * drop
        self.add((bottom + top) / 2, np.array([thickness / 2, thickness / 2, (length - drop) / 2]), rgb, quat)

    def centered(self) -> np.ndarray:
        """Box centres (B, 3), moved so that the bounding box is centred in x and y. The heights stay."""
        signs = np.stack(np.meshgrid([-1, 1], [-1, 1], [-1, 1], indexing="ij"), -1).reshape(8, 3)
        corners = np.array(self.pos)[:, None] + rot.rotate(
            np.array(self.quat)[:, None], signs * np.array(self.half)[:, None]
        )
        low, high = corners.reshape(-1, 3).min(0), corners.reshape(-1, 3).max(0)
        return np.array(self.pos) - np.array([*(low + high)[:2] / 2, 0.0])
