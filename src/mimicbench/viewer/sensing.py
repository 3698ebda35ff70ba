"""What the robot sees and feels at a moment: its elevation map, its cameras, and the forces of its contacts."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.objects.shape import SceneObject
from mimicbench.robots.description import Robot
from mimicbench.robots.rigs import Rig
from mimicbench.sensors.elevation_cpu import Poses, maps_by_cameras
from mimicbench.sensors.heightmap import MapView, cell_centers
from mimicbench.sensors.rays import FARTHEST
from mimicbench.sensors.sight.surfaces import faces_of
from mimicbench.sim.physics import PhysicsConfig, compile_scene
from mimicbench.tasks.task import Task
from mimicbench.viewer.tracks import Pose, State

RAISED = 0.03
"""[m] Cells that are this much above the floor are drawn."""
_LOW, _HIGH = np.array([38, 70, 110]), np.array([250, 214, 96])
"""Colors of the floor and of what is as high as the root, or higher."""
CAMERA_PIXELS = 90, 120
"""Rows and columns of the cameras' pictures; the paper's cameras have four times as many of each."""
FAR = 6.0
"""[m] What is farther is dark."""
_FAINT = 5.0
"""[N] Weaker contacts are not drawn."""
_LENGTH = 1 / 1500
"""[m/N] of arrows."""


def elevation(task: Task, obj: SceneObject, pose: Pose) -> np.ndarray:
    """(128, 128) the elevation map that a robot in a pose has, relative to its root [m]."""
    view = MapView(task.rig, task.map_cell)
    root, turn, there, turned = (
        np.asarray(values, float)[None]
        for values in (pose.pos_w[0], pose.quat_w[0], pose.object_pos_w, pose.object_quat_w)
    )
    poses = Poses(root, turn, there, turned)
    return maps_by_cameras([faces_of(obj)], poses, task.rig, view.pixels, task.map_cell, workers=1)[0]


def raised_cells(heights: np.ndarray, cell: float, pose: Pose) -> tuple[np.ndarray, np.ndarray]:
    """Where the cells of a map are that stand out of the floor: (P, 3) in the world [m], and colors (P, 3) uint8."""
    root, yaw = pose.pos_w[0], rot.yaw_of(pose.quat_w[0])
    row, column = np.nonzero(heights + root[2] > RAISED)
    middle = cell_centers(len(heights), cell)
    ahead = np.stack([middle[row], middle[column], heights[row, column]], -1)
    return root + rot.rotate(rot.from_yaw(yaw), ahead), _colors(heights[row, column] + root[2], root[2])


def map_picture(heights: np.ndarray, root_height: float) -> np.ndarray:
    """A map as a picture, uint8: ahead is up, left is left, and the robot in the middle is red."""
    picture = _colors(heights + root_height, root_height)
    middle = len(heights) // 2
    picture[middle - 1 : middle + 1, middle - 1 : middle + 1] = (225, 40, 35)
    return picture[::-1, ::-1].copy()


def _colors(height: np.ndarray, most: float) -> np.ndarray:
    share = np.clip(height / max(most, 1e-6), 0.0, 1.0)[..., None]
    return (_LOW + share * (_HIGH - _LOW)).astype(np.uint8)


@dataclass
class Probe:
    """Works out what states bring; the scene is compiled once for all states in it."""

    _known: tuple[Robot, SceneObject, str] | None = None
    _scene: tuple[mujoco.MjModel, mujoco.MjData] | None = None

    def forces(self, robot: Robot, obj: SceneObject, state: State) -> np.ndarray:
        """(C, 2, 3) arrows of the forces that act on the robot in a state, from where they act [m]."""
        return contact_forces(*self._compiled(robot, obj, state), robot, state)

    def depth(self, robot: Robot, obj: SceneObject, state: State, rig: Rig) -> np.ndarray:
        """(C, rows, columns) what its depth cameras see in a state [m], its own body as well."""
        return camera_depth(*self._compiled(robot, obj, state), state, rig)

    def _compiled(self, robot: Robot, obj: SceneObject, state: State) -> tuple[mujoco.MjModel, mujoco.MjData]:
        known = robot, obj, state.gains
        if (
            self._scene is None
            or self._known is None
            or any(a is not b for a, b in zip(known, self._known, strict=True))
        ):
            model = compile_scene(robot, obj, PhysicsConfig(gains=state.gains))
            self._known, self._scene = known, (model, mujoco.MjData(model))
        return self._scene


def camera_depth(model: mujoco.MjModel, data: mujoco.MjData, state: State, rig: Rig) -> np.ndarray:
    """(C, rows, columns) depth along the axes of a rig's cameras in a state of its scene, at most 50 m [m]."""
    mujoco.mj_resetData(model, data)
    data.qpos[:] = state.qpos
    mujoco.mj_forward(model, data)
    rays = rig.rays(*CAMERA_PIXELS).reshape(len(rig.mounts), -1, 3)
    turn = rot.to_matrix(state.qpos[3:7])
    found = np.empty(rays.shape[:2])
    for camera, (origin, ray) in enumerate(zip(rig.origins(), rays, strict=True)):
        eye, looks = state.qpos[:3] + turn @ origin, np.ascontiguousarray(ray @ turn.T)
        met, share = np.zeros(len(ray), np.int32), np.zeros(len(ray))
        mujoco.mj_multiRay(model, data, eye, looks.ravel(), None, 1, -1, met, share, None, len(ray), FARTHEST)
        found[camera] = np.where(met < 0, FARTHEST, np.minimum(share, FARTHEST))
    return found.reshape(-1, *CAMERA_PIXELS)


def camera_order(rig: Rig) -> list[int]:
    """A rig's cameras as they are shown: what looks ahead before what looks back, and left before right."""
    bearings = [mount.bearing for mount in rig.mounts]
    return sorted(range(len(bearings)), key=lambda at: (abs(bearings[at]) > np.pi / 2, -bearings[at]))


def depth_picture(depth: np.ndarray) -> np.ndarray:
    """Depth images (C, rows, columns) side by side, two in a row, uint8: what is near is light."""
    near = 1 - np.clip(depth / FAR, 0.0, 1.0) ** 0.5
    return side_by_side((_LOW + near[..., None] * (_HIGH - _LOW)).astype(np.uint8))


def side_by_side(shown: np.ndarray) -> np.ndarray:
    """Pictures (C, rows, columns, 3) as one, two in a row."""
    shown = np.pad(shown, ((0, len(shown) % 2), (0, 1), (0, 1), (0, 0)), constant_values=255)
    return np.concatenate([np.concatenate(list(pair), 1) for pair in shown.reshape(-1, 2, *shown.shape[1:])])


def contact_forces(model: mujoco.MjModel, data: mujoco.MjData, robot: Robot, state: State) -> np.ndarray:
    """(C, 2, 3) arrows of the forces that act on the robot in a state of its scene, from where they act [m]."""
    mujoco.mj_resetData(model, data)
    data.qpos[:], data.qvel[:], data.ctrl[:] = state.qpos, state.qvel, state.target
    mujoco.mj_forward(model, data)
    force, arrows = np.zeros(6), []
    robot_bodies = {model.body(name).id for name in robot.link_names}
    for number in range(data.ncon):
        contact = data.contact[number]
        mujoco.mj_contactForce(model, data, number, force)
        world = contact.frame.reshape(3, 3).T @ force[:3]
        if np.linalg.norm(world) < _FAINT:
            continue
        # MuJoCo's force acts on the second body
        sign = 1.0 if int(model.geom_bodyid[contact.geom2]) in robot_bodies else -1.0
        arrows.append((contact.pos, contact.pos + sign * _LENGTH * world))
    return np.array(arrows).reshape(-1, 2, 3)
