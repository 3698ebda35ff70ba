"""The light of all pictures that people look at: one soft sun, a matt floor that fades into the backdrop."""

import mujoco
import numpy as np

from mimicbench.drawing.camera import FIELD_OF_VIEW, Camera, Picture
from mimicbench.sim.scene import OBJECT_GROUP

_BACKDROP = (0.90, 0.915, 0.935)
_SUN_RADIUS = 0.07
"""Of the disk over which several suns are spread, at a distance of 1: what is half a meter above the floor has a shadow
whose edge is 7 cm wide."""
_APART = 1e-4
"""[m] by which each box of an object is drawn larger than the one before it: where two have faces in one plane, the
later one is seen, and not now one and now the other."""
_SHADOWS = 1.4
"""How far from the middle of the picture shadows are drawn, in units of half of the camera's distance."""


def dress(model: mujoco.MjModel, picture: Picture) -> None:
    """Set sizes, surfaces and backdrop of a model with visual shapes, once, before a canvas is opened for it."""
    visual = model.vis
    visual.global_.offwidth, visual.global_.offheight = picture.width, picture.height
    visual.global_.fovy = float(np.degrees(FIELD_OF_VIEW))
    visual.quality.shadowsize, visual.quality.offsamples = max(picture.shadow, 1), picture.samples
    visual.quality.numslices, visual.quality.numstacks = 20, 12  # round enough at this size
    visual.headlight.ambient[:], visual.headlight.diffuse[:], visual.headlight.specular[:] = 0.47, 0.24, 0.0
    visual.rgba.fog[:3] = _BACKDROP
    visual.map.shadowclip = _SHADOWS
    for texture in range(model.ntex):
        if model.tex_type[texture] == mujoco.mjtTexture.mjTEXTURE_SKYBOX:
            start = model.tex_adr[texture]
            size = model.tex_width[texture] * model.tex_height[texture] * model.tex_nchannel[texture]
            model.tex_data[start : start + size].reshape(-1, model.tex_nchannel[texture])[:, :3] = np.round(
                255 * np.array(_BACKDROP)
            )
    model.mat_reflectance[:] = 0.0
    if model.nlight:
        model.light_type[0] = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
        model.light_diffuse[0], model.light_specular[0], model.light_ambient[0] = 0.50, 0.15, 0.0
        model.light_castshadow[0] = True
        model.light_bodyid[0], model.light_mode[0] = 0, mujoco.mjtCamLight.mjCAMLIGHT_FIXED
    boxes = (model.geom_group == OBJECT_GROUP) & (model.geom_type == mujoco.mjtGeom.mjGEOM_BOX)
    model.geom_size[boxes] += _APART * np.arange(boxes.sum())[:, None]


def shine(model: mujoco.MjModel, drawing: mujoco.MjrContext, camera: Camera) -> None:
    """Put the sun above the camera's left and let what is far from it fade; again wherever the camera goes.

    Args:
        model: has been dressed.
        drawing: the canvas in which it is drawn.
        camera: where one looks from.
    """
    model.stat.extent = extent = 0.5 * camera.distance  # distances of the view are in units of it
    model.stat.center[:] = camera.lookat
    model.vis.map.znear, model.vis.map.zfar = 0.1 / extent, 15.0 * camera.distance / extent
    drawing.fogStart, drawing.fogEnd = 1.25 * camera.distance, 3.2 * camera.distance
    drawing.shadowClip = _SHADOWS * extent
    if model.nlight:
        yaw = np.radians(camera.azimuth)
        model.light_dir[0] = np.array([0.45 * np.cos(yaw + 0.9), 0.45 * np.sin(yaw + 0.9), -0.9]) / np.hypot(0.45, 0.9)
        model.light_pos[0] = np.array(camera.lookat) - 4.0 * model.light_dir[0]


def suns(direction: np.ndarray, count: int) -> list[np.ndarray]:
    """Directions (3,) spread evenly over a disk around one; that one alone if there is to be one."""
    across = np.cross(direction, (1.0, 0.0, 0.0))
    across /= np.linalg.norm(across)
    upward, turn = np.cross(across, direction), np.pi * (3.0 - 5.0**0.5)  # the golden angle
    return [
        direction
        + (0.0 if count == 1 else _SUN_RADIUS * np.sqrt((i + 0.5) / count))
        * (np.cos(turn * i) * across + np.sin(turn * i) * upward)
        for i in range(count)
    ]


def begin(model: mujoco.MjModel, shapes: int) -> mujoco.MjvScene:
    """A scene with room for so many shapes, in which distance fades and floors do not mirror."""
    scene = mujoco.MjvScene(model, shapes)
    scene.flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0  # it would draw everything twice
    scene.flags[mujoco.mjtRndFlag.mjRND_HAZE] = 0
    scene.flags[mujoco.mjtRndFlag.mjRND_FOG] = 1
    return scene
