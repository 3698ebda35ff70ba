"""Pictures of running episodes, from a camera that stands at the object's side and follows the robot."""

import mujoco
import numpy as np

from mimicbench.drawing.camera import Camera, Picture
from mimicbench.drawing.light import begin, dress, shine
from mimicbench.drawing.opengl import SharedCanvas
from mimicbench.objects.shape import SceneObject
from mimicbench.robots.description import Robot
from mimicbench.sim.scene import build_model

_MAX_SHAPES = 1000


class View:
    """Draws any number of scenes of one robot, one after the other, through one OpenGL context. Close it after use."""

    def __init__(self, robot: Robot, height: int, width: int) -> None:
        self._robot, self.height, self.width = robot, height, width
        self._canvas = SharedCanvas(height, width)
        self._scenes: dict[int, tuple[SceneObject, mujoco.MjModel, mujoco.MjData]] = {}
        self._camera, self._option = mujoco.MjvCamera(), mujoco.MjvOption()

    def draw(self, env: int, obj: SceneObject, qpos: np.ndarray, goal_w: np.ndarray) -> np.ndarray:
        """A picture (height, width, 3), uint8, of scene `env`.

        Args:
            env: which of the scenes it is; one whose object is the same as before is not compiled again.
            obj: its object.
            qpos: (nq,) its positions.
            goal_w: (K, 3) places that are marked by red balls [m].
        """
        model, data = self._scene(env, obj)
        canvas = self._canvas.of(model)
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        low, high = obj.bounds()
        camera = _beside(obj, qpos)
        shine(model, canvas.drawing, camera)
        mujoco.mj_camlight(model, data)
        self._camera.lookat[:], self._camera.distance = camera.lookat, camera.distance
        self._camera.azimuth, self._camera.elevation = camera.azimuth, camera.elevation
        scene = begin(model, _MAX_SHAPES)
        mujoco.mjv_updateScene(model, data, self._option, None, self._camera, mujoco.mjtCatBit.mjCAT_ALL, scene)
        for place in goal_w[np.isfinite(goal_w).all(-1)]:
            ball = scene.geoms[scene.ngeom]
            red = np.array([0.85, 0.1, 0.1, 1.0], np.float32)
            mujoco.mjv_initGeom(ball, mujoco.mjtGeom.mjGEOM_SPHERE, np.full(3, 0.03), place, np.eye(3).ravel(), red)
            scene.ngeom += 1
        rect = mujoco.MjrRect(0, 0, self.width, self.height)
        mujoco.mjr_render(rect, scene, canvas.drawing)
        pixels = np.empty((self.height, self.width, 3), np.uint8)
        mujoco.mjr_readPixels(pixels, None, rect, canvas.drawing)
        return pixels[::-1].copy()  # OpenGL's first row is the lowest

    def _scene(self, env: int, obj: SceneObject) -> tuple[mujoco.MjModel, mujoco.MjData]:
        if env not in self._scenes or self._scenes[env][0] is not obj:
            model = build_model(self._robot, obj, visuals=True)
            dress(model, Picture(self.width, self.height))
            self._scenes[env] = obj, model, mujoco.MjData(model)
        return self._scenes[env][1:]

    def close(self) -> None:
        """Give the OpenGL context back; the next picture opens another."""
        self._canvas.close()


def _beside(obj: SceneObject, qpos: np.ndarray) -> Camera:
    """Where one sees robot and object from: the side to which the robot stands, farther away the farther it is."""
    low, high = obj.bounds()
    middle = 0.5 * (qpos[:2] + 0.5 * (low + high)[:2])
    distance = 3.4 + 0.8 * np.linalg.norm(qpos[:2]) + 0.65 * np.linalg.norm((high - low)[:2])
    azimuth = 128.0 if qpos[1] >= 0 else -128.0
    return Camera((float(middle[0]), float(middle[1]), 0.65), float(distance), azimuth, -14.0)
