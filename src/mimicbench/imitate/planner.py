"""A planner over the tracker, learned by DAgger: HIT's two stages in closed loop.

The planner sees the robot's own body, a clock, and the seat as it was seen in the first elevation map, carried along by
odometry. It says what the tracker needs to be told: its reference one and five frames ahead, relative to the body. The
tracker turns that into joint targets. While learning, the label is the clip's own next frames at the same time index,
seen from wherever the robot has got to; who drives changes from the tracker on true references to the planner itself.

What a clip chose beyond its start and its object is told by its style, such as which way it turns its back to the seat.
Two choices have no middle: a planner that has to guess them from where it stands wavers, and falls. So the style is an
input, and a small network, the chooser, settles it once, by the first look.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import torch
from torch import nn

from mimicbench.core.building import built
from mimicbench.core.checkpoint import load_checkpoint, save_checkpoint
from mimicbench.core.motion import RobotMotion
from mimicbench.core.settings import Positive, Sizes
from mimicbench.envs.clip_starts import ClipStartConfig
from mimicbench.imitate.clock import SIZE as CLOCK_SIZE
from mimicbench.imitate.clock import clock_features
from mimicbench.imitate.perception import MEMORY_SIZE, SEAT_SIZE, Perception, SeatMemory, load_perception
from mimicbench.imitate.policy import BODY, look_again, look_first, recall
from mimicbench.robots.description import Robot
from mimicbench.sensors.observations import Observations
from mimicbench.tasks.task import Task
from mimicbench.track.checkpoint import load_tracker
from mimicbench.track.spec import Tracker, sizes
from mimicbench.track.tracking import EndConfig, TrackingConfig


@dataclass(frozen=True)
class PlannerConfig:
    """The planner's network and its training."""

    hidden: Sizes = (512, 512, 256)
    """Widths of the hidden layers."""
    samples: Positive = 3_200_000
    """Control steps to see, over all robots."""
    num_envs: Positive = 256
    """Robots side by side."""
    steps: Positive = 24
    """Control steps between rounds of learning."""
    batches: Positive = 40
    """Batches per round."""
    batch: Positive = 768
    """Frames per batch."""
    memory: Positive = 400_000
    """Most recent frames that are learned from."""
    teacher_share: float = 0.2
    """Part of the training over which the tracker on true references drives ever less."""
    action_weight: float = 0.5
    """Weight of the difference that the plan makes to the tracker's action."""
    learning_rate: float = 1e-3
    """Of Adam at the start; falls to a tenth along a cosine."""
    save_every: float = 120.0
    """Seconds between saves: what a kill can lose at most."""
    threads: Positive = 2
    """Threads of the network's arithmetic. Sums round differently with another number, so it is part of the result."""
    tracking: TrackingConfig = field(
        default_factory=lambda: TrackingConfig(
            ClipStartConfig(first_frame=0.5), push=0.2, ends=EndConfig(0.5, 1.0, 0.25, 0.3)
        )
    )
    """Starts, disturbances and ends of training episodes. Pushed no harder than what the tracker survives: who falls
    teaches nothing."""


class PlannerNetwork(nn.Module):
    """Body, clock, memory and style -> plan; and the first look -> style. All are normalized inside."""

    def __init__(self, joints: int, plan: int, style: int, hidden: tuple[int, ...]) -> None:
        """For a robot with so many joints, a tracker that is told so many numbers, and clips of so much style."""
        super().__init__()
        self.input_mean: torch.Tensor
        self.input_std: torch.Tensor
        self.plan_mean: torch.Tensor
        self.plan_std: torch.Tensor
        self.style_mean: torch.Tensor
        self.style_std: torch.Tensor
        self.style_is_choice: torch.Tensor
        inputs, outputs = 10 + 2 * joints + CLOCK_SIZE + MEMORY_SIZE + style, plan
        for name, size in (("input", inputs), ("plan", outputs), ("style", style)):
            self.register_buffer(f"{name}_mean", torch.zeros(size))
            self.register_buffer(f"{name}_std", torch.ones(size))
        self.register_buffer("style_is_choice", torch.zeros(style))
        self.chooser = (
            nn.Sequential(nn.Linear(SEAT_SIZE, 64), nn.ELU(), nn.Linear(64, 64), nn.ELU(), nn.Linear(64, style))
            if style
            else nn.Sequential()
        )
        layers: list[nn.Module] = []
        width = inputs
        for size in hidden:
            layers += [nn.Linear(width, size), nn.ELU()]
            width = size
        self.layers = nn.Sequential(*layers, nn.Linear(width, outputs))

    def forward(self, inputs: torch.Tensor) -> torch.Tensor:
        """(N, outputs) normalized plan."""
        return self.layers(((inputs - self.input_mean) / self.input_std).clamp(-10, 10))

    def plan(self, inputs: torch.Tensor) -> torch.Tensor:
        """(N, outputs) plan in the tracker's units."""
        return self(inputs) * self.plan_std + self.plan_mean

    def set_styles(self, styles: torch.Tensor) -> None:
        """Set the normalization from the styles (C, S) of all clips.

        What is only ever 1 or -1 is a choice between two.
        """
        self.style_mean.copy_(styles.mean(0))
        self.style_std.copy_(styles.std(0).clamp(min=1e-3) if len(styles) > 1 else torch.ones(styles.shape[1]))
        self.style_is_choice.copy_((styles.abs() == 1).all(0).float())

    def normalized_style(self, style: torch.Tensor) -> torch.Tensor:
        """(N, S) styles with mean 0 and deviation 1, as the chooser gives and the planner takes them."""
        return (style - self.style_mean) / self.style_std

    def choose(self, seat: torch.Tensor) -> torch.Tensor:
        """(N, S) the normalized style for seats (N, 6) as first seen: the expected one, and the likelier of two
        choices.
        """
        if not len(self.style_mean):
            return seat.new_zeros(len(seat), 0)
        expected = self.chooser(seat)
        side = torch.where(expected * self.style_std + self.style_mean >= 0, 1.0, -1.0)
        return torch.where(self.style_is_choice > 0, self.normalized_style(side), expected)


def planner_inputs(
    body: torch.Tensor, seconds: torch.Tensor, memory: torch.Tensor, style: torch.Tensor
) -> torch.Tensor:
    """(N, 48 + 13 + 10 + S for the H1) what the planner sees; `style` is normalized."""
    return torch.cat([body, clock_features(seconds), memory, style], -1)


def styles_of(motions: Sequence[RobotMotion]) -> tuple[tuple[str, ...], torch.Tensor]:
    """Names of what all clips say of their style, sorted, and the values (C, S)."""
    names = sorted(set.intersection(*(set(motion.style) for motion in motions)))
    return tuple(names), torch.tensor(
        [[motion.style[name] for name in names] for motion in motions], dtype=torch.float32
    ).reshape(len(motions), len(names))


def plan_terms(tracker: Tracker, plan: torch.Tensor, robot: Robot, task: Task) -> dict[str, torch.Tensor]:
    """The terms that a plan (N, P) tells the tracker, by name."""
    names = tracker.spec.plan(task)
    return dict(zip(names, plan.split(sizes(names, robot, task), -1), strict=True))


class PlannerPolicy:
    """The planner in closed loop: looks, remembers, looks again while unsure, plans every frame for the tracker."""

    observations: tuple[str, ...] = (*BODY, "elevation")

    def __init__(
        self, robot: Robot, task: Task, network: PlannerNetwork, tracker: Tracker, perception: Perception
    ) -> None:
        self._robot, self._task, self._network, self._tracker = robot, task, network, tracker
        self.gains = tracker.spec.gains
        self._memory = SeatMemory(perception, 0)
        self._last_action = torch.zeros(0, len(robot.joints))
        self._style = torch.zeros(0, len(network.style_mean))

    def to(self, device: str) -> None:
        """Move the networks to a device."""
        self._network.to(device)
        self._tracker.network.to(device)
        self._memory = SeatMemory(self._memory.perception.to(device), 0)
        self._last_action, self._style = self._last_action[:0].to(device), self._style[:0].to(device)

    @torch.no_grad()
    def reset(self, ids: torch.Tensor, obs: Observations) -> None:
        """Look at the first map, remember the seat, and settle how to go about it."""
        robots, device = obs.num_envs, obs["time"].device
        if len(self._last_action) != robots:
            self._memory = SeatMemory(self._memory.perception, robots, device)
            self._last_action = torch.zeros(robots, len(self._robot.joints), device=device)
            self._style = torch.zeros(robots, len(self._network.style_mean), device=device)
        look_first(self._memory, ids, obs)
        self._last_action[ids] = 0.0
        self._style[ids] = self._network.choose(self._memory.seat[ids])

    @torch.no_grad()
    def act(self, obs: Observations) -> torch.Tensor:
        """Joint position targets (N, J) [rad]."""
        look_again(self._memory, obs)
        inputs = planner_inputs(obs["proprio"], obs["time"][:, 0], recall(self._memory, obs), self._style)
        plan = plan_terms(self._tracker, self._network.plan(inputs), self._robot, self._task)
        terms = {"proprio": obs["proprio"], "last_action": self._last_action, **plan}
        self._last_action = self._tracker.action(terms)
        return self._tracker.target(self._robot, terms, self._last_action)


def save_planner(
    folder: Path, robot: Robot, network: PlannerNetwork, config: PlannerConfig, notes: Mapping[str, object]
) -> None:
    """Write the planner's own network; its tracker and perception are in folders beside it."""
    save_checkpoint(
        folder,
        "planner",
        robot.name,
        config,
        {name: value.cpu().numpy() for name, value in network.state_dict().items()},
        notes,
    )


def load_planner(folder: Path, robot: Robot, task: Task) -> PlannerPolicy:
    """Read a planner with the `tracker` and the `perception` in the folders beside it. Raises BadCheckpoint."""
    checkpoint = load_checkpoint(folder, "planner", robot.name)
    config = checkpoint.config_as(PlannerConfig)
    tracker = load_tracker(folder.parent / "tracker", robot)
    perception = load_perception(folder.parent / "perception", robot.name)
    style = checkpoint.tensors["style_mean"].size if "style_mean" in checkpoint.tensors else 0
    plan = sum(sizes(tracker.spec.plan(task), robot, task))
    network = built(
        checkpoint, lambda: PlannerNetwork(len(robot.joints), plan, style, config.hidden), [len(config.hidden)]
    )
    return PlannerPolicy(robot, task, network, tracker, perception)
