"""What learners are shown of what surrounds robots in demonstrations: maps, less than perfect if that is asked for, or
what the cameras see.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from mimicbench.core import rotations as rot
from mimicbench.imitate.settings.cloning import MapErrors
from mimicbench.imitate.settings.inputs import InputConfig
from mimicbench.objects.shape import SceneObject
from mimicbench.sensors.elevation import ElevationMaps
from mimicbench.sensors.heightmap import MapView, ObjectMaps
from mimicbench.sensors.sight.views import CameraViews
from mimicbench.tasks.task import Task

MapMaker = Callable[[Tensor, Tensor, Tensor, Tensor | None, np.ndarray | None], Tensor]
"""(object index (N,), root position (N, 3) and orientation (N, 4), the object's position and quaternion (N, 7), None
where it stands still at the origin, places (N, 2, 3) that the robot is told, None if it is told none) -> maps
(N, 128, 128) relative to the root [m], or what the cameras see, (N, channels, 128, 128)."""


@dataclass(frozen=True)
class Scenery:
    """What a learner sees of what surrounds it."""

    make: MapMaker
    """Makes the elevation maps, or what the cameras see."""
    errors: MapErrors = field(default_factory=MapErrors)
    """What is wrong with these maps."""

    @staticmethod
    def of(
        scene: Sequence[SceneObject], task: Task, inputs: InputConfig, errors: MapErrors | None = None
    ) -> "Scenery | None":
        """For a learner with these inputs, beside these objects, by their place among them; None if it sees nothing."""
        if not inputs.sees:
            return None
        if inputs.views:
            return Scenery(CameraViews(scene, task.rig).sample)
        make = _by_cameras if inputs.cameras else _from_above
        return Scenery(make(scene, task), errors or MapErrors())


def _by_cameras(scene: Sequence[SceneObject], task: Task) -> MapMaker:
    # one thread: the others learn, or make other batches
    eyes = ElevationMaps(scene, MapView(task.rig, task.map_cell), workers=1)

    def make(
        index: Tensor, root_pos: Tensor, root_quat: Tensor, pose: Tensor | None, places: np.ndarray | None
    ) -> Tensor:
        there = (None, None) if pose is None else (pose[:, :3], pose[:, 3:])
        return eyes.sample(root_pos, root_quat, *there, index)

    return make


def _from_above(scene: Sequence[SceneObject], task: Task) -> MapMaker:
    still, moved = ObjectMaps(scene), ElevationMaps(scene, MapView(None, task.map_cell))

    def make(
        index: Tensor, root_pos: Tensor, root_quat: Tensor, pose: Tensor | None, places: np.ndarray | None
    ) -> Tensor:
        root_yaw = rot.yaw_of(root_quat).float()
        if pose is None:
            return still.sample(index, root_pos, root_yaw, cell=task.map_cell)
        return moved.sample(root_pos, rot.from_yaw(root_yaw), pose[:, :3], pose[:, 3:], index)

    return make


SQUARE = 8
"""Side of the squares that may be missing in a map [cells]."""


def disturbed(maps: Tensor, root_height: Tensor, errors: MapErrors, generator: torch.Generator) -> Tensor:
    """Maps (B, 128, 128), heights relative to roots that are at heights (B,) [m], with errors."""
    count, side = len(maps), maps.shape[-1]
    floor = -root_height[:, None, None]
    if errors.shift:
        by = (errors.shift * torch.randn(2, count, 1, generator=generator)).round().long()
        row, column = ((torch.arange(side) - along)[:, :, None] for along in by)
        column = column.transpose(1, 2)
        there = ((row >= 0) & (row < side)) & ((column >= 0) & (column < side))
        of = torch.arange(count)[:, None, None]
        maps = torch.where(there, maps[of, row.clamp(0, side - 1), column.clamp(0, side - 1)], floor)
    if errors.cells:
        maps = maps + errors.cells * torch.randn(maps.shape, generator=generator)
    if errors.height:
        maps = maps + errors.height * torch.randn(count, 1, 1, generator=generator)
    if errors.missing:
        squares = torch.rand(count, side // SQUARE, side // SQUARE, generator=generator) < errors.missing
        gone = squares.repeat_interleave(SQUARE, 1).repeat_interleave(SQUARE, 2)
        maps = torch.where(gone, floor, maps)
    return maps
