"""Lines of sight through the physical scenes, followed by the physics itself; nothing is drawn."""

from collections.abc import Sequence

import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.objects.shape import SceneObject
from mimicbench.sense.rigs import HEIGHT, PELVIS_RIG, WIDTH, Rig
from mimicbench.sim.physics import Physics
from mimicbench.sim.scene import FLOOR_GROUP, OBJECT_GROUP, ROBOT_GROUP, VISUAL_GROUP

FARTHEST = 50.0
"""[m] Depth images are clipped here (C.2)."""
_RAYS_AT_ONCE = 1 << 18
"""Bounds the memory: about 15 MB."""


def ray_depth(
    physics: Physics, ids: np.ndarray | None = None, height: int = HEIGHT, width: int = WIDTH, rig: Rig = PELVIS_RIG, robot: bool = True
) -> np.ndarray:
    """(N, C, height, width) float32 depth images of scenes `ids` (None: all), along the cameras' axes, at most 50 m [m].

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


def bounding_spheres(physics: Physics, ids: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Centers (N, 3) and radii (N,) [m] of spheres that hold the objects of scenes `ids`, where they are now."""
    objects: Sequence[SceneObject] = [physics.objects[env] for env in ids]
    starts = np.cumsum([0, *(len(obj.box_pos) for obj in objects[:-1])])
    pos, quat, half = (np.concatenate(parts) for parts in zip(*((obj.box_pos, obj.box_quat, obj.box_half) for obj in objects), strict=True))
    reach = (abs(rot.to_matrix(quat)) * half[:, None, :]).sum(-1)  # half the size of each box's own bounding box
    low, high = np.minimum.reduceat(pos - reach, starts), np.maximum.reduceat(pos + reach, starts)
    at, turn = (pose[ids] for pose in physics.object_pose())
    return at + rot.rotate(turn, 0.5 * (low + high)), 0.5 * np.linalg.norm(high - low, axis=-1)


def cast(physics: Physics, ids: np.ndarray, starts: Sequence[np.ndarray], rays: Sequence[np.ndarray]) -> list[np.ndarray]:
    """For each scene, how many lengths of its rays (R, 3) it is from their starts (R, 3) to the object; -1 for a miss."""
    counts = np.array([len(some) for some in rays])
    depths = [np.zeros(0)] * len(ids)
    order = np.argsort(-counts, kind="stable")
    first = 0
    while first < len(order) and counts[order[first]]:
        # scenes with about as many rays go together, for each call needs the same number in all
        most = counts[order[first]]
        last = min(first + max(1, _RAYS_AT_ONCE // most), first + int((counts[order[first:]] > 0.75 * most).sum()))
        chunk = np.sort(order[first:last])  # as the batch wants them
        start, ray = np.zeros((len(chunk), most, 3)), np.zeros((len(chunk), most, 3))
        start[..., 2] = ray[..., 2] = 1e3  # up and away, for those that have fewer
        for row, i in enumerate(chunk):
            start[row, : counts[i]], ray[row, : counts[i]] = starts[i], rays[i]
        depth = physics.ray(start, ray, (OBJECT_GROUP,), ids[chunk])
        for row, i in enumerate(chunk):
            depths[i] = depth[row, : counts[i]]
        first = last
    return depths
