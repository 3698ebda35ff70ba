"""What the robot's cameras see, drawn by OpenGL: color, depth and segmentation (appendix C.2).

Everything is drawn from the model that the physics runs, or from the same with `visuals=True`, which only looks better.
"""

import copy
from dataclasses import dataclass
from types import TracebackType
from typing import Self

import mujoco
import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import MimicbenchError
from mimicbench.drawing.opengl import SharedCanvas
from mimicbench.robots.rigs import HEIGHT, WIDTH, Rig
from mimicbench.sensors.rays import FARTHEST
from mimicbench.sim.scene import FLOOR_GROUP, OBJECT_BODY, OBJECT_GROUP, ROBOT_GROUP, VISUAL_GROUP

NOTHING, FLOOR, OBJECT, ROBOT = 0, 1, 2, 3
"""Labels of the segmentation; ROBOT + i is the robot's link i, so `np.minimum(labels, ROBOT)` tells the robot as a
whole."""
_NEAR, _FAR = 0.01, 200.0
_MAX_PIXELS = 4096
_MAX_SHAPES = 500


@dataclass(frozen=True)
class Views:
    """Pictures of all C cameras of a rig at one moment."""

    color: np.ndarray
    """(C, height, width, 3) uint8; empty (0, ...) if not asked for."""
    depth: np.ndarray
    """(C, height, width) float32 along the camera's axis, at most 50 m [m]."""
    labels: np.ndarray
    """(C, height, width) uint8, see NOTHING, FLOOR, OBJECT, ROBOT."""


class RigCameras:
    """The cameras of one robot in one scene. Use as a context manager."""

    def __init__(
        self,
        model: mujoco.MjModel,
        rig: Rig,
        height: int = HEIGHT,
        width: int = WIDTH,
        robot: bool = True,
        canvas: SharedCanvas | None = None,
    ) -> None:
        """Prepare to draw.

        Args:
            model: A scene of `sim.scene.build_model`.
            rig: Where the cameras are.
            height: Rows of each picture [px].
            width: Columns of each picture [px].
            robot: Whether the robot's own body is in the pictures.
            canvas: Where to draw, of the same size, if other scenes are drawn there too; closing it is then the
                owner's.
        """
        if not (1 <= height <= _MAX_PIXELS and 1 <= width <= _MAX_PIXELS):
            raise MimicbenchError(
                f"a camera's picture can have 1 to {_MAX_PIXELS} rows and columns, not {height} x {width}"
            )
        self.rig, self.height, self.width = rig, height, width
        self._model = copy.copy(model)
        self._model.vis.global_.offheight, self._model.vis.global_.offwidth = height, width
        self._model.vis.quality.shadowsize = 1024
        self._model.vis.quality.offsamples = 0  # one sample per pixel, so that depth and labels belong to its center
        self._data = mujoco.MjData(self._model)
        self._option = mujoco.MjvOption()
        self._option.geomgroup[:] = 0
        for group in (FLOOR_GROUP, OBJECT_GROUP, *((ROBOT_GROUP, VISUAL_GROUP) if robot else ())):
            self._option.geomgroup[group] = 1
        self._camera = mujoco.MjvCamera()
        self._canvas, self._owned = canvas or SharedCanvas(height, width), canvas is None
        self._canvas.of(self._model)  # it had better fail here than later
        self._scene = mujoco.MjvScene(self._model, _MAX_SHAPES)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0
        self._scene.flags[mujoco.mjtRndFlag.mjRND_HAZE] = 0
        self._origins, self._turns = rig.origins(), rig.turns()
        self._top = 0.5 * height / rig.focal(width) * _NEAR
        self._label_of = _labels(model)

    def look(self, qpos: np.ndarray, color: bool = True, labels: bool = True) -> Views:
        """Pictures of the scene at positions (nq,); the robot's root comes first in them. Depth is always there."""
        self._data.qpos[:] = qpos
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        self._camera.lookat[:] = qpos[:3]
        mujoco.mjv_updateScene(
            self._model, self._data, self._option, None, self._camera, mujoco.mjtCatBit.mjCAT_ALL, self._scene
        )
        drawing = self._canvas.of(self._model).drawing
        drawing.readDepthMap = mujoco.mjtDepthMap.mjDEPTH_ZEROFAR
        count, rect = len(self._origins), mujoco.MjrRect(0, 0, self.width, self.height)
        colors = np.empty((count if color else 0, self.height, self.width, 3), np.uint8)
        depths = np.empty((count, self.height, self.width), np.float32)
        ids = np.empty((count, self.height, self.width, 3), np.uint8)
        for i in range(count):
            self._aim(i, qpos[:3], qpos[3:7])
            # shapes in flat colors that number them: quicker than light and shade, and nothing of the floor fades
            self._scene.flags[mujoco.mjtRndFlag.mjRND_SEGMENT] = self._scene.flags[mujoco.mjtRndFlag.mjRND_IDCOLOR] = 1
            mujoco.mjr_render(rect, self._scene, drawing)
            mujoco.mjr_readPixels(ids[i] if labels else None, depths[i], rect, drawing)
            if color:
                self._scene.flags[mujoco.mjtRndFlag.mjRND_SEGMENT] = self._scene.flags[
                    mujoco.mjtRndFlag.mjRND_IDCOLOR
                ] = 0
                mujoco.mjr_render(rect, self._scene, drawing)
                mujoco.mjr_readPixels(colors[i], None, rect, drawing)
        named = self._named(ids) if labels else np.empty((0, self.height, self.width), np.uint8)
        # OpenGL's first row is the lowest
        return Views(*(np.ascontiguousarray(pictures[:, ::-1]) for pictures in (colors, _meters(depths), named)))

    def _aim(self, index: int, root_pos: np.ndarray, root_quat: np.ndarray) -> None:
        """Put camera `index` where the robot carries it."""
        position = root_pos + rot.rotate(root_quat, self._origins[index])
        axes = rot.to_matrix(rot.multiply(root_quat, self._turns[index]))
        for eye in self._scene.camera:  # the two eyes of a stereo pair, of which MuJoCo draws the mean
            eye.pos[:], eye.forward[:], eye.up[:] = position, axes[:, 0], axes[:, 2]
            eye.frustum_center, eye.frustum_bottom, eye.frustum_top = 0.0, -self._top, self._top
            eye.frustum_near, eye.frustum_far = _NEAR, _FAR

    def _named(self, ids: np.ndarray) -> np.ndarray:
        """Labels of the numbers that the shapes were drawn with."""
        of_number = np.zeros(self._scene.ngeom + 1, np.uint8)
        for geom in self._scene.geoms[: self._scene.ngeom]:
            if geom.segid >= 0 and geom.objtype == mujoco.mjtObj.mjOBJ_GEOM:
                of_number[geom.segid + 1] = self._label_of[geom.objid]
        number = ids[..., 0] + (ids[..., 1].astype(np.int32) << 8)
        return of_number[number]

    def close(self) -> None:
        """Give the GL context back, if it is this one's."""
        if self._owned:
            self._canvas.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _labels(model: mujoco.MjModel) -> np.ndarray:
    """(ngeom,) label of each of a model's shapes."""
    links = [body for body in range(1, model.nbody) if model.body(body).name != OBJECT_BODY]  # in the robot's order
    of_body = np.zeros(model.nbody, np.uint8)
    of_body[0], of_body[model.body(OBJECT_BODY).id], of_body[links] = FLOOR, OBJECT, ROBOT + np.arange(len(links))
    return of_body[model.geom_bodyid]


def _meters(depth: np.ndarray) -> np.ndarray:
    """Depth (...) [m] of a depth buffer that holds 1 at the near plane and 0 at the far one."""
    return np.minimum(_NEAR * _FAR / (depth * (_FAR - _NEAR) + _NEAR), FARTHEST).astype(np.float32)
