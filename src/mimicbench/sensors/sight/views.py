"""Color and depth as many robots' cameras see them, without drawing (appendix C.2): small pictures for networks.

What all cameras of a robot see stands side by side in one square of 128 x 128 pixels: the four of the pelvis rig in
quarters of 64 x 64, one camera alone in all of it. Depth is what `faces.py` fills in, and so is which face a pixel
shows; faces have their boxes' colors, lighter the more they are turned to one lamp, without shadows. The robot's own
body is left out, as in the elevation map.
"""

import math
from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from mimicbench.core import rotations as rot
from mimicbench.objects.shape import SceneObject
from mimicbench.robots.rigs import Rig
from mimicbench.sensors.context import StepContext
from mimicbench.sensors.elevation_cpu import RANGE, Poses, faces_seen, in_threads
from mimicbench.sensors.sight.surfaces import Surfaces, faces_of
from mimicbench.sensors.targets import RED

SIDE = 128
"""[px] Of the square that all pictures of a robot stand in."""
CHANNELS = 4
"""Red, green and blue, and depth."""
LAMP = np.array([0.29, -0.34, 0.895])
"""Where the light comes from, of unit length."""
AMBIENT = 0.55
"""Share of its color that a face has which is turned away from it."""
FLOOR = np.array([0.45, 0.47, 0.5], np.float32)
SKY = np.array([0.8, 0.87, 0.95], np.float32)


def views(
    objects: Sequence[SceneObject],
    poses: Poses,
    rig: Rig,
    targets_w: np.ndarray | None = None,
    workers: int = 0,
) -> np.ndarray:
    """(N, 4, 128, 128) float32: red, green and blue, 0 to 1, and depth along the cameras' axes as a share of 6 m, 1 for
    all that is farther.

    Args:
        objects: (N,) beside the robots.
        poses: Of robots and objects.
        rig: The cameras.
        targets_w: (N, K, 3) places that are marked by one red pixel each, hidden or not [m]; NaN where there is none.
        workers: Threads; 0 for all processors. Changes no byte.
    """
    found = np.empty((len(objects), CHANNELS, SIDE, SIDE), np.float32)

    def make(some: slice) -> None:
        seen = _seen(objects[some], poses.part(some), rig)
        if targets_w is not None:
            _mark(seen, poses.part(some), rig, targets_w[some])
        found[some] = np.nan_to_num(_side_by_side(seen))  # of a scene that broke nothing is seen

    in_threads(make, len(objects), workers)
    return found


def side_of(rig: Rig) -> int:
    """[px] Of each of a rig's pictures in the square."""
    return SIDE // math.ceil(math.sqrt(len(rig.mounts)))


def views_now(context: StepContext) -> Tensor:
    """(N, 4, 128, 128) what all robots see at a control step."""
    physics, goals = context.physics, context.wrist_goal_w.cpu().numpy()
    pose, (pos, quat) = physics.qpos()[:, :7], physics.object_pose()
    seen = views(physics.objects, Poses(pose[:, :3], pose[:, 3:], pos, quat), context.task.rig, goals, physics.workers)
    return torch.from_numpy(seen).to(context.device)


class CameraViews:
    """The views of robots beside objects of a list, from tensors to tensors."""

    def __init__(self, objects: Sequence[SceneObject], rig: Rig, workers: int = 0) -> None:
        self._objects, self._rig, self._workers = list(objects), rig, workers

    def sample(
        self,
        index: Tensor,
        root_pos_w: Tensor,
        root_quat_w: Tensor,
        object_pose_w: Tensor | None = None,
        targets_w: np.ndarray | None = None,
    ) -> Tensor:
        """(M, 4, 128, 128) of robots (M, 3) [m] and (M, 4) beside objects `index` (M,).

        `object_pose_w` (M, 7) is where these are; None: at the origin. `targets_w` (M, K, 3) are marked.
        """
        count = len(index)
        still = np.broadcast_to([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], (count, 7))
        there = still if object_pose_w is None else object_pose_w.double().numpy()
        root = root_pos_w.double().numpy(), root_quat_w.double().numpy()
        poses = Poses(*root, there[:, :3], there[:, 3:])
        objects = [self._objects[i] for i in index.tolist()]
        return torch.from_numpy(views(objects, poses, self._rig, targets_w, self._workers))


def _seen(objects: Sequence[SceneObject], poses: Poses, rig: Rig) -> np.ndarray:
    """(N, C, side, side, 4) what each camera sees."""
    side, cameras = side_of(rig), len(rig.mounts)
    surfaces = [faces_of(obj) for obj in objects]
    inverse = _floor(poses, rig, side)
    floor = inverse > 0
    faces = faces_seen(surfaces, poses, rig, (side, side))
    start = np.arange(len(objects) * cameras) * side
    faces.fill(inverse, start)
    surface = faces.surfaces(inverse, start)
    color = np.where(floor[..., None], FLOOR * _lit(np.array([0.0, 0.0, 1.0])), SKY)
    shown = surface >= 0
    color[shown] = _colors(objects, poses)[surface[shown]]
    with np.errstate(divide="ignore"):
        depth = np.minimum(1 / inverse / np.float32(RANGE), 1)
    return np.concatenate([color, depth[..., None]], -1).reshape(len(objects), cameras, side, side, CHANNELS)


def _floor(poses: Poses, rig: Rig, side: int) -> np.ndarray:
    """(N C side, side) float32 inverse depth of the floor [1/m], 0 above the horizon."""
    up = rot.to_matrix(poses.root_quat_w)[:, 2]
    height = poses.root_pos_w[:, 2:] + up @ rig.origins().T
    form = np.einsum("ni,cik->nck", up, rig.sights(side, side)) / -np.maximum(height, 1e-3)[..., None]
    row, column = np.arange(side)[:, None], np.arange(side)
    inverse = form[..., :1, None] + form[..., 1:2, None] * row + form[..., 2:, None] * column
    return np.maximum(inverse, 0).astype(np.float32).reshape(-1, side)


def _lit(normals: np.ndarray) -> np.ndarray:
    """(...) share of its color that a face of a normal (..., 3) in the world has."""
    return (AMBIENT + (1 - AMBIENT) * np.maximum(normals @ LAMP, 0)).astype(np.float32)


def _colors(objects: Sequence[SceneObject], poses: Poses) -> np.ndarray:
    """(F, 3) float32 of all faces of all objects, one after the other as in `Surfaces.of`."""
    surfaces = [faces_of(obj) for obj in objects]
    plain = np.concatenate([obj.box_rgb[part.piece] for obj, part in zip(objects, surfaces, strict=True)])
    every = Surfaces.of(surfaces)
    normals = (rot.to_matrix(poses.object_quat_w)[every.scene] @ every.normals[:, 0, :, None])[..., 0]
    return plain.astype(np.float32) * _lit(normals)[:, None]


def _mark(seen: np.ndarray, poses: Poses, rig: Rig, targets_w: np.ndarray) -> None:
    """Color the pixels of the targets, as `targets.mark_targets` does."""
    side = seen.shape[2]
    for picture, pos, quat, places_w in zip(seen, poses.root_pos_w, poses.root_quat_w, targets_w, strict=True):
        told = places_w[np.isfinite(places_w).all(-1)]
        places, depth = rig.project(rot.rotate_inverse(quat, told - pos), side, side)
        place = np.floor(places).astype(int)
        camera, target = np.nonzero((depth > 0) & ((place >= 0) & (place < side)).all(-1))
        picture[camera, place[camera, target, 0], place[camera, target, 1], :3] = np.array(RED) / 255


def _side_by_side(seen: np.ndarray) -> np.ndarray:
    """(N, 4, 128, 128) of the pictures (N, C, side, side, 4), row by row; black where there are fewer than fit."""
    count, cameras, side = seen.shape[:3]
    across = SIDE // side
    found = np.zeros((count, CHANNELS, SIDE, SIDE), np.float32)
    for camera in range(cameras):
        row, column = (side * part for part in divmod(camera, across))
        found[:, :, row : row + side, column : column + side] = seen[:, camera].transpose(0, 3, 1, 2)
    return found
