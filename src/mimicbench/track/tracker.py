"""What a tracker is made of: how it sees, what it is rewarded for, and what its action means."""

from collections.abc import Callable
from dataclasses import dataclass

import torch

from mimicbench.core.errors import UnknownName
from mimicbench.robots.description import Robot
from mimicbench.sim.physics import LinkState, RobotState
from mimicbench.track.reference import Frame


@dataclass(frozen=True)
class Moment:
    """All that observations and rewards may use, for N robots at one control step."""

    robot: Robot
    state: RobotState
    links: Callable[[], LinkState]
    """Link poses of the robots now; computed when asked for."""
    reference: Callable[[int], Frame]
    """The reference k control steps from now."""
    last_action: torch.Tensor
    """(N, J) the action that led here."""


@dataclass(frozen=True)
class Step:
    """What only the reward needs: the change since the last control step."""

    action: torch.Tensor
    """(N, J) the action just taken."""
    previous_action: torch.Tensor
    """(N, J) the one before it."""
    previous_joint_vel: torch.Tensor
    """(N, J) [rad/s]."""
    previous_reference_joint_vel: torch.Tensor
    """(N, J) [rad/s]."""
    effort: torch.Tensor
    """(N,) sum_j (tau_j v_j)^2; zeros unless the tracker measures effort."""


@dataclass(frozen=True)
class TrackerKind:
    """A tracker's design. The network that fills it in is learned."""

    name: str
    gains: str
    """Which of the robot's gain presets it drives."""
    observe: Callable[[Moment], torch.Tensor]
    """(N, O) observation."""
    target: Callable[[Robot, Frame, torch.Tensor], torch.Tensor]
    """(N, J) joint targets [rad] from the next reference frame and the action (N, J)."""
    reward: Callable[[Moment, Step], torch.Tensor]
    """(N,) reward of the step that led to this moment."""
    measures_effort: bool = False
    """Whether the reward needs the mechanical effort, which costs time."""


def get_kind(name: str) -> TrackerKind:
    """A tracker's design by the name of its preset. Raises UnknownName."""
    from mimicbench.track.hst import HST_PAPER
    from mimicbench.track.residual import RESIDUAL

    kinds = {kind.name: kind for kind in (HST_PAPER, RESIDUAL)}
    if name not in kinds:
        raise UnknownName("tracker preset", name, list(kinds))
    return kinds[name]
