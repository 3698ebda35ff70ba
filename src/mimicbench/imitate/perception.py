"""Where is what the task is done with? A small network that reads a task's goal off one elevation map.

What a goal consists of, the task says (`tasks.goal`); it is found in the heading frame of the robot's root.

The network looks at a window around whatever rises from the floor, with each cell's place in the robot's frame as two
more channels (what is hidden depends on where one stands), and gives the goal relative to the window. It learns from
maps as the cameras make them, with what they cannot see left out, and from complete ones.

Part of what is to be found can be hidden. So the network also says how far off it may be, and imitate.goals,
which looks again while the robot walks, keeps the surest look.

And part of it can be in doubt: of a block without a back the edges are plain, but hardly which of them is its front.
One answer would be a mean of several that are each possible, turned by half of a quarter and true of none. So the
network gives several goals, and how likely each is (a mixture density network, Bishop 1994).

Where an object is does not depend on which way one looks at it, but what a small network says does, a little. So it is
asked from all sides: of the window as it is, mirrored, and turned by quarters where the cameras see all around. What is
seen is the mean of the answers that agree, where most of them do. The others say how much it is in doubt.
"""

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from mimicbench.core.building import built
from mimicbench.core.checkpoint import BadCheckpoint, load_checkpoint, save_checkpoint
from mimicbench.core.errors import MimicbenchError
from mimicbench.imitate.settings.perception import PerceptionConfig
from mimicbench.objects.symmetry import MOTIONS
from mimicbench.sensors.heightmap import CELLS
from mimicbench.tasks.registry import TASKS
from mimicbench.tasks.task import Task

_RAISED = 0.12
"""[m] above the floor: what is higher belongs to an object; far above the noise."""
_WRONG = 0.35
"""[m], [rad] An answer that is farther off is no worse: it is as wrong as can be."""


class Perception(nn.Module):
    """Windows of elevation maps -> goals; `perceive` takes whole maps."""

    def __init__(self, config: PerceptionConfig, task: Task) -> None:
        """Raises MimicbenchError if there is nothing to find in the task."""
        super().__init__()
        if task.goal.given:
            raise MimicbenchError(f"{task.name} tells the robot its goal; there is nothing to learn to see")
        self.config, self.goal, self.task_name, self.cell = config, task.goal, task.name, task.map_cell
        self.sides = tuple(motion for i, motion in enumerate(MOTIONS) if i % 4 < task.rig.quarters())
        """(2, 2) motions of what is seen after which the robot could have seen it as well."""
        self.window = config.window or round(task.goal.window / task.map_cell)
        """Side of the window, in cells."""
        # one block of numbers is common to all hypotheses, or each would have to learn alone what they agree on
        self._blocks = 1 + config.hypotheses if config.hypotheses > 1 else 1
        layers: list[nn.Module] = []
        width_in, side = 3, self.window
        for index, width in enumerate(config.widths):
            kernel = 5 if index == 0 else 3
            layers += [nn.Conv2d(width_in, width, kernel, 2, kernel // 2, bias=False), nn.BatchNorm2d(width), nn.ReLU()]
            width_in, side = width, (side + 1) // 2
        layers += [nn.Flatten(), nn.Linear(width_in * side * side, config.hidden), nn.ReLU()]
        said = nn.Linear(config.hidden, self._blocks * (task.goal.size + 1 + (self._blocks > 1)))
        self.layers = nn.Sequential(*layers, said)
        middle, spread = task.goal.middle_and_spread()
        self._spread_fronts(said.bias, spread)
        self.register_buffer("middle", middle, persistent=False)
        self.register_buffer("spread", spread, persistent=False)

    def _spread_fronts(self, bias: Tensor, spread: Tensor) -> None:
        """Let each hypothesis begin with another front: those that begin alike would learn the same."""
        count = self.config.hypotheses
        if count > 1 and any(field.kind == "direction" for field in self.goal.fields):
            angle = torch.arange(count) * (2 * torch.pi / count)
            sine, cosine = self.goal.front
            with torch.no_grad():
                bias.view(1 + count, -1)[1:, sine] = angle.sin() / spread[sine]
                bias.view(1 + count, -1)[1:, cosine] = angle.cos() / spread[cosine]

    def forward(self, view: Tensor, center: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """H hypotheses: goals (N, H, G), with directions of any length, how far off (N, H) [m] each is likely to be if
        it is the right one, and the logarithm of how likely (N, H) it is to be that.

        Args:
            view: (N, window, window) heights above the floor [m].
            center: (N, 2) where the windows' middles are [m].
        """
        place = (torch.arange(view.shape[1], device=view.device) - (view.shape[1] - 1) / 2) * self.cell
        x = (center[:, 0, None] + place)[:, :, None].expand_as(view)
        y = (center[:, 1, None] + place)[:, None, :].expand_as(view)
        found = self.layers(torch.stack([view, 0.5 * x, 0.5 * y], 1)).unflatten(-1, (self._blocks, -1))
        found, size = found[:, 1:] + found[:, :1] if self._blocks > 1 else found, self.goal.size
        goal = found[..., :size] * self.get_buffer("spread") + self.get_buffer("middle")
        likely = found[..., size + 1] if self._blocks > 1 else torch.zeros_like(found[..., size])
        off = 0.03 * _bounded(found[..., size], 3.0).exp()
        return self.goal.shifted(goal, center[:, None]), off, likely.log_softmax(-1)

    def perceive(self, elevation: Tensor, root_height: Tensor) -> Tensor:
        """Goals (N, G) as a policy remembers them: directions have unit length.

        Args:
            elevation: (N, 128, 128) heights relative to the root [m] (see sensors.heightmap).
            root_height: (N,) height of the root above the floor [m].
        """
        return self.look(elevation, root_height)[0]

    @torch.no_grad()
    def look(self, elevation: Tensor, root_height: Tensor) -> tuple[Tensor, Tensor]:
        """As `perceive`, and the uncertainty (N,): how far off [m], [rad] each goal is likely to be."""
        self.eval()
        view, center = window(elevation + root_height[:, None, None], self.window, self.cell)
        said = []
        for motion in self.sides:
            goals, off, likely = self(*turned(view, center, motion))
            said.append((self.goal.transformed(goals, motion.T), off, likely - math.log(len(self.sides))))
        goals, off, likely = (torch.cat(parts, 1) for parts in zip(*said, strict=True))
        return self._agreed(self.goal.normalized(goals), off, likely)

    def _agreed(self, goals: Tensor, off: Tensor, likely: Tensor) -> tuple[Tensor, Tensor]:
        """The mean (N, G) of those of H answers (N, H, G) that agree with each other most, and the uncertainty (N,):
        how far off they say they are, and how far from them the other answers are, as likely as these are.

        Args:
            goals: (N, H, G).
            off: (N, H) [m].
            likely: (N, H) logarithms of their shares.
        """
        agree = likely[:, None] - self.unlike(goals[:, :, None], goals[:, None])
        most = agree.logsumexp(-1).argmax(-1)
        share = agree[torch.arange(len(goals), device=goals.device), most].softmax(-1)
        goal = self.goal.normalized((share[..., None] * goals).sum(1))
        away = torch.stack(list(self.goal.errors(goals, goal[:, None].expand_as(goals)).values())).amax(0)
        doubt = (likely.exp() * away.clamp(max=_WRONG)).sum(-1)
        return goal, (share * off).sum(-1) + doubt

    def unlike(self, goal: Tensor, other: Tensor) -> Tensor:
        """(...) how much less likely goals (..., G) are where others are right: minus a logarithm."""
        spread = self.get_buffer("spread")
        goal, other = torch.broadcast_tensors(goal, other)
        return functional.smooth_l1_loss(goal / spread, other / spread, beta=0.3, reduction="none").sum(-1)


def window(height: Tensor, size: int, cell: float) -> tuple[Tensor, Tensor]:
    """The part (N, size, size) of maps (N, 128, 128) of heights above the floor around what rises from it, and its
    centers (N, 2) [m], of cells of side `cell` [m].
    """
    rows, columns = _window_cells(height, size)
    n = torch.arange(len(height), device=height.device)[:, None, None]
    inside = ((rows >= 0) & (rows < CELLS))[:, :, None] & ((columns >= 0) & (columns < CELLS))[:, None, :]
    view = height[n, rows.clamp(0, CELLS - 1)[:, :, None], columns.clamp(0, CELLS - 1)[:, None, :]]
    center = torch.stack([rows, columns], -1).float().mean(1) - (CELLS - 1) / 2
    return torch.where(inside, view, 0.0), center * cell


def turned(view: Tensor, center: Tensor, motion: np.ndarray) -> tuple[Tensor, Tensor]:
    """Windows (N, W, W) and their centers (N, 2), of which everything is moved about the robot.

    Args:
        view: (N, W, W), along x and y.
        center: (N, 2) [m].
        motion: (2, 2) one of objects.symmetry.MOTIONS.
    """
    view = view if motion[0, 0] else view.transpose(1, 2)
    return view.flip([1 + i for i in range(2) if motion[i].sum() < 0]), center @ center.new_tensor(motion.T)


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


def _bounded(numbers: Tensor, most: float) -> Tensor:
    """Numbers from -`most` to `most`; the gradient is that of what was bounded, or what runs into a bound while all is
    in doubt could never leave it.
    """
    return torch.where(numbers.abs() < most, numbers, numbers.clamp(-most, most) + (numbers - numbers.detach()))


def save_perception(folder: Path, net: Perception, robot: str, error: Mapping[str, float] | None = None) -> None:
    """Write a checkpoint of kind `perception`, with its errors on unseen objects, if they were measured."""
    notes = {"task": net.task_name, **({} if error is None else {"error": dict(error)})}
    save_checkpoint(
        folder,
        "perception",
        robot,
        net.config,
        {name: value.cpu().numpy() for name, value in net.state_dict().items()},
        notes,
    )


def load_perception(folder: Path, robot: str) -> Perception:
    """Read what `save_perception` wrote. Raises BadCheckpoint, or UnknownName if it is of a task that is not there."""
    checkpoint = load_checkpoint(folder, "perception", robot)
    task = checkpoint.notes.get("task")
    if not isinstance(task, str):
        raise BadCheckpoint(f"{folder} does not say which task's goal it finds; learn it again")
    config = checkpoint.config_as(PerceptionConfig)
    return built(checkpoint, lambda: Perception(config, TASKS.get(task)), [len(config.widths)])
