"""What can be set of what learners see, and of their networks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Literal, Self

from mimicbench.core.settings import BadSetting, Positive
from mimicbench.imitate.clock import SIZE as CLOCK_SIZE
from mimicbench.imitate.clock import clock_features
from mimicbench.imitate.settings.encoder import CELLS

if TYPE_CHECKING:
    from torch import Tensor

    from mimicbench.imitate.inputs import Learner
    from mimicbench.robots.description import Robot
    from mimicbench.tasks.task import Task


@dataclass(frozen=True)
class InputConfig:
    """Which of the senses a learner gets. The defaults are the paper's."""

    body: Literal["state", "proprio"] = "state"
    """`state`: S_current (G.1), 300 numbers of the H1; `proprio`: what a robot can measure of itself, 48 of the H1."""
    last_action: bool = True
    """Keep the last action in S_current, as the paper does. A network copies it, for it is nearly the next one, and
    falls: without it, and with a clock, it has to look at the body."""
    clock: bool = False
    """Add the time since the start. The last action is then left out."""
    memory: bool = False
    """Add the goal as it was known first, carried along by odometry, or told."""
    memory_size: int = 0
    """Numbers in that memory. The task decides."""
    elevation: bool = True
    """Show the elevation map of the present frame."""
    cameras: bool = True
    """Make that map of what the robot's cameras see, as the paper does (C.2): what is hidden from them lacks. Without,
    rays straight down make it, from which nothing is hidden."""
    views: bool = False
    """Show color and depth of the robot's cameras in its place (C.2)."""
    targets: bool = False
    """Beside it show a map of what the robot is told, or mark that in what the cameras see. The task decides."""
    history: Positive = 1
    """Frames that are seen, the present one last."""
    joints: int = 0
    """Of the robot, which decides."""
    links: int = 0
    """Of the robot, which decides."""

    def on(self, robot: Robot) -> InputConfig:
        """The same for a robot."""
        return replace(self, joints=len(robot.joints), links=len(robot.links))

    def of(self, robot: Robot, task: Task) -> InputConfig:
        """The same for a robot at a task."""
        memory_size = task.goal.memory_size if self.memory else 0
        return replace(self.on(robot), memory_size=memory_size, targets=self.sees and task.goal.given)

    @property
    def last_action_place(self) -> slice:
        """Where the last action is in S_current: J, dJ, four times three numbers of every link, last action, g."""
        first = 2 * self.joints + 12 * self.links
        return slice(first, first + self.joints)

    @property
    def copies(self) -> bool:
        """Whether it sees its last action, if it sees S_current."""
        return self.last_action and not self.clock

    @property
    def sees(self) -> bool:
        """Whether it sees anything but its body."""
        return self.elevation or self.views

    @property
    def map_term(self) -> str:
        """The observation that its map is."""
        return "elevation" if self.cameras else "heightmap"

    @property
    def channels(self) -> int:
        """Of what it sees in a frame."""
        from mimicbench.sensors.sight.views import CHANNELS

        return CHANNELS if self.views else 2 if self.targets else 1

    @property
    def size(self) -> int:
        """Length of the input vector of a frame."""
        body = 10 + 2 * self.joints
        if self.body == "state":
            body = self.last_action_place.stop + 3 - (0 if self.copies else self.joints)
        return body + (CLOCK_SIZE if self.clock else 0) + (self.memory_size if self.memory else 0)

    @property
    def seen_size(self) -> int:
        """Length of the input vectors of all frames that are seen."""
        return self.history * self.size

    @property
    def seen_channels(self) -> int:
        """Of what it sees in all frames."""
        return self.history * self.channels

    def vector(self, state: Tensor, proprio: Tensor, time: Tensor, memory: Tensor | None) -> Tensor:
        """The input vector (N, size).

        Args:
            state: (N, 3 + 3 J + 12 L) S_current.
            proprio: (N, 10 + 2 J).
            time: (N,) since the start [s].
            memory: (N, memory_size) of goals.KnownGoal; needed if `memory` is on.
        """
        import torch

        if self.body == "proprio":
            parts = [proprio]
        elif self.copies:
            parts = [state]
        else:
            parts = [state[:, : self.last_action_place.start], state[:, self.last_action_place.stop :]]
        if self.clock:
            parts.append(clock_features(time))
        if self.memory:
            if memory is None:
                raise ValueError("this learner has a memory of the start; give it one")
            parts.append(memory)
        return torch.cat(parts, -1)


@dataclass(frozen=True)
class Window:
    """Which frames around the present one a learner is shown of a demonstration."""

    chunk: int = 1
    """Frames of action."""
    past: int = 0
    """How many of them lie before the present."""
    looks_ahead: bool = False
    """Whether it is also shown the map of the frame after the chunk."""


def check_heads(hidden: int, heads: int) -> None:
    """Raise BadSetting if tokens of that width cannot be shared out among so many heads."""
    if hidden % heads:
        raise BadSetting(f"network.hidden is {hidden}, and network.heads {heads}; give a width that heads divide")
    if hidden % 4:
        raise BadSetting(f"network.hidden is {hidden}; give a multiple of 4, which tells places in a picture")


@dataclass(frozen=True)
class NetworkConfig:
    """What every network that clones is built from; each adds its sizes."""

    inputs: InputConfig = InputConfig()
    """What it sees."""
    action_size: int = 0
    """Joints of the robot, which decides."""
    relative: bool = False
    """Say joint targets as differences from the joint angles of the frame in which they are chosen."""

    goal_weight: float = 0.0
    """While it learns, also say from what is seen alone where the goal is; weight of the error of that. Of joint
    targets so little depends on where the object is that a network takes far longer to look for it than to walk."""
    goal_size: int = 0
    """Numbers in the task's goal, which decides."""

    may_be_relative: ClassVar[bool] = False
    """Whether such a network can say relative targets."""
    may_find_goals: ClassVar[bool] = False
    """Whether such a network can say where the goal is."""

    def __post_init__(self) -> None:
        if self.relative and not self.may_be_relative:
            raise BadSetting("network.relative is for learners that regress joint targets, such as act and bc")
        if self.goal_weight and not (self.may_find_goals and self.inputs.sees):
            raise BadSetting("network.goal-weight is for learners that see in every frame, such as act and bc")
        encoder = getattr(self, "encoder", None)
        if encoder is not None and encoder.cells != CELLS:
            raise BadSetting(f"what is seen has {CELLS} x {CELLS} cells, and needs network.encoder.cells {CELLS}")

    def of(self, robot: Robot, task: Task) -> Self:
        """The same for a robot at a task."""
        if self.goal_weight and task.moves_object:
            raise BadSetting(
                f"network.goal-weight is for goals that stay where they are, and {task.name} moves its own"
            )
        goal_size = task.goal.size if self.goal_weight else 0
        return replace(self, inputs=self.inputs.of(robot, task), action_size=len(robot.joints), goal_size=goal_size)

    @property
    def window(self) -> Window:
        """Which frames it is shown."""
        return Window()

    @property
    def layers(self) -> tuple[int, ...]:
        """How many of everything that is repeated."""
        return ()

    def build(self) -> Learner:
        """A new network, with weights from torch's random numbers."""
        raise NotImplementedError


REMEMBERING = InputConfig(body="proprio", clock=True, memory=True, elevation=False)
"""Body, clock, and what has to be found as seen in the first map."""
