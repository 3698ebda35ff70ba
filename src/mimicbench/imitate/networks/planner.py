"""The planner's network: what it takes and gives, at one task or at several, and where each task is in that."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate

import torch
from torch import Tensor, nn
from torch.nn.functional import pad

from mimicbench.imitate.clock import SIZE as CLOCK_SIZE
from mimicbench.imitate.clock import clock_features
from mimicbench.imitate.plan import PlanLayout
from mimicbench.robots.description import Robot
from mimicbench.sensors.observations import TERMS
from mimicbench.tasks.task import Task
from mimicbench.track.spec import TrackerSpec


@dataclass(frozen=True)
class TaskColumns:
    """Where one task's memory and plan are among those of all tasks that a planner learns."""

    memory: slice
    """Of its goal, among the inputs of all."""
    mark: int | None
    """Of the number that says that it is meant; None if there is no other."""
    memories: int
    """Of all tasks together, and of which is meant."""
    plan: tuple[slice, ...]
    """Of its terms, in their order, among those of all."""
    plans: int
    """Of all terms together."""

    def told(self, memory: Tensor) -> Tensor:
        """(N, memories) what is known of goals (N, memory_size), and which task it is."""
        before, after = self.memory.start, self.memories - self.memory.stop
        told = pad(memory, (before, after))
        if self.mark is None:
            return told
        return told + pad(memory.new_ones(1), (self.mark, self.memories - self.mark - 1))

    def own(self, plans: Tensor) -> Tensor:
        """(..., P) the plans of this task among those of all (..., plans)."""
        return torch.cat([plans[..., part] for part in self.plan], -1)


def columns_of(spec: TrackerSpec, robot: Robot, tasks: Sequence[Task]) -> tuple[TaskColumns, ...]:
    """Of each task, over a tracker. A term of the plan is the same for all tasks that have it."""
    layouts = [PlanLayout(spec, robot, task).widths for task in tasks]
    widths = {name: width for layout in layouts for name, width in layout.items()}
    ends = dict(zip(widths, accumulate(widths.values()), strict=True))
    stops = list(accumulate(task.goal.memory_size for task in tasks))
    several = len(tasks) > 1
    return tuple(
        TaskColumns(
            slice(stop - task.goal.memory_size, stop),
            stops[-1] + number if several else None,
            stops[-1] + (len(tasks) if several else 0),
            tuple(slice(ends[name] - width, ends[name]) for name, width in layout.items()),
            sum(widths.values()),
        )
        for number, (task, layout, stop) in enumerate(zip(tasks, layouts, stops, strict=True))
    )


@dataclass(frozen=True)
class PlannerSizes:
    """What a planner takes and gives, in numbers."""

    body: int
    """Of what the robot measures of itself."""
    goal: int
    """Of the goal as it is known first."""
    memory: int
    """Of what is known of it by now, of all tasks, and of which task is meant, if there are several."""
    plan: int
    """Of what the tracker is told, at any task."""
    style: int
    """Of what clips choose."""
    clock: int = CLOCK_SIZE
    """Of the time."""

    @staticmethod
    def of(robot: Robot, tasks: Sequence[Task], spec: TrackerSpec, style: int, clock: bool = True) -> "PlannerSizes":
        """For a robot at tasks, over a tracker, and clips of so much style, with a clock or without."""
        (body,) = TERMS["proprio"].shape(robot, tasks[0])
        columns = columns_of(spec, robot, tasks)[0]
        goal = tasks[0].goal.size
        return PlannerSizes(body, goal, columns.memories, columns.plans, style, CLOCK_SIZE if clock else 0)

    @property
    def inputs(self) -> int:
        """All that it takes."""
        return self.body + self.clock + self.memory + self.style


class PlannerNetwork(nn.Module):
    """Body, clock, memory and style -> plan; and the goal as known first -> style. All are normalized inside."""

    def __init__(self, sizes: PlannerSizes, hidden: tuple[int, ...]) -> None:
        super().__init__()
        self.sizes = sizes
        self.input_mean: Tensor
        self.input_std: Tensor
        self.plan_mean: Tensor
        self.plan_std: Tensor
        self.style_mean: Tensor
        self.style_std: Tensor
        self.style_is_choice: Tensor
        inputs, outputs, style = sizes.inputs, sizes.plan, sizes.style
        for name, size in (("input", inputs), ("plan", outputs), ("style", style)):
            self.register_buffer(f"{name}_mean", torch.zeros(size))
            self.register_buffer(f"{name}_std", torch.ones(size))
        self.register_buffer("style_is_choice", torch.zeros(style))
        self.chooser = (
            nn.Sequential(nn.Linear(sizes.goal, 64), nn.ELU(), nn.Linear(64, 64), nn.ELU(), nn.Linear(64, style))
            if style
            else nn.Sequential()
        )
        layers: list[nn.Module] = []
        width = inputs
        for size in hidden:
            layers += [nn.Linear(width, size), nn.ELU()]
            width = size
        self.layers = nn.Sequential(*layers, nn.Linear(width, outputs))

    def forward(self, inputs: Tensor) -> Tensor:
        """(N, outputs) normalized plan."""
        return self.layers(((inputs - self.input_mean) / self.input_std).clamp(-10, 10))

    def plan(self, inputs: Tensor) -> Tensor:
        """(N, outputs) plan in the tracker's units."""
        return self(inputs) * self.plan_std + self.plan_mean

    def set_styles(self, styles: Tensor) -> None:
        """Set the normalization from the styles (C, S) of all clips.

        What is only ever 1 or -1 is a choice between two.
        """
        if not styles.shape[1]:
            return
        self.style_mean.copy_(styles.mean(0))
        self.style_std.copy_(styles.std(0).clamp(min=1e-3) if len(styles) > 1 else torch.ones(styles.shape[1]))
        self.style_is_choice.copy_((styles.abs() == 1).all(0).float())

    def normalized_style(self, style: Tensor) -> Tensor:
        """(N, S) styles with mean 0 and deviation 1, as the chooser gives and the planner takes them."""
        return (style - self.style_mean) / self.style_std

    def choose(self, goal: Tensor) -> Tensor:
        """(N, S) the normalized style for goals (N, G) as first known: the expected one, and the likelier of two
        choices.
        """
        if not len(self.style_mean):
            return goal.new_zeros(len(goal), 0)
        expected = self.chooser(goal)
        side = torch.where(expected * self.style_std + self.style_mean >= 0, 1.0, -1.0)
        return torch.where(self.style_is_choice > 0, self.normalized_style(side), expected)


def planner_inputs(body: Tensor, seconds: Tensor | None, memory: Tensor, style: Tensor) -> Tensor:
    """(N, PlannerSizes.inputs) what the planner sees. `memory` is as `TaskColumns.told`, `style` normalized, `seconds`
    None for who sees no clock.
    """
    return torch.cat([body, *([] if seconds is None else [clock_features(seconds)]), memory, style], -1)
