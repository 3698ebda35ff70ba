"""Many objects on one picture, all to the same scale."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from mimicbench.core.errors import MimicbenchError
from mimicbench.drawing.camera import FIELD_OF_VIEW, Camera, Picture
from mimicbench.drawing.opengl import draw_apart
from mimicbench.objects.shape import SceneObject
from mimicbench.report.render import Painter
from mimicbench.report.video import captioned
from mimicbench.robots.registry import DEFAULT_ROBOT, ROBOTS
from mimicbench.sim.scene import ROBOT_GROUP, VISUAL_GROUP, build_model

MOST_OBJECTS = 400
CELL = Picture(220, 200, 2048)
"""One object's part of the sheet."""
FEW = 6


def contact_sheet(
    objects: Sequence[SceneObject], columns: int = 6, cell: Picture = CELL, workers: int = 0, quiet: bool = True
) -> np.ndarray:
    """A picture (H, W, 3), uint8, with one object per cell, seen from the front left, above, and its id.

    Few objects have twice as large cells. Raises NoPictures without OpenGL.
    """
    if len(objects) <= FEW:
        cell = replace(cell, width=2 * cell.width, height=2 * cell.height)
    if not 1 <= len(objects) <= MOST_OBJECTS:
        raise MimicbenchError(f"a sheet holds 1 to {MOST_OBJECTS} objects, not {len(objects)}")
    draw = partial(draw_object, cell, sheet_camera(objects, cell))
    tiles = [
        captioned(tile, obj.id)
        for tile, obj in zip(draw_apart(draw, objects, workers, "drawing", quiet), objects, strict=True)
    ]
    columns = min(columns, len(tiles))
    tiles += [np.full((cell.height, cell.width, 3), 255, np.uint8)] * (-len(tiles) % columns)
    return np.concatenate([np.concatenate(tiles[i : i + columns], 1) for i in range(0, len(tiles), columns)], 0)


def sheet_camera(objects: Sequence[SceneObject], cell: Picture) -> Camera:
    """One camera that sees all of each of them, one by one."""
    corners = np.concatenate([obj.corners().reshape(-1, 3) for obj in objects])
    middle = 0.45 * float(corners[:, 2].max())
    reach = float(np.linalg.norm(corners - [0.0, 0.0, middle], axis=-1).max())
    narrow = np.arctan(np.tan(FIELD_OF_VIEW / 2) * min(1.0, cell.width / cell.height))
    return Camera((0.0, 0.0, middle), reach / float(np.sin(narrow)), 215.0, -22.0)


def draw_object(picture: Picture, camera: Camera, obj: SceneObject) -> np.ndarray:
    """A picture (H, W, 3), uint8, of one object alone."""
    with Painter(build_model(ROBOTS.get(DEFAULT_ROBOT), obj, visuals=True), picture, camera) as painter:
        painter.option.geomgroup[VISUAL_GROUP] = painter.option.geomgroup[ROBOT_GROUP] = 0
        return painter.draw()
