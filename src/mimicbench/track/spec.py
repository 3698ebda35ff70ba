"""What a tracker is made of: what it observes, what its action means, what it is rewarded for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from mimicbench.core.errors import MimicbenchError

if TYPE_CHECKING:  # these bring torch, which who only asks what can be set does without
    from torch import Tensor

    from mimicbench.robots.description import Robot
    from mimicbench.sensors.context import StepContext, Transition
    from mimicbench.sensors.observations import Term
    from mimicbench.track.network import NetworkConfig

Terms = Mapping[str, "Tensor"]
"""Values (N, ...) of observation terms by name."""


@dataclass(frozen=True)
class TrackerSpec:
    """A tracker's design. The network that fills it in is learned.

    Whoever plans instead of following a clip gives the privileged terms itself: `next_joint_pos` and `target` see
    nothing but terms, so a tracker also follows what was never recorded.
    """

    name: str
    gains: str
    """Which of the robot's gains it drives."""
    observations: tuple[str | Term, ...]
    """Terms, laid out one after the other for the network; those that a task does not have are left out."""
    target: Callable[[Robot, Tensor, Tensor, Any], Tensor]
    """(N, J) joint targets [rad] from the robot, the next reference's joint angles (N, J), the action (N, J) and the
    settings."""
    next_joint_pos: Callable[[Robot, Terms], Tensor]
    """(N, J) the next reference's joint angles [rad], read off the terms."""
    reward: Callable[[StepContext, Transition, Any], Tensor]
    """(N,) reward of the step that led to this context, by the settings."""
    settings: type = type(None)
    """Configuration dataclass of its own, or None."""
    measures_effort: Callable[[Any], bool] = lambda settings: False
    """Whether the reward needs the mechanical effort, which costs time, by the settings."""
    measures_contact: bool = False
    """Whether the reward or the ends need the forces of contact, which cost time."""
    network: type[NetworkConfig] | None = None
    """Configuration of its network, which must have a default for everything; None: an MLP of `ppo.hidden`."""
    frames: int = 1
    """Frames that its network sees unless it is told otherwise: the present one and those before it."""
    scales: Mapping[str, float] = field(default_factory=dict)
    """What terms are multiplied by before the network sees them, by name; 1 for all others."""
    smoothing: Callable[[Any], float] = lambda settings: 0.0
    """Share of the action before in the one that is carried out, by the settings."""
    action: Callable[[Robot, Tensor, Tensor, Any], Tensor] | None = None
    """The inverse of `target`: (N, J) the action that joint targets (N, J), which stand where that does, come from. For
    DAgger alone, where others drive while it says what is right."""
    ends: Mapping[str, Callable[[StepContext, Any], Tensor]] = field(default_factory=dict)
    """Why episodes of its training end beside what all trackers' end for, in words: (N,) bool whether a robot has
    failed, by the settings."""

    def aim(self, robot: Robot, next_joint_pos: Tensor, action: Tensor, last_action: Tensor, settings: Any) -> Tensor:
        """(N, J) joint targets [rad] of an action and the one before it, on the joint angles of the next reference."""
        share = self.smoothing(settings)
        if share:
            action = (1.0 - share) * action + share * last_action
        return self.target(robot, next_joint_pos, action, settings)

    def aimed(self, robot: Robot, next_joint_pos: Tensor, target: Tensor, last_action: Tensor, settings: Any) -> Tensor:
        """(N, J) the action with which `aim` gives joint targets [rad]: what somebody else did, in its own words.

        Raises MimicbenchError if the design does not say.
        """
        if self.action is None:
            raise MimicbenchError(
                f"the tracker {self.name!r} does not say which action joint targets come from; give its TrackerSpec an "
                "`action`, the inverse of `target`"
            )
        share, action = self.smoothing(settings), self.action(robot, next_joint_pos, target, settings)
        return (action - share * last_action) / (1.0 - share)
