"""Pictures of objects, drawn by MuJoCo. Needs `MUJOCO_GL=egl` where there is no display."""

from collections.abc import Sequence
from pathlib import Path

import imageio.v3 as iio
import mujoco
import numpy as np

from mimicbench.objects.shape import SceneObject

VIEW_ANGLE = np.deg2rad(45)
"""Of the camera, from bottom to top: MuJoCo's own."""


def contact_sheet(objects: Sequence[SceneObject], path: Path, columns: int = 6, cell: tuple[int, int] = (220, 200)) -> None:
    """Write a picture with one object per cell; `cell` is its (height, width) in pixels. All objects are drawn to the same scale."""
    blank = np.full((*cell, 3), 255, np.uint8)
    reach = max(extent(obj) for obj in objects)
    middle = float(np.mean([obj.bounds()[1][2] / 2 for obj in objects]))
    tiles = [picture(obj, cell, reach, middle) for obj in objects]
    tiles += [blank] * (-len(tiles) % columns)
    rows = [np.concatenate(tiles[i : i + columns], 1) for i in range(0, len(tiles), columns)]
    path.parent.mkdir(parents=True, exist_ok=True)
    iio.imwrite(path, np.concatenate(rows, 0))


def extent(obj: SceneObject) -> float:
    """Radius of the sphere around an object's bounding box [m]."""
    low, high = obj.bounds()
    return float(np.linalg.norm(high - low) / 2)


def picture(obj: SceneObject, size: tuple[int, int], reach: float | None = None, middle: float | None = None) -> np.ndarray:
    """(H, W, 3) view of an object from the front left, above.

    Args:
        obj: the object.
        size: height and width in pixels.
        reach: radius around the object that the picture must show [m]; the object's own by default.
        middle: height that is in the middle of the picture [m]; the object's own by default.
    """
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    spec.visual.headlight.ambient = [0.48, 0.48, 0.48]
    spec.visual.headlight.diffuse = [0.35, 0.35, 0.35]
    spec.visual.map.znear, spec.visual.map.zfar = 0.02, 30.0
    spec.visual.headlight.specular = [0, 0, 0]
    spec.visual.quality.shadowsize = 2048
    spec.visual.global_.offwidth, spec.visual.global_.offheight = size[1], size[0]
    spec.add_texture(
        name="sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX, builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT, rgb1=[0.93, 0.93, 0.92], width=16, height=16
    )
    world = spec.worldbody
    world.add_light(
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, pos=[1.5, 1.0, 3.0], dir=[-0.45, -0.3, -0.9],
        diffuse=[0.45, 0.45, 0.45], specular=[0, 0, 0], castshadow=True,
    )  # fmt: skip
    world.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[20, 20, 0.1], rgba=[0.93, 0.93, 0.92, 1])
    for pos, quat, half, rgb in zip(obj.box_pos, obj.box_quat, obj.box_half, obj.box_rgb, strict=True):
        world.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, pos=pos, quat=quat, size=half, rgba=[*rgb, 1])
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    camera = mujoco.MjvCamera()
    camera.lookat[:] = (0, 0, obj.bounds()[1][2] / 2 if middle is None else middle)
    narrow = np.arctan(np.tan(VIEW_ANGLE / 2) * min(1.0, size[1] / size[0]))
    # furniture does not fill the sphere around it
    camera.distance = 0.85 * (extent(obj) if reach is None else reach) / np.sin(narrow)
    camera.azimuth, camera.elevation = 215, -22
    with mujoco.Renderer(model, *size) as renderer:
        renderer.update_scene(data, camera)
        return renderer.render().copy()
