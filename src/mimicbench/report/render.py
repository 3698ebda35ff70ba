"""Pictures of scenes: frames of a robot or a human in motion.

Everything is drawn from `build_model(..., visuals=True)` of `mimicbench.sim.scene`, so that a human and a robot stand
in the same light on the same floor beside the same object.
"""

import copy
from collections.abc import Callable, Iterator
from types import TracebackType
from typing import Self

import mujoco
import numpy as np

from mimicbench.core import rotations as rot
from mimicbench.core.errors import MimicbenchError
from mimicbench.core.motion import HumanMotion, RobotMotion
from mimicbench.drawing.camera import Camera, Picture
from mimicbench.drawing.light import begin, dress, shine, suns
from mimicbench.drawing.opengl import Canvas
from mimicbench.report.person import Placed, Solid, place, solids_of
from mimicbench.sim.scene import OBJECT_BODY, ROBOT_GROUP, VISUAL_GROUP

_MAX_SHAPES = 2000
_GOAL_RADIUS = 0.022
"""Of the balls that show where wrists are to go [m]."""
_GOAL_COLOR = (0.90, 0.13, 0.12)


class Painter:
    """Draws one model. Use as a context manager: GL contexts are few, and must be given back."""

    def __init__(self, model: mujoco.MjModel, picture: Picture, camera: Camera) -> None:
        self.picture = picture
        self.model = copy.copy(model)
        dress(self.model, picture)
        self.data = mujoco.MjData(self.model)
        self.option = mujoco.MjvOption()
        self._canvas = Canvas(self.model, picture.height, picture.width)
        shine(self.model, self._canvas.drawing, camera)
        self._scene = begin(self.model, _MAX_SHAPES)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = picture.shadow > 0
        self._suns = suns(self.model.light_dir[0], picture.suns) if self.model.nlight else [np.zeros(3)]
        self._camera = mujoco.MjvCamera()
        self.aim(camera)

    def aim(self, camera: Camera) -> None:
        """Look elsewhere from now on."""
        self._camera.lookat[:] = camera.lookat
        self._camera.distance, self._camera.azimuth, self._camera.elevation = (
            camera.distance,
            camera.azimuth,
            camera.elevation,
        )

    def draw(self, qpos: np.ndarray | None = None, add: Callable[[mujoco.MjvScene], None] | None = None) -> np.ndarray:
        """A picture (height, width, 3), uint8.

        Args:
            qpos: (nq,) positions of the model; as they are if None.
            add: puts further shapes into the scene.
        """
        if qpos is not None:
            self.data.qpos[:] = qpos
        mujoco.mj_kinematics(self.model, self.data)
        return np.round(np.mean([self._in_light(sun, add) for sun in self._suns], axis=0)).astype(np.uint8)

    def _in_light(self, sun: np.ndarray, add: Callable[[mujoco.MjvScene], None] | None) -> np.ndarray:
        """The picture with the sun shining in a direction (3,)."""
        self.model.light_dir[:1] = sun
        mujoco.mj_camlight(self.model, self.data)
        mujoco.mjv_updateScene(
            self.model, self.data, self.option, None, self._camera, mujoco.mjtCatBit.mjCAT_ALL, self._scene
        )
        if add is not None:
            add(self._scene)
        self._canvas.make_current()
        rect = mujoco.MjrRect(0, 0, self.picture.width, self.picture.height)
        mujoco.mjr_render(rect, self._scene, self._canvas.drawing)
        pixels = np.empty((self.picture.height, self.picture.width, 3), np.uint8)
        mujoco.mjr_readPixels(pixels, None, rect, self._canvas.drawing)
        return pixels[::-1]

    def close(self) -> None:
        """Give the GL context back."""
        self._canvas.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def robot_frames(
    model: mujoco.MjModel,
    qpos: np.ndarray,
    camera: Camera,
    picture: Picture | None = None,
    goals_w: np.ndarray | None = None,
) -> Iterator[np.ndarray]:
    """Pictures (height, width, 3) of a model, one after the other.

    Args:
        model: a scene with `visuals=True`.
        qpos: (T, nq) positions, one row per picture.
        camera: where to look from, such as `frame_all` gives it.
        picture: size and quality.
        goals_w: (K, 3) where wrists are to go [m], shown as red balls; none if None.
    """
    if qpos.ndim != 2 or qpos.shape[1] != model.nq:
        raise MimicbenchError(
            f"positions of shape {qpos.shape} do not fit a model of {model.nq} coordinates; they are "
            "of another robot or object"
        )
    with Painter(model, picture or Picture(), camera) as painter:
        for row in qpos:
            yield painter.draw(row, lambda scene: _add_goals(scene, goals_w))


def human_frames(
    model: mujoco.MjModel, motion: HumanMotion, times: np.ndarray, camera: Camera, picture: Picture | None = None
) -> Iterator[np.ndarray]:
    """Pictures (height, width, 3) of a human clip in a model's scene, with the object where the clip has it.

    The model's robot is left out.

    Args:
        model: a scene with `visuals=True` and the clip's object.
        motion: the clip.
        times: (T,) moments to draw [s]; the nearest frame is taken.
        camera: where to look from.
        picture: size and quality.
    """
    solids = solids_of(motion.skeleton)
    joint_pos, joint_quat = motion.forward_kinematics()
    frames = np.clip(np.round(np.asarray(times) * motion.fps).astype(int), 0, motion.frames - 1)
    qpos = with_object(model, motion)
    with Painter(model, picture or Picture(), camera) as painter:
        painter.option.geomgroup[VISUAL_GROUP] = painter.option.geomgroup[ROBOT_GROUP] = 0
        for i in frames:
            placed = place(solids, motion.skeleton, joint_pos[i], joint_quat[i])

            def add(scene: mujoco.MjvScene, placed: list[Placed] = placed) -> None:
                _add_shapes(scene, placed)
                _add_goals(scene, motion.wrist_goal_w)

            yield painter.draw(qpos[i], add)


def with_object(model: mujoco.MjModel, motion: HumanMotion | RobotMotion) -> np.ndarray:
    """(T, nq) positions at which the model starts, but for its object, which goes the way that it goes in a clip."""
    qpos = np.tile(model.qpos0, (motion.frames, 1))
    joint = int(model.body(OBJECT_BODY).jntadr[0])
    if len(motion.object_pos_w) and joint >= 0:
        free = int(model.jnt_qposadr[joint])
        qpos[:, free : free + 3], qpos[:, free + 3 : free + 7] = motion.object_pos_w, motion.object_quat_w
    return qpos


def _add_shapes(scene: mujoco.MjvScene, placed: list[Placed]) -> None:
    for part in placed:
        if scene.ngeom >= scene.maxgeom:
            raise MimicbenchError(f"a picture has room for {scene.maxgeom} shapes; this scene needs more")
        solid, geom = part.solid, scene.geoms[scene.ngeom]
        rgba = np.array([*solid.rgb, 1.0], np.float32)
        kind = getattr(mujoco.mjtGeom, f"mjGEOM_{solid.kind.upper()}")
        mujoco.mjv_initGeom(geom, kind, np.array(solid.size), part.at_w, rot.to_matrix(part.quat_w).ravel(), rgba)
        if solid.kind == "capsule":
            mujoco.mjv_connector(geom, kind, solid.size[0], part.at_w, part.to_w)
        geom.category = mujoco.mjtCatBit.mjCAT_DYNAMIC  # decoration would cast no shadow
        geom.specular, geom.shininess = 0.15, 0.2
        scene.ngeom += 1


def _add_goals(scene: mujoco.MjvScene, goals_w: np.ndarray | None) -> None:
    solid = Solid("", "ellipsoid", _GOAL_COLOR, (_GOAL_RADIUS, _GOAL_RADIUS, _GOAL_RADIUS), (0.0, 0.0, 0.0))
    known = [goal for goal in (() if goals_w is None else goals_w) if np.isfinite(goal).all()]
    _add_shapes(scene, [Placed(solid, goal, goal, rot.IDENTITY) for goal in known])
