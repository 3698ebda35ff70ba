"""The elevation maps that a robot's cameras would make of known boxes, for many robots at once and without a simulator.

The same rays and the same cells as elevation.camera_map, which casts them into the physical scene. Here only the rays
that can meet the object are followed, so a batch of maps costs little enough to learn from.
"""

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from mimicbench.core import rotations as rot
from mimicbench.objects.shape import SceneObject
from mimicbench.robots.rigs import PELVIS_RIG, Rig
from mimicbench.sensors.elevation_cpu import RANGE
from mimicbench.sensors.heightmap import CELL, CELLS, BoxTable


class CameraMaps:
    """Maps of many objects, each at the origin, as robots beside them see them."""

    def __init__(
        self,
        objects: Sequence[SceneObject],
        height: int = 90,
        width: int = 120,
        device: str | torch.device = "cpu",
        rig: Rig = PELVIS_RIG,
        cell: float = CELL,
    ) -> None:
        """Prepare the rays of the cameras.

        Args:
            objects: What `object_index` of `sample` counts.
            height: Rows of pixels of each camera.
            width: Columns of pixels of each camera.
            device: Where the maps are made.
            rig: The cameras.
            cell: Side of a cell [m].
        """
        self.device = torch.device(device)
        self.boxes = BoxTable(objects, self.device)
        self._cell = cell
        corners = [obj.bounds() for obj in objects]
        self._center = torch.tensor(
            np.array([(low + high) / 2 for low, high in corners]), dtype=torch.float32, device=self.device
        )
        self._radius = torch.tensor(
            [float(np.linalg.norm(high - low)) / 2 for low, high in corners], device=self.device
        )
        rays = rig.rays(height, width).reshape(len(rig.mounts), -1, 3)
        self._rays = torch.from_numpy(rays.astype(np.float32)).to(self.device)
        self._units = self._rays / self._rays.norm(dim=-1, keepdim=True)
        self._origins = torch.from_numpy(rig.origins().astype(np.float32)).to(self.device)

    def sample(self, object_index: Tensor, root_pos: Tensor, root_quat: Tensor) -> Tensor:
        """Maps (N, 128, 128), heights relative to the root [m]; cells without a point are at floor level.

        Args:
            object_index: (N,) which object, as an index into the list.
            root_pos: (N, 3) position of the root in the world [m].
            root_quat: (N, 4) its orientation, wxyz; the cameras tilt with it.
        """
        root_pos, root_quat, cameras = root_pos.float(), root_quat.float(), len(self._origins)
        maps = (-root_pos[:, 2])[:, None].expand(len(root_pos), CELLS * CELLS).contiguous()
        eye = root_pos[:, None] + rot.rotate(root_quat[:, None], self._origins[None])
        # a ray can meet the object if it is within the cone around its bounding sphere
        to_object = self._center[object_index, None] - eye
        distance, radius = to_object.norm(dim=-1), self._radius[object_index, None]
        cone = torch.where(distance > radius, (1 - (radius / distance.clamp(min=1e-6)).clamp(max=1) ** 2).sqrt(), -1.0)
        axis = rot.rotate_inverse(root_quat[:, None], to_object / distance.clamp(min=1e-6)[..., None])
        n, camera, ray = torch.nonzero(
            torch.einsum("nck,crk->ncr", axis, self._units) >= cone[..., None], as_tuple=True
        )
        direction = rot.rotate(root_quat[n], self._rays[camera, ray])
        depth = self.boxes.first_hit(
            object_index.repeat_interleave(cameras), eye.view(-1, 3), direction, n * cameras + camera
        )
        hit = depth < RANGE
        n, camera = n[hit], camera[hit]
        offset = eye[n, camera] - root_pos[n] + direction[hit] * depth[hit, None]
        yaw = rot.yaw_of(root_quat)
        cos, sin = yaw.cos()[n], yaw.sin()[n]
        x, y = cos * offset[:, 0] + sin * offset[:, 1], cos * offset[:, 1] - sin * offset[:, 0]
        row, column = torch.floor(x / self._cell + CELLS / 2).long(), torch.floor(y / self._cell + CELLS / 2).long()
        inside = (row >= 0) & (row < CELLS) & (column >= 0) & (column < CELLS)
        flat = (n * (CELLS * CELLS) + row * CELLS + column)[inside]
        return maps.view(-1).scatter_reduce(0, flat, offset[inside, 2], "amax").view(-1, CELLS, CELLS)
