"""Where the cameras sit on the robot and what they see of the world's geometry (appendix C.2).

A camera is a pinhole. Its frame looks along +x, with y to the left and z up in its picture; pixel (row, column) of a
picture of `height` x `width` is centered at `row + 0.5` from the top and `column + 0.5` from the left. Depth is what a
depth camera gives: the distance along the camera's axis, not along the line of sight.

The paper's 120 degrees are taken as the horizontal opening, the one that its simulator's cameras are specified by. At
360 x 480 that makes 105 degrees from top to bottom, and neighbors of the four pelvis cameras overlap by 30 degrees.

How far the cameras are from the root's vertical axis, the paper does not say. Here it is just as far as needed for them
not to look out from inside of the robot, and little enough for them not to be inside of the furniture that it leans on.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from mimicbench.core import rotations as rot

HEIGHT, WIDTH = 360, 480
"""[px] the paper's pictures; every function takes any other size."""


@dataclass(frozen=True)
class Mount:
    """One camera on the root link."""

    name: str
    bearing: float
    """Where it faces, seen from above: 0 is forward, counter-clockwise [rad]."""
    pitch: float
    """How far it looks down [rad]."""
    height: float
    """Above the root's origin [m]."""
    out: float
    """From the root's vertical axis, towards where it faces [m]."""


@dataclass(frozen=True)
class Rig:
    """All cameras of a robot."""

    name: str
    mounts: tuple[Mount, ...]
    field_of_view: float = float(np.deg2rad(120.0))
    """Horizontal opening of every camera [rad] (C.2)."""

    def focal(self, width: int) -> float:
        """Focal length of a picture of this width [px]; pixels are square."""
        return 0.5 * width / float(np.tan(0.5 * self.field_of_view))

    def origins(self) -> np.ndarray:
        """(C, 3) where the cameras are in the root frame [m]."""
        return np.array(
            [
                (mount.out * np.cos(mount.bearing), mount.out * np.sin(mount.bearing), mount.height)
                for mount in self.mounts
            ]
        )

    def turns(self) -> np.ndarray:
        """(C, 4) orientations of the cameras' frames in the root frame."""
        yaw = rot.from_yaw(np.array([mount.bearing for mount in self.mounts]))
        return rot.multiply(yaw, rot.from_rotvec(np.array([(0.0, mount.pitch, 0.0) for mount in self.mounts])))

    def views(self) -> np.ndarray:
        """(C, 2) where a thing must be for each camera to be the one that looks at it most: between these bearings
        [rad], as seen from above in the root frame. A camera among many shares its view with its neighbors.
        """
        half = min(self.field_of_view, 2 * np.pi / len(self.mounts)) / 2
        return np.array([(mount.bearing - half, mount.bearing + half) for mount in self.mounts])

    def quarters(self) -> int:
        """4 if the cameras are the same after every quarter turn of the robot, else 1."""

        def places(turn: float) -> set[tuple[float, ...]]:
            return {
                (round((mount.bearing + turn) % (2 * np.pi), 6) % 6.283185, mount.pitch, mount.height, mount.out)
                for mount in self.mounts
            }

        return 4 if places(np.pi / 2) == places(0.0) else 1

    def rays(self, height: int = HEIGHT, width: int = WIDTH) -> np.ndarray:
        """(C, height, width, 3) lines of sight in the root frame, each one meter long along its camera's axis: a
        pixel of depth d shows origin + d * ray.
        """
        return _rays(self, height, width)

    def sights(self, height: int = HEIGHT, width: int = WIDTH) -> np.ndarray:
        """(C, 3, 3) the same lines of sight as linear forms: `sights @ (1, row, column)` is that of a pixel."""
        focal = self.focal(width)
        return rot.to_matrix(self.turns()) @ np.array(
            [[1, 0, 0], [(width - 1) / 2 / focal, 0, -1 / focal], [(height - 1) / 2 / focal, -1 / focal, 0]]
        )

    def project(self, points_r: np.ndarray, height: int = HEIGHT, width: int = WIDTH) -> tuple[np.ndarray, np.ndarray]:
        """Where points (K, 3) of the root frame are in the pictures.

        Returns:
            (C, K, 2) distances [px] from the picture's top and left edge, and (C, K) depth [m]. A point is in the
            picture if its depth is positive and it lies within 0..height and 0..width.
        """
        local = rot.rotate_inverse(self.turns()[:, None], points_r[None] - self.origins()[:, None])
        depth = local[..., 0]
        scale = self.focal(width) / np.where(abs(depth) < 1e-9, 1e-9, depth)
        return np.stack([0.5 * height - scale * local[..., 2], 0.5 * width - scale * local[..., 1]], -1), depth


@lru_cache(maxsize=8)
def _rays(rig: Rig, height: int, width: int) -> np.ndarray:
    focal = rig.focal(width)
    v, u = np.meshgrid(
        (np.arange(height) + 0.5 - height / 2) / focal, (np.arange(width) + 0.5 - width / 2) / focal, indexing="ij"
    )
    rays = rot.rotate(rig.turns()[:, None, None], np.stack([np.ones_like(u), -u, -v], -1)[None])
    rays.setflags(write=False)  # shared by all who ask
    return rays


def _mount(name: str, bearing: float, pitch: float, height: float, out: float) -> Mount:
    return Mount(name, float(np.deg2rad(bearing)), float(np.deg2rad(pitch)), height, out)


PELVIS_RIG = Rig(
    "pelvis",
    (
        _mount("right front", -45, 35, 0.0, 0.1),
        _mount("left front", 45, 35, 0.0, 0.1),
        _mount("left back", 135, 35, 0.0, 0.1),
        _mount("right back", -135, 35, 0.0, 0.1),
    ),
)
"""Four cameras around the pelvis, for the tasks that walk to furniture: SC, SS, LB, LS (C.2)."""
HEAD_RIG = Rig("head", (_mount("front", 0, 55, 0.55, 0.15),))
"""One camera above the pelvis that looks at the hands: T and L (C.2)."""
