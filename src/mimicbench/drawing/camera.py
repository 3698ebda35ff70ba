"""Where pictures are taken from, and how large and fine they are."""

from dataclasses import dataclass

import numpy as np

from mimicbench.objects.shape import SceneObject

FIELD_OF_VIEW = 0.61
"""Vertical opening of the camera [rad], 35 degrees: long enough that nothing near the edge is stretched."""


@dataclass(frozen=True)
class Camera:
    """A free camera that looks at a point."""

    lookat: tuple[float, float, float]
    """World point in the middle of the picture [m]."""
    distance: float
    """From the camera to that point [m]."""
    azimuth: float
    """Heading in which the camera looks [deg], 0 along +x, counter-clockwise."""
    elevation: float = -13.0
    """Pitch of the view [deg], negative looking down."""


@dataclass(frozen=True)
class Picture:
    """Size and quality of a picture."""

    width: int = 640
    """[px]; even, as video wants it."""
    height: int = 400
    """[px]; even."""
    shadow: int = 1024
    """Side of the shadow map [px]; 0 for none."""
    samples: int = 4
    """Samples per pixel against jagged edges."""
    suns: int = 1
    """Places of the sun that the picture is the mean of: with several, the edges of shadows are soft."""


def frame_all(
    obj: SceneObject,
    root_pos_w: np.ndarray,
    aspect: float = 1.6,
    height: float = 1.95,
    reach: float = 0.45,
    azimuth: float | None = None,
) -> Camera:
    """The nearest camera that sees an object and a whole walk to it, three-quarters from the front.

    Args:
        obj: the object, facing +x.
        root_pos_w: (T, 3) positions of the roots of all that will be shown [m].
        aspect: width of the picture over its height.
        height: of the one who walks [m].
        reach: how far a body extends from its root sideways [m].
        azimuth: heading in which the camera looks [deg]; None for that from the side that the walk does not take,
            so that who walks does not stand before the object.
    """
    if azimuth is None:
        azimuth = 128.0 if np.mean(root_pos_w[:, 1]) >= 0 else -128.0
    path = root_pos_w[:: max(1, len(root_pos_w) // 50), :2]
    around = reach * np.array([(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)])
    body = (path[:, None] + around).reshape(-1, 2)
    points = np.concatenate([np.insert(body, 2, 0.0, 1), np.insert(body, 2, height, 1), obj.corners().reshape(-1, 3)])

    pitch, yaw = np.radians(Camera.elevation), np.radians(azimuth)
    forward = np.array([np.cos(pitch) * np.cos(yaw), np.cos(pitch) * np.sin(yaw), np.sin(pitch)])
    right = np.array([np.sin(yaw), -np.cos(yaw), 0.0])
    up = np.cross(right, forward)
    # In these axes a camera at c sees a point p if |p_x - c_x| <= t_x (p_z - c_z), and likewise in y. With
    # low = max(p_x - t_x p_z) and high = min(p_x + t_x p_z) that is low + t_x c_z <= c_x <= high - t_x c_z,
    # so c_z can be at most (high - low) / 2 t_x, with c_x half-way between low and high.
    depth = points @ forward
    center, farthest = [], []
    for axis, tangent in ((right, aspect * np.tan(0.5 * FIELD_OF_VIEW)), (up, np.tan(0.5 * FIELD_OF_VIEW))):
        tangent *= 0.93  # a margin of 7 %
        side = points @ axis
        low, high = (side - tangent * depth).max(), (side + tangent * depth).min()
        center.append(0.5 * (low + high))
        farthest.append((high - low) / (2 * tangent))
    near = min(farthest)
    middle = float(np.mean([depth.min(), depth.max()]))
    lookat = center[0] * right + center[1] * up + middle * forward
    return Camera((float(lookat[0]), float(lookat[1]), float(lookat[2])), float(middle - near), azimuth)
