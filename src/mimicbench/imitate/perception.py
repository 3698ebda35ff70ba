"""Where is the seat? A small network that reads it off one elevation map, and the memory of it that a policy carries along.

A seat is six numbers in the heading frame of the robot's root: x, y of its middle [m], sine and cosine of the direction
that it faces, its height above the floor [m] and its depth, front to back [m].

The network looks at a window around whatever rises from the floor, with each cell's place in the robot's frame as two
more channels (what is hidden depends on where one stands), and gives the seat relative to the window. It learns from
maps as the cameras make them, with what they cannot see left out, and from complete ones. Chairs are symmetric and the
four cameras too: turning a map by quarters and mirroring it makes eight of each.

From behind, a back can hide the seat. So the network also says how far off it may be, and SeatMemory, which looks again
while the robot walks, keeps the surest look.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from mimicbench.core import rotations as rot
from mimicbench.core.checkpoint import load_checkpoint, save_checkpoint
from mimicbench.core.errors import BadObject
from mimicbench.core.seeds import digest
from mimicbench.objects.shape import SceneObject
from mimicbench.sense.cameras import CameraMaps
from mimicbench.sense.heightmap import CELL, CELLS, ObjectMaps

SEAT_SIZE = 6
MEMORY_SIZE = 10
SURE = 0.02
"""[m] Who expects to be off by less than this does not look again."""
_RAISED = 0.12
"""[m] above the floor: what is higher belongs to an object; far above the noise."""
_MIDDLE = (0.0, 0.0, 0.0, 0.0, 0.45, 0.45)
_SPREAD = (0.1, 0.1, 0.4, 0.4, 0.05, 0.06)
"""Middle and spread of the six outputs, so that the network's are near 1, and its loss weighs 2 cm, 0.1 rad and 1 cm of height about alike."""


@dataclass(frozen=True)
class PerceptionConfig:
    """The network, the maps that it learns from, and how long."""

    window: int = 48
    """Side of the window, in cells: 1.92 m, room for every chair at any angle."""
    widths: tuple[int, ...] = (24, 48, 64)
    """Channels of the three strided convolutions."""
    hidden: int = 128
    """Width of the layer after them."""
    maps: int = 8000
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
    steps: int = 4000
    """Batches."""
    batch: int = 128
    """Maps per batch."""
    learning_rate: float = 2e-3
    """At the start; falls to 0 along a cosine."""
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
        layers += [nn.Flatten(), nn.Linear(width_in * side * side, config.hidden), nn.ReLU(), nn.Linear(config.hidden, SEAT_SIZE + 1)]
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
    """The part (N, size, size) of maps (N, 128, 128) of heights above the floor around what rises from it, and its centers (N, 2) [m]."""
    rows, columns = _window_cells(height, size)
    n = torch.arange(len(height), device=height.device)[:, None, None]
    inside = ((rows >= 0) & (rows < CELLS))[:, :, None] & ((columns >= 0) & (columns < CELLS))[:, None, :]
    view = height[n, rows.clamp(0, CELLS - 1)[:, :, None], columns.clamp(0, CELLS - 1)[:, None, :]]
    center = torch.stack([rows, columns], -1).float().mean(1) - (CELLS - 1) / 2
    return torch.where(inside, view, 0.0), center * CELL


def _window_cells(height: Tensor, size: int) -> tuple[Tensor, Tensor]:
    """Rows and columns (N, size) of the window around the middle of all cells above the floor; the map's middle if there are none."""
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
    """x, y of the middle of the seat, its height and its depth (4,) [m], in the object's frame, where it faces +x. Raises BadObject."""
    height = obj.require_seat()
    if not len(obj.seat_polygon):
        raise BadObject(f"object {obj.id} has no outline of its seat; describe it in seat_polygon")
    low, high = obj.seat_polygon.min(0), obj.seat_polygon.max(0)
    return np.array([*(low + high) / 2, height, high[0] - low[0]])


def seat_in_root(seat: Tensor, root_pos: Tensor, root_yaw: Tensor) -> Tensor:
    """Seats (N, 6) in the heading frame, from seats (N, 4) of `seat_of`, root positions (N, 2+) [m] and headings (N,) [rad]."""
    cos, sin = root_yaw.cos(), root_yaw.sin()
    dx, dy = seat[:, 0] - root_pos[:, 0], seat[:, 1] - root_pos[:, 1]
    return torch.stack([cos * dx + sin * dy, cos * dy - sin * dx, -sin, cos, seat[:, 2], seat[:, 3]], -1)


def disturb_seat(seat: Tensor, generator: torch.Generator | None = None) -> Tensor:
    """Seats (N, 6) with errors as perception makes them: 2 cm in x and y, 0.03 rad, 0.5 cm of height, 2 cm of depth."""
    noise = torch.randn(len(seat), 5, generator=generator, device=seat.device, dtype=seat.dtype)
    turn = 0.03 * noise[:, 2]
    sin = seat[:, 2] * turn.cos() + seat[:, 3] * turn.sin()
    cos = seat[:, 3] * turn.cos() - seat[:, 2] * turn.sin()
    xy = seat[:, :2] + 0.02 * noise[:, :2]
    return torch.cat([xy, torch.stack([sin, cos, seat[:, 4] + 0.005 * noise[:, 3], seat[:, 5] + 0.02 * noise[:, 4]], -1)], -1)


def seat_memory(seat: Tensor, odometry_pos: Tensor, odometry_yaw: Tensor) -> Tensor:
    """What is remembered (N, 10): the seat (N, 6) as seen at the start, and x, y, sine and cosine of where it is by now.

    Args:
        seat: (N, 6) in the heading frame of the start.
        odometry_pos: (N, 2) the root's position in the heading frame of the start, by its own reckoning [m].
        odometry_yaw: (N,) its heading since then [rad].
    """
    cos, sin = odometry_yaw.cos(), odometry_yaw.sin()
    dx, dy = seat[:, 0] - odometry_pos[:, 0], seat[:, 1] - odometry_pos[:, 1]
    now = [cos * dx + sin * dy, cos * dy - sin * dx, seat[:, 2] * cos - seat[:, 3] * sin, seat[:, 3] * cos + seat[:, 2] * sin]
    return torch.cat([seat, torch.stack(now, -1)], -1)


class SeatMemory:
    """What N robots remember of the seat: their surest look at it so far, carried along by odometry."""

    def __init__(self, perception: Perception, robots: int) -> None:
        """Nothing is remembered before the first `look` of each robot."""
        self.perception = perception
        self.seat = torch.zeros(robots, SEAT_SIZE)
        """(N, 6) in the heading frame of each robot's start."""
        self.doubt = torch.full((robots,), torch.inf)
        """(N,) how far off it may be [m]."""

    def forget(self, ids: Tensor) -> None:
        """Robots `ids` (M,) begin anew."""
        self.doubt[ids] = torch.inf

    def look(self, ids: Tensor, elevation: Tensor, root_height: Tensor, odometry_pos: Tensor, odometry_yaw: Tensor) -> None:
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


def draw_maps(config: PerceptionConfig, objects: Sequence[SceneObject], count: int, name: str, seen: float | None = None) -> tuple[Tensor, Tensor, Tensor]:
    """Elevation maps of objects at random poses, without noise, and the seats that they show.

    Args:
        config: Says how far away, from what height and with which seed.
        objects: Each must have a seat.
        count: How many.
        name: Tells these random numbers from those of other sets with the same seed.
        seen: Share of maps by the cameras; by default the configuration's.

    Returns:
        Maps (count, 128, 128) relative to the root [m], root heights (count,) [m] and seats (count, 6).
    """
    g = torch.Generator().manual_seed(digest(config.seed, "perception", name) % (1 << 63))
    index = torch.randint(len(objects), (count,), generator=g)
    uniform = torch.rand(5, count, generator=g)
    distance = config.distance[0] + uniform[0] * (config.distance[1] - config.distance[0])
    bearing, yaw = 2 * math.pi * uniform[1], 2 * math.pi * uniform[2]
    height = config.root_height[0] + uniform[3] * (config.root_height[1] - config.root_height[0])
    pos = torch.stack([distance * bearing.cos(), distance * bearing.sin(), height], -1)
    tilt = torch.cat([config.tilt * torch.randn(count, 2, generator=g), torch.zeros(count, 1)], -1)
    quat = rot.multiply(rot.from_yaw(yaw), rot.from_rotvec(tilt))
    heading = rot.yaw_of(quat)
    by_camera = round(count * (config.seen if seen is None else seen))
    maps = torch.empty(count, CELLS, CELLS)
    cameras = CameraMaps(objects)
    # a sensor with many points per cell shows edges farther out than one that looks at the cells' centers: both are learned
    surfaces = [ObjectMaps(objects), ObjectMaps(objects, spread=CELL / 2)]
    for first in range(0, count, 64):
        part = slice(first, min(first + 64, count))
        if first < by_camera:
            maps[part] = cameras.sample(index[part], pos[part], quat[part])
        else:
            maps[part] = surfaces[first // 64 % 2].sample(index[part], pos[part], heading[part], occlusion=uniform[4, part] < 0.5)
    seats = torch.tensor(np.array([seat_of(obj) for obj in objects]), dtype=torch.float32)[index]
    return maps, height, seat_in_root(seats, pos, heading)


def train_perception(config: PerceptionConfig, objects: Sequence[SceneObject], report: Callable[[int, float], None] | None = None) -> Perception:
    """Learn to see the seats of `objects`; the same seed gives the same network on one thread count.

    Args:
        config: Network, maps and length.
        objects: Training objects; each must have a seat.
        report: Called after each step with its number and loss, for a progress bar.
    """
    views, centers, seats = [], [], []
    for first in range(0, config.maps, 512):
        maps, height, seat = draw_maps(config, objects, min(512, config.maps - first), f"train {first}")
        view, center = window(maps + height[:, None, None], config.window)
        views.append(view)
        centers.append(center)
        seats.append(seat)
    view, center, seat = torch.cat(views), torch.cat(centers), torch.cat(seats)
    g = torch.Generator().manual_seed(digest(config.seed, "perception", "batches") % (1 << 63))
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(digest(config.seed, "perception", "weights") % (1 << 63))
        net = Perception(config)
    optimizer = torch.optim.AdamW(net.parameters(), lr=config.learning_rate, weight_decay=1e-3)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, config.steps)
    spread = net.get_buffer("spread")
    net.train()
    for step in range(config.steps):
        batch = torch.randint(len(view), (config.batch,), generator=g)
        quarters, mirror = (int(torch.randint(limit, (), generator=g)) for limit in (4, 2))
        heights, middle, target = turned(view[batch], center[batch], seat[batch], quarters, bool(mirror))
        heights = torch.where(torch.rand(heights.shape, generator=g) < config.dropout, 0.0, heights)
        heights = heights + config.noise * torch.randn(heights.shape, generator=g)
        found, doubt = net(heights, middle)
        loss = functional.smooth_l1_loss(found / spread, target / spread, beta=0.3)
        # the doubt that minimizes this is the expected distance
        loss = loss + 0.02 * ((found - target)[:, :2].norm(dim=-1).detach() / doubt + doubt.log()).mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
        if report is not None:
            report(step, float(loss.detach()))
    return net.eval()


def turned(view: Tensor, center: Tensor, seat: Tensor, quarters: int, mirror: bool) -> tuple[Tensor, Tensor, Tensor]:
    """Windows, centers and seats as from a robot that sees its left on its right (`mirror`), and then everything turned left by quarters."""
    if mirror:
        view, flip = view.flip(2), torch.tensor([1.0, -1.0])
        center = center * flip
        seat = torch.cat([seat[:, :2] * flip, -seat[:, 2:3], seat[:, 3:]], -1)
    for _ in range(quarters % 4):
        # x, y -> -y, x: the row of a cell becomes its column, counted from the other end of the rows
        view = view.transpose(1, 2).flip(1)
        center = torch.stack([-center[:, 1], center[:, 0]], -1)
        seat = torch.cat([torch.stack([-seat[:, 1], seat[:, 0], seat[:, 3], -seat[:, 2]], -1), seat[:, 4:]], -1)
    return view, center, seat


@dataclass(frozen=True)
class PerceptionError:
    """Root-mean-square errors of perceived seats, medians where a few ambiguous objects would decide."""

    x: float
    """[m] along the robot's heading."""
    y: float
    """[m] across it."""
    yaw: float
    """[rad] median of the absolute error; a square stool has no front."""
    height: float
    """[m]"""
    depth: float
    """[m]"""


def evaluate_perception(net: Perception, objects: Sequence[SceneObject], maps: int = 1000, seed: int = 1) -> PerceptionError:
    """Errors on new maps of `objects`, as the cameras see them, with noise."""
    elevation, height, seat = draw_maps(replace(net.config, seed=seed), objects, maps, "evaluate", seen=1.0)
    noise = torch.Generator().manual_seed(digest(seed, "perception", "evaluation noise") % (1 << 63))
    elevation = elevation + net.config.noise * torch.randn(elevation.shape, generator=noise)
    found = net.perceive(elevation, height)
    rms = ((found - seat) ** 2).mean(0).sqrt().tolist()
    turn = torch.atan2(found[:, 2] * seat[:, 3] - found[:, 3] * seat[:, 2], found[:, 2] * seat[:, 2] + found[:, 3] * seat[:, 3])
    return PerceptionError(rms[0], rms[1], float(turn.abs().median()), rms[4], rms[5])


def save_perception(folder: Path, net: Perception, robot: str, error: PerceptionError | None = None) -> None:
    """Write a checkpoint of kind `perception`."""
    notes = {} if error is None else {"error": error.__dict__}
    save_checkpoint(folder, "perception", robot, net.config, {name: value.numpy() for name, value in net.state_dict().items()}, notes)


def load_perception(folder: Path, robot: str) -> Perception:
    """Read what `save_perception` wrote. Raises BadCheckpoint."""
    checkpoint = load_checkpoint(folder, "perception", robot)
    net = Perception(checkpoint.config_as(PerceptionConfig))
    arrays = checkpoint.matching({name: tuple(value.shape) for name, value in net.state_dict().items()})
    net.load_state_dict({name: torch.from_numpy(array.copy()) for name, array in arrays.items()})
    return net.eval()
