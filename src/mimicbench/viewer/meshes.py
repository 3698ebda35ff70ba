"""Simple shapes as triangles: few enough for a browser without a graphics card."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import mujoco
import numpy as np
import trimesh
from mjviser.conversions import mujoco_mesh_to_trimesh
from trimesh.visual import ColorVisuals

from mimicbench.core import rotations as rot
from mimicbench.report.person import Solid

_SIDES, _RINGS = 16, 10
"""Of what is round."""


@lru_cache
def _ball() -> tuple[np.ndarray, np.ndarray]:
    """Corners (V, 3) and triangles (F, 3) of a ball of radius 1, no corner of which is on its equator."""
    turn = np.linspace(0, 2 * np.pi, _SIDES, endpoint=False)
    rise = np.linspace(-np.pi / 2, np.pi / 2, _RINGS)[1:-1]
    ring = np.stack(np.broadcast_arrays(np.cos(turn), np.sin(turn), 0.0), -1)
    corners = np.concatenate([np.column_stack([ring[:, :2] * np.cos(r), np.full(_SIDES, np.sin(r))]) for r in rise])
    corners = np.concatenate([corners, [(0.0, 0.0, -1.0), (0.0, 0.0, 1.0)]])
    place = np.arange(len(rise) * _SIDES).reshape(len(rise), _SIDES)
    low, high = place[:-1].ravel(), place[1:].ravel()
    low_next, high_next = (np.roll(part, -1, 1).ravel() for part in (place[:-1], place[1:]))
    bottom, top = len(corners) - 2, len(corners) - 1
    first, last = place[0], place[-1]
    faces = [
        np.column_stack([low, low_next, high_next]),
        np.column_stack([low, high_next, high]),
        np.column_stack([np.roll(first, -1), first, np.full(_SIDES, bottom)]),
        np.column_stack([last, np.roll(last, -1), np.full(_SIDES, top)]),
    ]
    return corners, np.concatenate(faces)


@lru_cache
def _unit(kind: mujoco.mjtGeom) -> tuple[np.ndarray, np.ndarray]:
    """Corners and triangles of a box of half sizes 1, or a cylinder of radius 1 and half height 1, with sharp edges."""
    cube = kind == mujoco.mjtGeom.mjGEOM_BOX
    mesh = trimesh.creation.box((2, 2, 2)) if cube else trimesh.creation.cylinder(1.0, 2.0, sections=24)
    mesh.unmerge_vertices()
    return np.array(mesh.vertices), np.array(mesh.faces)


def capsule(radius: float, half: float) -> tuple[np.ndarray, np.ndarray]:
    """Along z; `half` its length between the centers of its ends [m]."""
    corners, faces = _ball()
    return radius * corners + np.sign(corners[:, 2:]) * (0.0, 0.0, half), faces


def colored(corners: np.ndarray, faces: np.ndarray, rgb: Sequence[float]) -> trimesh.Trimesh:
    """A mesh of one color, in 0..1."""
    mesh = trimesh.Trimesh(corners, faces, process=False)
    color = np.array([*(round(255 * float(part)) for part in rgb), 255], np.uint8)
    mesh.visual = ColorVisuals(mesh, vertex_colors=np.tile(color, (len(corners), 1)))
    return mesh


def geom_mesh(model: mujoco.MjModel, geom: int) -> trimesh.Trimesh:
    """A shape of a model, in its body's frame."""
    size, kind = model.geom_size[geom], mujoco.mjtGeom(int(model.geom_type[geom]))
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        mesh = mujoco_mesh_to_trimesh(model, geom)
        mesh.unmerge_vertices()
    elif kind == mujoco.mjtGeom.mjGEOM_CAPSULE:
        mesh = colored(*capsule(size[0], size[1]), model.geom_rgba[geom, :3])
    elif kind in (mujoco.mjtGeom.mjGEOM_SPHERE, mujoco.mjtGeom.mjGEOM_ELLIPSOID):
        corners, faces = _ball()
        half = size if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID else size[[0, 0, 0]]
        mesh = colored(corners * half, faces, model.geom_rgba[geom, :3])
    else:
        corners, faces = _unit(kind)
        half = size if kind == mujoco.mjtGeom.mjGEOM_BOX else size[[0, 0, 1]]
        mesh = colored(corners * half, faces, model.geom_rgba[geom, :3])
    mesh.vertices = rot.rotate(model.geom_quat[geom], np.array(mesh.vertices)) + model.geom_pos[geom]
    return mesh


def solid_mesh(solid: Solid) -> trimesh.Trimesh:
    """A solid of a person, in its joint's frame."""
    at = np.array(solid.at)
    if solid.kind != "capsule":
        corners, faces = _ball()
        return colored(rot.rotate(rot.from_yaw(np.array(solid.yaw)), corners * solid.size) + at, faces, solid.rgb)
    to = np.array(solid.to or solid.at)
    length = float(np.linalg.norm(to - at))
    corners, faces = capsule(solid.size[0], length / 2)
    if length > 1e-9:
        corners = corners @ np.asarray(trimesh.geometry.align_vectors([0.0, 0.0, 1.0], (to - at) / length))[:3, :3].T
    return colored(corners + (at + to) / 2, faces, solid.rgb)


def joined(meshes: Sequence[trimesh.Trimesh]) -> trimesh.Trimesh:
    """Several meshes as one."""
    corners = np.concatenate([mesh.vertices for mesh in meshes])
    first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes[:-1])])
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, first, strict=True)])
    whole = trimesh.Trimesh(corners, faces, process=False)
    visuals: list[Any] = [mesh.visual for mesh in meshes]
    colors = np.concatenate([visual.vertex_colors for visual in visuals])
    whole.visual = ColorVisuals(whole, vertex_colors=colors)
    whole.vertex_normals  # noqa: B018 worked out here, or they are not sent and the browser draws every triangle flat
    return whole
