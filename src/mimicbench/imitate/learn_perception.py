"""Learning to see a task's goal: maps of objects from random places, turned and mirrored, and the errors on new ones.

Objects that look alike from several sides have several right answers; the loss takes the one that is nearest to what
the network says, of those that face the robot, so that it need not tell what nobody can.
"""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import msgspec
import numpy as np
import torch
from torch import Tensor

from mimicbench.core import rotations as rot
from mimicbench.core.checkpoint import CONFIG, load_checkpoint
from mimicbench.core.progress import counter
from mimicbench.core.seeds import digest, rng
from mimicbench.core.training import NetworkState, OptimizerState, append_metrics, resume_training, save_training
from mimicbench.imitate.perception import Perception, save_perception, turned, window
from mimicbench.imitate.settings.perception import PerceptionConfig
from mimicbench.objects.shape import SceneObject
from mimicbench.objects.stretch import stretched
from mimicbench.objects.symmetry import MOTIONS
from mimicbench.robots.description import Robot
from mimicbench.robots.rigs import Rig
from mimicbench.sensors.cameras import CameraMaps
from mimicbench.sensors.heightmap import CELLS, ObjectMaps
from mimicbench.tasks.task import Task

CLEAR = 0.2
"""[m] A robot that looks is at least so far from the object's outline."""

JUDGED = 1000
"""Maps that errors are measured on."""

LOG = 50
"""Batches per line of metrics."""


@dataclass(frozen=True)
class MapBatch:
    """Elevation maps of objects at random poses, without noise, and what is to be found in them."""

    maps: Tensor
    """(N, 128, 128) relative to the root [m]."""
    root_height: Tensor
    """(N,) [m]."""
    answers: Tensor
    """(N, A, G) all right answers, in the heading frames."""


@dataclass(frozen=True)
class Sights:
    """Objects, and what makes maps of them."""

    objects: Sequence[SceneObject]
    """Each must have a goal."""
    cameras: CameraMaps
    surfaces: tuple[ObjectMaps, ObjectMaps]
    """A sensor with many points per cell shows edges farther out than one that looks at the cells' centers: both."""
    answers: Tensor
    """(N, A, G) all right answers, in the objects' frames."""

    @staticmethod
    def of(task: Task, objects: Sequence[SceneObject]) -> "Sights":
        """By the task's cameras, and in its cells."""
        cameras = CameraMaps(objects, rig=task.rig, cell=task.map_cell)
        surfaces = ObjectMaps(objects), ObjectMaps(objects, spread=task.map_cell / 2)
        return Sights(objects, cameras, surfaces, task.goal.labels(objects))


def draw_maps(
    config: PerceptionConfig, task: Task, sights: Sights, count: int, name: str, seen: float | None = None
) -> MapBatch:
    """Maps of objects at random poses from which one of the robot's cameras looks towards them.

    Args:
        config: Says how far away, from what height and with which seed.
        task: Says what is looked for, by which cameras, in what map.
        sights: Of which objects.
        count: How many.
        name: Tells these random numbers from those of other sets with the same seed.
        seen: Share of maps by the cameras; by default the configuration's.
    """
    g = torch.Generator().manual_seed(digest(config.seed, "perception", name) % (1 << 63))
    objects = sights.objects
    index = torch.randint(len(objects), (count,), generator=g)
    uniform = torch.rand(5, count, generator=g)
    bearing = 2 * math.pi * uniform[1]
    distance = _distances(config, objects, index, bearing, uniform[0])
    height = config.root_height[0] + uniform[3] * (config.root_height[1] - config.root_height[0])
    pos = torch.stack([distance * bearing.cos(), distance * bearing.sin(), height], -1)
    tilt = torch.cat([config.tilt * torch.randn(count, 2, generator=g), torch.zeros(count, 1)], -1)
    quat = rot.multiply(rot.from_yaw(_headings(task.rig, bearing + math.pi, uniform[2])), rot.from_rotvec(tilt))
    heading = rot.yaw_of(quat)
    by_camera = round(count * (config.seen if seen is None else seen))
    maps = torch.empty(count, CELLS, CELLS)
    for first in range(0, count, 64):
        part = slice(first, min(first + 64, count))
        if first < by_camera:
            maps[part] = sights.cameras.sample(index[part], pos[part], quat[part])
        else:
            maps[part] = sights.surfaces[first // 64 % 2].sample(
                index[part], pos[part], heading[part], cell=task.map_cell, occlusion=uniform[4, part] < 0.5
            )
    return MapBatch(maps, height, task.goal.to_root(sights.answers[index], pos[:, None], heading[:, None]))


def _distances(
    config: PerceptionConfig, objects: Sequence[SceneObject], index: Tensor, bearing: Tensor, share: Tensor
) -> Tensor:
    """(N,) from the objects' origins to robots in the direction `bearing`, clear of the objects' outlines [m]."""
    corners = torch.tensor(np.array([np.array(obj.bounds())[:, :2] for obj in objects])).float()[index]
    way = torch.stack([bearing.cos(), bearing.sin()], -1)
    edge = torch.where(way > 0, corners[:, 1] / way.clamp(min=1e-6), corners[:, 0] / way.clamp(max=-1e-6)).amin(-1)
    nearest = (edge + CLEAR).clamp(min=config.distance[0])
    farthest = torch.maximum(nearest + 1.0, torch.tensor(config.distance[1]))
    return nearest + share * (farthest - nearest)


def _headings(rig: Rig, towards: Tensor, share: Tensor) -> Tensor:
    """(N,) headings of robots that see, by one of their cameras, what is in the direction `towards` (N,) [rad]."""
    views = torch.tensor(rig.views()).float()
    camera = (share * len(views)).long().clamp(max=len(views) - 1)
    within = share * len(views) - camera
    return towards - (views[camera, 0] + within * (views[camera, 1] - views[camera, 0]))


def train_perception(
    folder: Path,
    config: PerceptionConfig,
    task: Task,
    objects: Sequence[SceneObject],
    report: Callable[[int, float], None] | None = None,
) -> Perception:
    """Learn to find a task's goal beside `objects`; the same seed gives the same network.

    A killed training goes on from `<folder>/training.safetensors`.

    Args:
        folder: Where the training's state goes.
        config: Network, maps and length.
        task: What is to be found.
        objects: Training objects; each must have a goal.
        report: Called with how many more batches are done, and the loss, for a progress bar.

    Raises MimicbenchError if there is nothing to find in the task.
    """
    torch.set_num_threads(config.threads)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(digest(config.seed, "perception", "weights") % (1 << 63))
        # convolutions of few channels take two thirds of the time that way
        net = Perception(config, task).to(memory_format=torch.channels_last)
    view, center, answers = _windows(net, task, objects)
    optimizer = torch.optim.AdamW(net.parameters(), lr=config.learning_rate, weight_decay=1e-3)
    parts = {"network": NetworkState(net), "optimizer": OptimizerState(optimizer)}
    plain = msgspec.to_builtins(asdict(config))
    identity = {"config": {name: value for name, value in plain.items() if name != "save_every"}, "task": task.name}
    identity["objects"] = [obj.id for obj in objects]
    progress = resume_training(folder, identity, parts, {"step": 0, "seconds": 0.0})
    net.train()
    if report is not None and progress["step"]:
        report(int(progress["step"]), 0.0)
    now = saved = time.monotonic()
    for step in range(int(progress["step"]), config.steps):
        for group in optimizer.param_groups:
            group["lr"] = config.learning_rate * 0.5 * (1 + math.cos(math.pi * step / config.steps))
        heights, middle, right = _batch(config, task, view, center, answers, step)
        found, uncertainty, likely = net(heights, middle)
        loss = goal_loss(net, found, uncertainty, likely, right)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        progress = {"step": step + 1, "seconds": progress["seconds"] + time.monotonic() - now}
        now = time.monotonic()
        if (step + 1) % LOG == 0:
            append_metrics(folder, {**progress, "loss": float(loss.detach())})
        if now - saved > config.save_every:
            save_training(folder, identity, parts, progress)
            saved = now
        if report is not None:
            report(1, float(loss.detach()))
    return net.eval()


def of_other_heights(config: PerceptionConfig, objects: Sequence[SceneObject]) -> list[SceneObject]:
    """Each object with its heights times a random number, where the configuration says so; none where it does not."""
    if config.heights == (1.0, 1.0):
        return []
    factors = [rng(config.seed, "heights", obj.id).uniform(*config.heights) for obj in objects]
    return [
        stretched(obj, f"{obj.id}~h{factor:.4f}", np.array([1.0, 1.0, factor]))
        for obj, factor in zip(objects, factors, strict=True)
    ]


def _windows(net: Perception, task: Task, objects: Sequence[SceneObject]) -> tuple[Tensor, Tensor, Tensor]:
    """What the network learns from: windows (N, W, W), their centers (N, 2) and right answers (N, A, G)
    that face the robot.
    """
    views, centers, answers = [], [], []
    sights = Sights.of(task, [*objects, *of_other_heights(net.config, objects)])
    for first in range(0, net.config.maps, 512):
        drawn = draw_maps(net.config, task, sights, min(512, net.config.maps - first), f"train {first}")
        view, center = window(drawn.maps + drawn.root_height[:, None, None], net.window, net.cell)
        views.append(view)
        centers.append(center)
        answers.append(task.goal.facing(drawn.answers))
    return torch.cat(views), torch.cat(centers), torch.cat(answers)


def _batch(
    config: PerceptionConfig, task: Task, view: Tensor, center: Tensor, answers: Tensor, step: int
) -> tuple[Tensor, Tensor, Tensor]:
    """Some of all windows, their centers and right answers, all moved alike, with what sensors add and leave out.

    Its random numbers follow from the batch's number, so that a killed training draws the same ones.
    """
    g = torch.Generator().manual_seed(digest(config.seed, "perception", "batch", step) % (1 << 63))
    batch = torch.randint(len(view), (config.batch,), generator=g)
    quarters, mirror = (int(torch.randint(limit, (), generator=g)) for limit in (task.rig.quarters(), 2))
    motion = MOTIONS[quarters + 4 * mirror]
    heights, middle = turned(view[batch], center[batch], motion)
    heights = torch.where(torch.rand(heights.shape, generator=g) < config.dropout, 0.0, heights)
    heights = heights + config.noise * torch.randn(heights.shape, generator=g)
    return heights, middle, task.goal.transformed(answers[batch], motion)


def goal_loss(net: Perception, found: Tensor, uncertainty: Tensor, likely: Tensor, answers: Tensor) -> Tensor:
    """The negative logarithm of how likely the mixture of H hypotheses says the nearest of the right answers (N, A, G)
    is, for each number of the goal, and the error of the uncertainties.

    Args:
        net: Of which network.
        found: (N, H, G) goals.
        uncertainty: (N, H) how far off they are expected to be [m].
        likely: (N, H) logarithms of their shares.
        answers: (N, A, G).
    """
    target = net.goal.nearest(found.detach(), answers)
    evidence = likely - net.unlike(found, target)
    total = evidence.logsumexp(-1)
    # the uncertainty that minimizes this is the expected distance, of hypotheses that are right
    off = (found - target)[..., net.goal.where].norm(dim=-1).detach()
    right = (evidence - total[:, None]).exp().detach()
    return -total.mean() / net.goal.size + 0.02 * (right * (off / uncertainty + uncertainty.log())).sum(-1).mean()


def evaluate_perception(
    net: Perception, task: Task, objects: Sequence[SceneObject], maps: int = JUDGED, seed: int = 1
) -> dict[str, float]:
    """Median errors on new maps of `objects`, as the cameras see them, with noise, by name of the goal's field.

    [m], of directions [rad]; of several right answers the nearest counts.
    """
    drawn = draw_maps(replace(net.config, seed=seed), task, Sights.of(task, objects), maps, "evaluate", seen=1.0)
    noise = torch.Generator().manual_seed(digest(seed, "perception", "evaluation noise") % (1 << 63))
    elevation = drawn.maps + net.config.noise * torch.randn(drawn.maps.shape, generator=noise)
    found = net.perceive(elevation, drawn.root_height)
    errors = net.goal.errors(found, net.goal.nearest(found, drawn.answers))
    return {name: float(error.median()) for name, error in errors.items()}


def make_perception(
    folder: Path,
    task: Task,
    robot: Robot,
    objects: Sequence[SceneObject],
    held_out: Sequence[SceneObject],
    config: PerceptionConfig,
    quiet: bool,
) -> dict[str, float]:
    """Learn to find a task's goal beside `objects` in elevation maps; `held_out` measures how well, if there are any.
    What is there is not learned again. Returns the errors on those, if they were measured.
    """
    if (folder / CONFIG).exists():
        return dict(load_checkpoint(folder, "perception", robot.name).notes.get("error", {}))
    with counter(config.steps, "perception", quiet) as tick:
        network = train_perception(
            folder, config, task, objects, lambda batches, loss: tick(batches, f"loss {loss:.3f}")
        )
    # drawing a map costs as much to judge as to learn: who learns from a few is judged by as few
    error = evaluate_perception(network, task, held_out, min(JUDGED, config.maps)) if held_out else None
    save_perception(folder, network, robot.name, error)
    return error or {}
