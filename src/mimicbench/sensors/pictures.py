"""What the cameras of many robots see, each in its own scene."""

from typing import NamedTuple

import numpy as np
from torch import Tensor

from mimicbench.drawing.opengl import SharedCanvas
from mimicbench.objects.shape import SceneObject
from mimicbench.robots.description import Robot
from mimicbench.robots.rigs import Rig
from mimicbench.sensors.render import RigCameras
from mimicbench.sensors.targets import mark_targets
from mimicbench.sim.physics import Physics
from mimicbench.sim.scene import build_model


class Seen(NamedTuple):
    """Pictures of all C cameras of one robot."""

    color: np.ndarray
    """(C, height, width, 3) uint8."""
    labels: np.ndarray
    """(C, height, width) uint8, see mimicbench.sensors.render."""


class CameraPictures:
    """Draws what the robots see one after the other, through one OpenGL context. Close it after use."""

    def __init__(self, robot: Robot, rig: Rig, height: int, width: int) -> None:
        self._robot, self._rig, self.height, self.width = robot, rig, height, width
        self._canvas = SharedCanvas(height, width)
        self._cameras: dict[int, tuple[SceneObject, RigCameras]] = {}

    def look(self, env: int, obj: SceneObject, qpos: np.ndarray, goal_w: np.ndarray) -> Seen:
        """Pictures of scene `env`. Raises NoPictures.

        Args:
            env: which of the scenes it is; one whose object is the same as before is not compiled again.
            obj: its object.
            qpos: (nq,) its positions; of physics that broke down, black pictures are made.
            goal_w: (K, 3) places that are marked by one red pixel each, hidden or not [m] (appendix C.2).
        """
        if not np.isfinite(qpos).all():
            size = (len(self._rig.mounts), self.height, self.width)
            return Seen(np.zeros((*size, 3), np.uint8), np.zeros(size, np.uint8))
        if env not in self._cameras or self._cameras[env][0] is not obj:
            model = build_model(self._robot, obj, visuals=True)
            self._cameras[env] = obj, RigCameras(model, self._rig, self.height, self.width, canvas=self._canvas)
        views = self._cameras[env][1].look(qpos)
        return Seen(mark_targets(views.color, self._rig, qpos[:3], qpos[3:7], goal_w), views.labels)

    def views(self, physics: Physics, wrist_goal_w: Tensor) -> Seen:
        """Pictures of all N scenes, (N, C, ...), with the goals (N, 2, 3) that there are marked. Raises NoPictures."""
        qpos, goals = physics.qpos(), wrist_goal_w.cpu().numpy()
        looks = [
            self.look(env, obj, qpos[env], goals[env][np.isfinite(goals[env]).all(-1)])
            for env, obj in enumerate(physics.objects)
        ]
        return Seen(np.stack([look.color for look in looks]), np.stack([look.labels for look in looks]))

    def close(self) -> None:
        """Give the OpenGL context back; the next look opens another."""
        self._canvas.close()
