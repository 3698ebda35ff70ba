"""Objects on Warp: which arrays of the model differ between them, and the rows that each writes into its world's."""

from collections.abc import Sequence

import mujoco
import numpy as np
import torch

from mimicbench.core.errors import BadObject
from mimicbench.objects.shape import SceneObject
from mimicbench.sim.physics import catalogued
from mimicbench.sim.scene import OBJECT_BODY, build_object

_GEOM_FIELDS = ("geom_pos", "geom_quat", "geom_size", "geom_rbound", "geom_aabb", "geom_friction")
_BODY_FIELDS = ("body_mass", "body_subtreemass", "body_inertia", "body_ipos", "body_iquat", "body_invweight0")
_DOF_FIELDS = ("dof_invweight0",)
PER_WORLD = (*_GEOM_FIELDS, *_BODY_FIELDS, *_DOF_FIELDS)
"""Fields of the model that have a row per world: all that differ between objects and matter to physics."""


def object_places(base: mujoco.MjModel, joints: int) -> dict[str, slice]:
    """Where the object is in each field of a model whose robot has so many joints."""
    body = base.body(OBJECT_BODY).id
    first = int(base.body_geomadr[body])
    return {
        **dict.fromkeys(_GEOM_FIELDS, slice(first, first + int(base.body_geomnum[body]))),
        **dict.fromkeys(_BODY_FIELDS, slice(body, body + 1)),
        **dict.fromkeys(_DOF_FIELDS, slice(6 + joints, base.nv)),
    }


class ObjectRows:
    """A catalog of objects, all movable or all fixed, and what each of them writes into its world."""

    def __init__(self, movable: bool, device: str, friction: float = 1.0) -> None:
        """`friction` is times the sliding friction that they have."""
        self.catalog: list[SceneObject] = []
        self.rows: dict[str, torch.Tensor] = {}
        """By field of the model, (len(catalog), ...)."""
        self._places: dict[str, int] = {}
        self._movable, self._device, self._friction = movable, device, friction

    def add(self, objects: Sequence[SceneObject]) -> list[int]:
        """Places of objects in the catalog, at whose end those are put that it lacks; see WarpPhysics.add_objects."""
        fresh = [obj for obj in {obj.id: obj for obj in objects}.values() if obj.id not in self._places]
        rows = [self._rows(obj) for obj in fresh]
        if rows:
            for name in rows[0]:
                new = torch.stack([row[name] for row in rows]).to(self._device)
                old = self.rows.get(name)
                self.rows[name] = new if old is None else torch.cat([old, new])
        return catalogued(self.catalog, self._places, objects)

    def _rows(self, obj: SceneObject) -> dict[str, torch.Tensor]:
        """What an object has to write into its world."""
        if obj.movable != self._movable:
            raise BadObject(
                f"object {obj.id} is {'movable' if obj.movable else 'fixed'} and others are not; simulate them apart"
            )
        alone = build_object(obj)
        if (alone.geom_type != mujoco.mjtGeom.mjGEOM_BOX).any():
            raise BadObject(
                f"object {obj.id} has convex pieces, which Warp cannot exchange between scenes; use --device cpu for it"
            )
        rows = {name: torch.from_numpy(np.asarray(getattr(alone, name), np.float32)) for name in _GEOM_FIELDS}
        rows |= {name: torch.from_numpy(np.asarray(getattr(alone, name)[1:], np.float32)) for name in _BODY_FIELDS}
        rows |= {name: torch.from_numpy(np.asarray(getattr(alone, name), np.float32)) for name in _DOF_FIELDS}
        rows["geom_friction"][:, 0] *= self._friction
        rows["geom_aabb"] = rows["geom_aabb"].reshape(-1, 2, 3)
        data = mujoco.MjData(alone)
        mujoco.mj_kinematics(alone, data)
        rows["geom_xmat"] = torch.from_numpy(data.geom_xmat.astype(np.float32)).reshape(-1, 3, 3)
        return rows
