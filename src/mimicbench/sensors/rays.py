"""Lines of sight through the physical scenes, followed by the physics itself; nothing is drawn."""

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.robots.rigs import HEIGHT, PELVIS_RIG, WIDTH, Rig
from mimicbench.sim.physics import Physics
from mimicbench.sim.scene import FLOOR_GROUP, OBJECT_GROUP, ROBOT_GROUP, VISUAL_GROUP

FARTHEST = 50.0
"""[m] Depth images are clipped here (C.2)."""
_RAYS_AT_ONCE = 1 << 18
"""Bounds the memory: about 15 MB."""


def ray_depth(
    physics: Physics,
    ids: np.ndarray | None = None,
    height: int = HEIGHT,
    width: int = WIDTH,
    rig: Rig = PELVIS_RIG,
    robot: bool = True,
) -> np.ndarray:
    """(N, C, height, width) float32 depth images of scenes `ids` (None: all), along the cameras' axes, at most 50 m
    [m].

    The same as `RigCameras` draws of these scenes. `robot` is whether the robot's own body is in them.
    """
    ids = np.arange(physics.num_envs) if ids is None else ids
    rays, origins = rig.rays(height, width).reshape(len(rig.mounts), -1, 3), rig.origins()
    root_pos, turns = physics.qpos()[ids, :3], rot.to_matrix(physics.qpos()[ids, 3:7])
    groups = (FLOOR_GROUP, OBJECT_GROUP, *((ROBOT_GROUP, VISUAL_GROUP) if robot else ()))
    images = np.empty((len(ids), len(rays), height * width), np.float32)
    step = max(1, _RAYS_AT_ONCE // rays.shape[1])
    for first in range(0, len(ids), step):
        some = slice(first, first + step)
        for camera, (origin, ray) in enumerate(zip(origins, rays, strict=True)):
            eye = (root_pos[some] + turns[some] @ origin)[:, None]
            depth = physics.ray(eye, ray @ turns[some].swapaxes(1, 2), groups, ids[some])
            images[some, camera] = np.where(depth < 0, FARTHEST, np.minimum(depth, FARTHEST))
    return images.reshape(len(ids), len(rays), height, width)
