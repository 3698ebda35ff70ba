"""Elevation maps computed from an object's boxes, without rendering.

A map is a square of cells in the robot's heading frame (origin at the root, x along its heading, z up), with the robot
in the middle. The row index grows along +x (forward is down, as in the paper's maps), the column index along +y (left):
cell (i, j) is centred at x = (i - (cells - 1) / 2) cell and y = (j - (cells - 1) / 2) cell. Its value is the height of
the surface there relative to the root [m]; where nothing is, or nothing can be seen, it is the floor's.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from scipy import ndimage
from torch import Tensor

from mimicbench.core import rotations as rot
from mimicbench.objects.heights import surface_height
from mimicbench.objects.shape import SceneObject
from mimicbench.robots.rigs import HEIGHT, PELVIS_RIG, WIDTH, Rig

CELLS = 128
CELL = 0.04
"""[m]; 128 cells of 4 cm are the paper's maps for all tasks but touch-points."""
SMALL = 90, 120
"""[px] Rows and columns of cameras whose pictures are only to fill cells of 4 cm."""
BLIND = 0.06
"""[m] at the end of a line of sight that may lie inside the object: the front of a thin wall is in the same cell as its
top."""


@dataclass(frozen=True)
class MapView:
    """How a map is looked at, and how fine it is."""

    rig: Rig | None = PELVIS_RIG
    """The cameras whose pixels' lines of sight raise cells; None: vertical rays through the cells' centers."""
    cell: float = CELL
    """Side of a cell [m]."""
    size: tuple[int, int] | None = None
    """Rows and columns of the cameras' pictures [px]; None: 90 and 120, and for cells smaller than 4 cm the paper's
    360 and 480, so that few cells are between the pixels."""

    @property
    def pixels(self) -> tuple[int, int]:
        """Rows and columns of the cameras' pictures."""
        return self.size or (SMALL if self.cell >= CELL else (HEIGHT, WIDTH))


def cell_centers(cells: int = CELLS, cell: float = CELL) -> np.ndarray:
    """(cells,) coordinates of the cells' centres along either axis [m]."""
    return (np.arange(cells) - (cells - 1) / 2) * cell


def box_heightmap(
    obj: SceneObject, root_pos: np.ndarray, root_yaw: float, cells: int = CELLS, cell: float = CELL
) -> np.ndarray:
    """The map (cells, cells) of an object at the origin, exact at the cells' centres and without occlusion.

    Args:
        obj: The object; its boxes may be tilted.
        root_pos: (3,) position of the robot's root in the world [m].
        root_yaw: Heading of the root [rad].
        cells: Cells along either side.
        cell: Side of a cell [m].
    """
    x, y = np.meshgrid(cell_centers(cells, cell), cell_centers(cells, cell), indexing="ij")
    c, s = np.cos(root_yaw), np.sin(root_yaw)
    world = np.stack([root_pos[0] + c * x - s * y, root_pos[1] + s * x + c * y], -1)
    return surface_height(obj, world) - root_pos[2]


class BoxTable:
    """The boxes of many objects, each object at the origin, for casting rays at them."""

    def __init__(self, objects: Sequence[SceneObject], device: torch.device) -> None:
        self.device = device
        self._axes, self._start, self._half = [], [], []
        for obj in objects:
            # columns: first axis of all boxes, second axis of all boxes, third axis of all boxes
            axes = rot.to_matrix(obj.box_quat).transpose(1, 2, 0).reshape(3, -1)
            self._axes.append(self._tensor(axes))
            self._start.append(self._tensor(-np.einsum("bij,bi->jb", rot.to_matrix(obj.box_quat), obj.box_pos)))
            self._half.append(self._tensor(obj.box_half.T))

    def _tensor(self, array: np.ndarray) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(array, dtype=np.float32)).to(self.device)

    def first_hit(self, object_index: Tensor, eye: Tensor, direction: Tensor, n: Tensor) -> Tensor:
        """How many lengths of its direction each ray goes before it meets the object; infinity if it never does.

        Args:
            object_index: (N,) the object beside each robot.
            eye: (N, 3) where the robot's rays start, in the world.
            direction: (M, 3) of the rays, in the world.
            n: (M,) the robot that each ray belongs to, in ascending order.
        """
        nearest = direction.new_full((len(n),), torch.inf)
        ends = torch.cumsum(torch.bincount(n, minlength=len(eye)), 0).tolist()
        # robot by robot: its rays against all boxes of its object fit into the cache
        for robot, (first, end) in enumerate(zip([0, *ends[:-1]], ends, strict=True)):
            if first == end:
                continue
            index = int(object_index[robot])
            axes, half = self._axes[index], self._half[index]
            start = self._start[index] + (eye[robot] @ axes).view(3, -1)
            along = direction[first:end] @ axes
            inverse = 1 / torch.where(along.abs() < 1e-7, 1e-7, along).view(end - first, 3, -1)
            middle, reach = -start * inverse, half * inverse.abs()
            enter, leave = (middle - reach).unbind(1), (middle + reach).unbind(1)
            entered = torch.maximum(torch.maximum(enter[0], enter[1]), enter[2])
            left = torch.minimum(torch.minimum(leave[0], leave[1]), leave[2])
            depth = torch.where((entered <= left) & (left > 0), entered.clamp(min=0), torch.inf)
            nearest[first:end] = depth.amin(1)
        return nearest


class ObjectMaps:
    """Many maps of many objects, fast: each object's surface is kept at 1 cm and looked up under the cells.

    Heights are then right to the object's slope times half a centimetre, and edges to half a centimetre.
    """

    def __init__(
        self,
        objects: Sequence[SceneObject],
        spread: float = 0.0,
        device: str | torch.device = "cpu",
        fine: float = 0.01,
    ) -> None:
        """Sample the objects' surfaces.

        Args:
            objects: What `object_index` of `sample` counts.
            spread: Widen every surface by this much [m]. A map made of many points keeps the highest point of each
                cell, and so shows an edge up to half a cell farther out than the cells' centres do.
            device: Where the maps are made.
            fine: Side of the cells of the stored surfaces [m].
        """
        surfaces, lows, sizes, radii = [], [], [], []
        margin = spread + 2 * fine
        for obj in objects:
            low, high = obj.bounds()
            size = np.ceil((high - low)[:2] / fine + 2 * margin / fine).astype(int)
            low = low[:2] - margin
            axes = [low[i] + (np.arange(size[i]) + 0.5) * fine for i in range(2)]
            surface = surface_height(obj, np.stack(np.meshgrid(*axes, indexing="ij"), -1))
            if spread > 0:
                reach = round(spread / fine)
                steps = np.arange(-reach, reach + 1)
                surface = ndimage.grey_dilation(surface, footprint=np.hypot(*np.meshgrid(steps, steps)) <= reach + 0.5)
            surfaces.append(surface.astype(np.float32).ravel())
            lows.append(low)
            sizes.append(size)
            radii.append(np.hypot(*np.maximum(abs(low), abs(low + size * fine))))
        self.fine = fine
        self.device = torch.device(device)
        self._surface = torch.from_numpy(np.concatenate(surfaces)).to(self.device)
        self._start = torch.tensor(np.cumsum([0] + [len(s) for s in surfaces[:-1]]), device=self.device)
        self._low = torch.tensor(np.array(lows), dtype=torch.float32, device=self.device)
        self._size = torch.tensor(np.array(sizes), device=self.device)
        self._radius = float(max(radii))
        self._boxes = BoxTable(objects, self.device)

    def sample(
        self,
        object_index: Tensor,
        root_pos: Tensor,
        root_yaw: Tensor,
        cells: int = CELLS,
        cell: float = CELL,
        occlusion: bool | Tensor = False,
    ) -> Tensor:
        """Maps (N, cells, cells) of N robots, each beside its own object at the origin.

        Args:
            object_index: (N,) which object, as an index into the list.
            root_pos: (N, 3) position of the root in the world [m].
            root_yaw: (N,) heading [rad].
            cells: Cells along either side.
            cell: Side of a cell [m].
            occlusion: Whether surfaces that the root cannot see in a straight line are left out; (N,) or for all.
        """
        count = len(object_index)
        root_pos, root_yaw = root_pos.float(), root_yaw.float()
        maps = (-root_pos[:, 2])[:, None, None].expand(count, cells, cells).contiguous()
        cos, sin = root_yaw.cos(), root_yaw.sin()
        # only a window of cells around the object can differ from the floor
        window = min(cells, 2 * int(np.ceil(self._radius / cell)) + 2)
        center = torch.stack(
            [-cos * root_pos[:, 0] - sin * root_pos[:, 1], sin * root_pos[:, 0] - cos * root_pos[:, 1]], -1
        )
        first = torch.round(center / cell + (cells - window) / 2).long()
        steps = torch.arange(window, device=self.device)
        rows, columns = first[:, 0, None] + steps, first[:, 1, None] + steps
        middle = (cells - 1) / 2
        x, y = ((rows - middle) * cell)[:, :, None], ((columns - middle) * cell)[:, None, :]
        cos, sin = cos[:, None, None], sin[:, None, None]
        world_x, world_y = (
            root_pos[:, 0, None, None] + cos * x - sin * y,
            root_pos[:, 1, None, None] + sin * x + cos * y,
        )
        height = self._lookup(object_index, world_x, world_y)
        inside = ((rows >= 0) & (rows < cells))[:, :, None] & ((columns >= 0) & (columns < cells))[:, None, :]
        n, i, j = torch.nonzero((height > 0) & inside, as_tuple=True)
        height, world_x, world_y = height[n, i, j], world_x[n, i, j], world_y[n, i, j]
        if occlusion is not False:
            ray = torch.stack([world_x, world_y, height], -1) - root_pos[n]
            seen = self._boxes.first_hit(object_index, root_pos, ray, n) > 1 - BLIND / ray.norm(dim=-1).clamp(
                min=2 * BLIND
            )
            if isinstance(occlusion, Tensor):
                seen |= ~occlusion[n]
            n, i, j, height = n[seen], i[seen], j[seen], height[seen]
        maps[n, rows[n, i], columns[n, j]] = height - root_pos[n, 2]
        return maps

    def _lookup(self, object_index: Tensor, x: Tensor, y: Tensor) -> Tensor:
        """Height (N, W, W) above the floor of the surface under world points."""
        low, size, start = self._low[object_index], self._size[object_index], self._start[object_index]
        i = torch.floor((x - low[:, 0, None, None]) / self.fine).long()
        j = torch.floor((y - low[:, 1, None, None]) / self.fine).long()
        lengths, widths = size[:, 0, None, None], size[:, 1, None, None]
        inside = (i >= 0) & (i < lengths) & (j >= 0) & (j < widths)
        flat = start[:, None, None] + i * widths + j
        return torch.where(inside, self._surface[torch.where(inside, flat, 0)], 0.0)
