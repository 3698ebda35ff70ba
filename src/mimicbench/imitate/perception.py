"""Where is the seat? A small network that reads it off one elevation map, and the memory of it that a policy carries
along.

A seat is six numbers in the heading frame of the robot's root: x, y of its middle [m], sine and cosine of the direction
that it faces, its height above the floor [m] and its depth, front to back [m].

The network looks at a window around whatever rises from the floor, with each cell's place in the robot's frame as two
more channels (what is hidden depends on where one stands), and gives the seat relative to the window. It learns from
maps as the cameras make them, with what they cannot see left out, and from complete ones. Chairs are symmetric and the
four cameras too: turning a map by quarters and mirroring it makes eight of each.

From behind, a back can hide the seat. So the network also says how far off it may be, and SeatMemory, which looks again
while the robot walks, keeps the surest look.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from mimicbench.core.checkpoint import load_checkpoint, save_checkpoint
from mimicbench.core.errors import BadObject
from mimicbench.core.settings import Positive
from mimicbench.objects.shape import SceneObject
from mimicbench.sensors.heightmap import CELL, CELLS

SEAT_SIZE = 6
MEMORY_SIZE = 10
SURE = 0.02
"""[m] Who expects to be off by less than this does not look again."""
_RAISED = 0.12
"""[m] above the floor: what is higher belongs to an object; far above the noise."""
_MIDDLE = (0.0, 0.0, 0.0, 0.0, 0.45, 0.45)
_SPREAD = (0.1, 0.1, 0.4, 0.4, 0.05, 0.06)
"""Middle and spread of the six outputs, so that the network's are near 1, and its loss weighs 2 cm, 0.1 rad and 1 cm of
height about alike."""


@dataclass(frozen=True)
class PerceptionConfig:
    """The network, the maps that it learns from, and how long."""

    window: int = 48
    """Side of the window, in cells: 1.92 m, room for every chair at any angle."""
    widths: tuple[int, ...] = (24, 48, 64)
    """Channels of the three strided convolutions."""
    hidden: int = 128
    """Width of the layer after them."""
    maps: Positive = 8000
    """Maps to learn from, before turning and mirroring."""
    seen: float = 0.7
    """Share of them that show what the cameras see; the others are complete, or hide only what is behind something."""
    distance: tuple[float, float] = (0.5, 2.3)
    """[m] From the object's middle to the robot in the training maps."""
    root_height: tuple[float, float] = (0.85, 1.1)
    """[m] Of the root above the floor in the training maps."""
    tilt: float = 0.03
    """[rad] Deviation of the root's roll and pitch in the training maps."""
    noise: float = 0.01
    """[m] Deviation of each cell's height."""
    dropout: float = 0.03
    """Share of cells without a measurement."""
    steps: Positive = 5000
    """Batches."""
    batch: Positive = 128
    """Maps per batch."""
    learning_rate: float = 2e-3
    """At the start; falls to 0 along a cosine."""
    save_every: float = 120.0
    """Seconds between saves: what a kill can lose at most."""
    threads: int = 2
    """Threads of the network's arithmetic. Sums round differently with another number, so it is part of the result."""
    seed: int = 0
    """Of poses, noise and initial weights."""


class Perception(nn.Module):
    """Windows of elevation maps -> seats; `perceive` takes whole maps."""

    def __init__(self, config: PerceptionConfig) -> None:
        super().__init__()
        self.config = config
        layers: list[nn.Module] = []
        width_in, side = 3, config.window
        for index, width in enumerate(config.widths):
            kernel = 5 if index == 0 else 3
            layers += [nn.Conv2d(width_in, width, kernel, 2, kernel // 2, bias=False), nn.BatchNorm2d(width), nn.ReLU()]
            width_in, side = width, (side + 1) // 2
        layers += [
            nn.Flatten(),
            nn.Linear(width_in * side * side, config.hidden),
            nn.ReLU(),
            nn.Linear(config.hidden, SEAT_SIZE + 1),
        ]
        self.layers = nn.Sequential(*layers)
        self.register_buffer("middle", torch.tensor(_MIDDLE), persistent=False)
        self.register_buffer("spread", torch.tensor(_SPREAD), persistent=False)

    def forward(self, view: Tensor, center: Tensor) -> tuple[Tensor, Tensor]:
        """Seats (N, 6), with directions of any length, and how far off (N,) [m] they are likely to be.

        Args:
            view: (N, window, window) heights above the floor [m].
            center: (N, 2) where the windows' middles are [m].
        """
        place = (torch.arange(view.shape[1], device=view.device) - (view.shape[1] - 1) / 2) * CELL
        x = (center[:, 0, None] + place)[:, :, None].expand_as(view)
        y = (center[:, 1, None] + place)[:, None, :].expand_as(view)
        found = self.layers(torch.stack([view, 0.5 * x, 0.5 * y], 1))
        seat = found[:, :SEAT_SIZE] * self.get_buffer("spread") + self.get_buffer("middle")
        return torch.cat([seat[:, :2] + center, seat[:, 2:]], -1), 0.03 * found[:, SEAT_SIZE].clamp(-3, 3).exp()

    def perceive(self, elevation: Tensor, root_height: Tensor) -> Tensor:
        """Seats (N, 6) as a policy remembers them: the direction has unit length.

        Args:
            elevation: (N, 128, 128) heights relative to the root [m] (see sense.heightmap).
            root_height: (N,) height of the root above the floor [m].
        """
        return self.look(elevation, root_height)[0]

    @torch.no_grad()
    def look(self, elevation: Tensor, root_height: Tensor) -> tuple[Tensor, Tensor]:
        """As `perceive`, and how far off (N,) [m] each seat is likely to be."""
        self.eval()
        seat, doubt = self(*window(elevation + root_height[:, None, None], self.config.window))
        return unit_direction(seat), doubt


def window(height: Tensor, size: int) -> tuple[Tensor, Tensor]:
    """The part (N, size, size) of maps (N, 128, 128) of heights above the floor around what rises from it, and its
    centers (N, 2) [m].
    """
    rows, columns = _window_cells(height, size)
    n = torch.arange(len(height), device=height.device)[:, None, None]
    inside = ((rows >= 0) & (rows < CELLS))[:, :, None] & ((columns >= 0) & (columns < CELLS))[:, None, :]
    view = height[n, rows.clamp(0, CELLS - 1)[:, :, None], columns.clamp(0, CELLS - 1)[:, None, :]]
    center = torch.stack([rows, columns], -1).float().mean(1) - (CELLS - 1) / 2
    return torch.where(inside, view, 0.0), center * CELL


def _window_cells(height: Tensor, size: int) -> tuple[Tensor, Tensor]:
    """Rows and columns (N, size) of the window around the middle of all cells above the floor.

    The map's middle if there are none.
    """
    raised = (height > _RAISED).float()
    count = raised.sum((1, 2))
    index = torch.arange(height.shape[1], device=height.device)
    middle = (height.shape[1] - 1) / 2
    steps = torch.arange(size, device=height.device)
    axes = []
    for profile in (raised.sum(2), raised.sum(1)):
        center = torch.where(count > 0, (profile * index).sum(1) / count.clamp(min=1), middle)
        axes.append(torch.round(center - (size - 1) / 2).long()[:, None] + steps)
    return axes[0], axes[1]


def unit_direction(seat: Tensor) -> Tensor:
    """Seats (N, 6) with the sine and cosine scaled to one direction."""
    length = seat[:, 2:4].norm(dim=-1, keepdim=True).clamp(min=1e-6)
    return torch.cat([seat[:, :2], seat[:, 2:4] / length, seat[:, 4:]], -1)


def seat_of(obj: SceneObject) -> np.ndarray:
    """x, y of the middle of the seat, its height and its depth (4,) [m], in the object's frame, where it faces +x.

    Raises BadObject.
    """
    height = obj.require_seat()
    if not len(obj.seat_polygon):
        raise BadObject(f"object {obj.id} has no outline of its seat; describe it in seat_polygon")
    low, high = obj.seat_polygon.min(0), obj.seat_polygon.max(0)
    return np.array([*(low + high) / 2, height, high[0] - low[0]])


def seat_in_root(seat: Tensor, root_pos: Tensor, root_yaw: Tensor) -> Tensor:
    """Seats (N, 6) in the heading frame, from seats (N, 4) of `seat_of`, root positions (N, 2+) [m] and headings
    (N,) [rad].
    """
    cos, sin = root_yaw.cos(), root_yaw.sin()
    dx, dy = seat[:, 0] - root_pos[:, 0], seat[:, 1] - root_pos[:, 1]
    return torch.stack([cos * dx + sin * dy, cos * dy - sin * dx, -sin, cos, seat[:, 2], seat[:, 3]], -1)


def disturb_seat(seat: Tensor, generator: torch.Generator | None = None) -> Tensor:
    """Seats (N, 6) with errors as perception makes them: 3 cm in x and y, 0.05 rad, 1.2 cm of height, 3 cm of depth."""
    noise = torch.randn(len(seat), 5, generator=generator, device=seat.device, dtype=seat.dtype)
    turn = 0.05 * noise[:, 2]
    sin = seat[:, 2] * turn.cos() + seat[:, 3] * turn.sin()
    cos = seat[:, 3] * turn.cos() - seat[:, 2] * turn.sin()
    xy = seat[:, :2] + 0.03 * noise[:, :2]
    return torch.cat(
        [xy, torch.stack([sin, cos, seat[:, 4] + 0.012 * noise[:, 3], seat[:, 5] + 0.03 * noise[:, 4]], -1)], -1
    )


def seat_memory(seat: Tensor, odometry_pos: Tensor, odometry_yaw: Tensor) -> Tensor:
    """What is remembered (N, 10): the seat (N, 6) as seen at the start, and x, y, sine and cosine of where it is by
    now.

    Args:
        seat: (N, 6) in the heading frame of the start.
        odometry_pos: (N, 2) the root's position in the heading frame of the start, by its own reckoning [m].
        odometry_yaw: (N,) its heading since then [rad].
    """
    cos, sin = odometry_yaw.cos(), odometry_yaw.sin()
    dx, dy = seat[:, 0] - odometry_pos[:, 0], seat[:, 1] - odometry_pos[:, 1]
    now = [
        cos * dx + sin * dy,
        cos * dy - sin * dx,
        seat[:, 2] * cos - seat[:, 3] * sin,
        seat[:, 3] * cos + seat[:, 2] * sin,
    ]
    return torch.cat([seat, torch.stack(now, -1)], -1)


class SeatMemory:
    """What N robots remember of the seat: their surest look at it so far, carried along by odometry."""

    def __init__(self, perception: Perception, robots: int, device: torch.device | str = "cpu") -> None:
        """Nothing is remembered before the first `look` of each robot. `device` is where perception and senses are."""
        self.perception = perception
        self.seat = torch.zeros(robots, SEAT_SIZE, device=device)
        """(N, 6) in the heading frame of each robot's start."""
        self.doubt = torch.full((robots,), torch.inf, device=device)
        """(N,) how far off it may be [m]."""

    def forget(self, ids: Tensor) -> None:
        """Robots `ids` (M,) begin anew."""
        self.doubt[ids] = torch.inf

    def look(
        self, ids: Tensor, elevation: Tensor, root_height: Tensor, odometry_pos: Tensor, odometry_yaw: Tensor
    ) -> None:
        """Robots `ids` (M,) look; who is surer than before remembers what is seen now.

        Args:
            ids: (M,) who looks.
            elevation: (M, 128, 128) their maps [m].
            root_height: (M,) [m].
            odometry_pos: (M, 2) their positions in the heading frame of their start [m].
            odometry_yaw: (M,) their headings since then [rad].
        """
        seen, doubt = self.perception.look(elevation, root_height)
        cos, sin = odometry_yaw.cos(), odometry_yaw.sin()
        x = odometry_pos[:, 0] + cos * seen[:, 0] - sin * seen[:, 1]
        y = odometry_pos[:, 1] + sin * seen[:, 0] + cos * seen[:, 1]
        turned_by = [seen[:, 2] * cos + seen[:, 3] * sin, seen[:, 3] * cos - seen[:, 2] * sin]
        found = torch.cat([torch.stack([x, y, *turned_by], -1), seen[:, 4:]], -1)
        # a little surer is not enough: what is remembered should not jump about
        surer = doubt < 0.7 * self.doubt[ids]
        self.seat[ids] = torch.where(surer[:, None], found, self.seat[ids])
        self.doubt[ids] = torch.where(surer, doubt, self.doubt[ids])

    def doubtful(self, odometry_pos: Tensor, odometry_yaw: Tensor) -> Tensor:
        """(M,) robots that should look again: unsure, and not so near yet that the map shows less than before."""
        now = seat_memory(self.seat, odometry_pos, odometry_yaw)[:, SEAT_SIZE : SEAT_SIZE + 2]
        return torch.nonzero((self.doubt > SURE) & (now.norm(dim=-1) > self.perception.config.distance[0] + 0.1))[:, 0]

    def recall(self, odometry_pos: Tensor, odometry_yaw: Tensor) -> Tensor:
        """The memory (N, 10) of all robots, as `seat_memory`."""
        return seat_memory(self.seat, odometry_pos, odometry_yaw)


def save_perception(folder: Path, net: Perception, robot: str, error: Mapping[str, float] | None = None) -> None:
    """Write a checkpoint of kind `perception`, with its errors on unseen objects, if they were measured."""
    notes = {} if error is None else {"error": dict(error)}
    save_checkpoint(
        folder,
        "perception",
        robot,
        net.config,
        {name: value.cpu().numpy() for name, value in net.state_dict().items()},
        notes,
    )


def load_perception(folder: Path, robot: str) -> Perception:
    """Read what `save_perception` wrote. Raises BadCheckpoint."""
    checkpoint = load_checkpoint(folder, "perception", robot)
    net = Perception(checkpoint.config_as(PerceptionConfig))
    arrays = checkpoint.matching({name: tuple(value.shape) for name, value in net.state_dict().items()})
    net.load_state_dict({name: torch.from_numpy(array.copy()) for name, array in arrays.items()})
    return net.eval()
