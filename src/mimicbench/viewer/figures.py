"""Bodies on the page: meshes that are sent once, and then only moved."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
import trimesh

from mimicbench.core.skeleton import Skeleton
from mimicbench.objects.shape import SceneObject
from mimicbench.report.person import solids_of
from mimicbench.robots.description import Robot
from mimicbench.sim.scene import OBJECT_BODY, ROBOT_GROUP, VISUAL_GROUP, build_model, build_object
from mimicbench.viewer.meshes import geom_mesh, joined, solid_mesh

if TYPE_CHECKING:
    import viser

Color = tuple[int, int, int]
_GRAIN = 0.0015
"""[m] Boxes no larger are slots that an object leaves empty."""


@dataclass(frozen=True)
class Look:
    """How a body is drawn."""

    color: Color | None = None
    """Of all of it; None: its own colors."""
    opacity: float = 1.0
    """Of bodies of one color."""


class Figure:
    """The meshes of one body in the scene, each on one of its parts."""

    def __init__(self, server: viser.ViserServer, name: str, meshes: dict[int, trimesh.Trimesh], look: Look) -> None:
        """`meshes` by the part (joint or link) in whose frame they are."""
        self._frame = server.scene.add_frame(f"/{name}", show_axes=False)
        self._parts = [(part, _add(server, f"/{name}/{part}", mesh, look)) for part, mesh in meshes.items()]
        self._last: tuple[np.ndarray, np.ndarray] | None = None

    def place(self, pos_w: np.ndarray, quat_w: np.ndarray) -> None:
        """Put its parts to (B, 3) [m] and turn them by (B, 4)."""
        if self._last is not None and all(
            np.array_equal(a, b) for a, b in zip(self._last, (pos_w, quat_w), strict=True)
        ):
            return
        self._last = pos_w, quat_w
        for part, handle in self._parts:
            handle.position, handle.wxyz = pos_w[part], quat_w[part]

    def shift(self, offset: np.ndarray) -> None:
        """Show all of it (3,) [m] beside where it is."""
        self._frame.position = offset

    def show(self, visible: bool) -> None:
        """Show it or hide it."""
        self._frame.visible = visible

    def remove(self) -> None:
        """Take it out of the scene."""
        self._frame.remove()


def _add(server: viser.ViserServer, name: str, mesh: trimesh.Trimesh, look: Look) -> Any:
    if look.color is None:
        return server.scene.add_mesh_trimesh(name, mesh)
    opacity = None if look.opacity == 1.0 else look.opacity
    return server.scene.add_mesh_simple(name, mesh.vertices, mesh.faces, color=look.color, opacity=opacity)


def robot_meshes(robot: Robot, obj: SceneObject) -> dict[int, trimesh.Trimesh]:
    """What a robot looks like, by link; `obj` is any object to compile its scene with."""
    model = build_model(robot, obj, visuals=True)
    group = VISUAL_GROUP if robot.visual else ROBOT_GROUP
    found = {}
    for link, name in enumerate(robot.link_names):
        geoms = np.flatnonzero((model.geom_bodyid == model.body(name).id) & (model.geom_group == group))
        if len(geoms):
            found[link] = joined([geom_mesh(model, int(geom)) for geom in geoms])
    return found


def object_meshes(obj: SceneObject) -> dict[int, trimesh.Trimesh]:
    """What an object looks like: one part."""
    model = build_object(obj)
    mine = model.geom_bodyid == model.body(OBJECT_BODY).id
    whole = (model.geom_type == mujoco.mjtGeom.mjGEOM_MESH) | (model.geom_size.max(1) > _GRAIN)
    return {0: joined([geom_mesh(model, int(geom)) for geom in np.flatnonzero(mine & whole)])}


def human_meshes(skeleton: Skeleton) -> dict[int, trimesh.Trimesh]:
    """What a person looks like, by joint."""
    parts: dict[int, list[trimesh.Trimesh]] = {}
    for solid in solids_of(skeleton):
        parts.setdefault(skeleton.index(solid.joint), []).append(solid_mesh(solid))
    return {joint: joined(meshes) for joint, meshes in parts.items()}


@dataclass(frozen=True)
class Wardrobe:
    """Meshes that have been made, for when the same body is opened again."""

    _made: dict[Any, dict[int, trimesh.Trimesh]]

    @staticmethod
    def empty() -> Wardrobe:
        """Nothing made yet."""
        return Wardrobe({})

    def body(self, figure: Skeleton | Robot, obj: SceneObject) -> dict[int, trimesh.Trimesh]:
        """The meshes of a person or a robot."""
        robot = isinstance(figure, Robot)
        key = figure.name if robot else (figure.name, figure.offsets.tobytes())
        if key not in self._made:
            self._made[key] = robot_meshes(figure, obj) if robot else human_meshes(figure)
        return self._made[key]
