"""Learning to see seats: maps of objects from random places, turned and mirrored, and the errors on new ones."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from mimicbench.core import rotations as rot
from mimicbench.core.seeds import digest
from mimicbench.imitate.perception import Perception, PerceptionConfig, seat_in_root, seat_of, window
from mimicbench.imitate.resume import resume_training, save_training
from mimicbench.objects.shape import SceneObject
from mimicbench.sensors.cameras import CameraMaps
from mimicbench.sensors.heightmap import CELL, CELLS, ObjectMaps, surface_height


def draw_maps(
    config: PerceptionConfig, objects: Sequence[SceneObject], count: int, name: str, seen: float | None = None
) -> tuple[Tensor, Tensor, Tensor]:
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
    # a sensor with many points per cell shows edges farther out than one that looks at the cells' centers: both are
    # learned
    surfaces = [ObjectMaps(objects), ObjectMaps(objects, spread=CELL / 2)]
    for first in range(0, count, 64):
        part = slice(first, min(first + 64, count))
        if first < by_camera:
            maps[part] = cameras.sample(index[part], pos[part], quat[part])
        else:
            maps[part] = surfaces[first // 64 % 2].sample(
                index[part], pos[part], heading[part], occlusion=uniform[4, part] < 0.5
            )
    seats = torch.tensor(np.array([seat_of(obj) for obj in objects]), dtype=torch.float32)[index]
    alike = torch.tensor([looks_alike_turned(obj) for obj in objects])[index]
    return maps, height, facing_viewer(seat_in_root(seats, pos, heading), alike)


def looks_alike_turned(obj: SceneObject) -> bool:
    """Whether an object turned by half a circle shows the same heights from above, as a stool does: its front is
    then anybody's guess.
    """
    low, high = obj.bounds()
    reach = np.maximum(high, -low)[:2]
    grid = np.stack(np.meshgrid(*(np.arange(-r, r + 1e-9, r / 20) for r in reach), indexing="ij"), -1).reshape(-1, 2)
    same = np.abs(surface_height(obj, grid) - surface_height(obj, -grid)) < 0.02
    return bool(same.mean() > 0.95)


def facing_viewer(seat: Tensor, alike: Tensor) -> Tensor:
    """Seats (N, 6) in the viewer's heading frame.

    Those that are `alike` (N,) bool from both sides face the side that the viewer is on.

    To sit down it does not matter which side is called the front, but that the seat has one: the mean of two guesses is
    a third direction.
    """
    away = (seat[:, 0] * seat[:, 3] + seat[:, 1] * seat[:, 2]) > 0
    sign = torch.where(alike & away, -1.0, 1.0)
    return torch.cat([seat[:, :2], seat[:, 2:4] * sign[:, None], seat[:, 4:]], -1)


def train_perception(
    folder: Path,
    config: PerceptionConfig,
    objects: Sequence[SceneObject],
    report: Callable[[int, float], None] | None = None,
) -> Perception:
    """Learn to see the seats of `objects`; the same seed gives the same network.

    A killed training goes on from `<folder>/training.*`.

    Args:
        folder: Where the training's state goes.
        config: Network, maps and length.
        objects: Training objects; each must have a seat.
        report: Called with how many more batches are done, and the loss, for a progress bar.
    """
    torch.set_num_threads(config.threads)
    views, centers, seats = [], [], []
    for first in range(0, config.maps, 512):
        maps, height, seat = draw_maps(config, objects, min(512, config.maps - first), f"train {first}")
        view, center = window(maps + height[:, None, None], config.window)
        views.append(view)
        centers.append(center)
        seats.append(seat)
    view, center, seat = torch.cat(views), torch.cat(centers), torch.cat(seats)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(digest(config.seed, "perception", "weights") % (1 << 63))
        net = Perception(config)
    optimizer = torch.optim.AdamW(net.parameters(), lr=config.learning_rate, weight_decay=1e-3)
    progress = resume_training(folder, net, optimizer, {"step": 0, "seconds": 0.0})
    spread = net.get_buffer("spread")
    net.train()
    if report is not None and progress["step"]:
        report(int(progress["step"]), 0.0)
    now = saved = time.monotonic()
    for step in range(int(progress["step"]), config.steps):
        for group in optimizer.param_groups:
            group["lr"] = config.learning_rate * 0.5 * (1 + math.cos(math.pi * step / config.steps))
        # its random numbers follow from a batch's number, so that a killed training draws the same ones
        g = torch.Generator().manual_seed(digest(config.seed, "perception", "batch", step) % (1 << 63))
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
        progress = {"step": step + 1, "seconds": progress["seconds"] + time.monotonic() - now}
        now = time.monotonic()
        if now - saved > config.save_every:
            save_training(folder, net, optimizer, progress)
            saved = now
        if report is not None:
            report(1, float(loss.detach()))
    return net.eval()


def turned(view: Tensor, center: Tensor, seat: Tensor, quarters: int, mirror: bool) -> tuple[Tensor, Tensor, Tensor]:
    """Windows, centers and seats as from a robot that sees its left on its right (`mirror`), and then everything
    turned left by quarters.
    """
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


def evaluate_perception(
    net: Perception, objects: Sequence[SceneObject], maps: int = 1000, seed: int = 1
) -> PerceptionError:
    """Errors on new maps of `objects`, as the cameras see them, with noise."""
    elevation, height, seat = draw_maps(replace(net.config, seed=seed), objects, maps, "evaluate", seen=1.0)
    noise = torch.Generator().manual_seed(digest(seed, "perception", "evaluation noise") % (1 << 63))
    elevation = elevation + net.config.noise * torch.randn(elevation.shape, generator=noise)
    found = net.perceive(elevation, height)
    rms = ((found - seat) ** 2).mean(0).sqrt().tolist()
    turn = torch.atan2(
        found[:, 2] * seat[:, 3] - found[:, 3] * seat[:, 2], found[:, 2] * seat[:, 2] + found[:, 3] * seat[:, 3]
    )
    return PerceptionError(rms[0], rms[1], float(turn.abs().median()), rms[4], rms[5])
