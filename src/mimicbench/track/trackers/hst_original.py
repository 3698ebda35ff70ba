"""Original HST as HumanPlus has it, the tracker that the paper compares improved HST with (E.1): 84 numbers in eight
frames, told of joint angles and of how fast to walk, but not of where to be, through a transformer.

An episode of its training ends where anything but the feet and the torso touches something, the root is low, or
tilted: whoever sits or lies has failed. What HumanPlus does to the simulation meanwhile has no place here: its targets
arrive a step late, and friction and mass change from robot to robot.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from mimicbench.core import rotations as rot
from mimicbench.core.settings import Positive, Share
from mimicbench.sim.timing import CONTROL_DT
from mimicbench.track.spec import Terms, TrackerSpec

if TYPE_CHECKING:
    from torch import Tensor, nn

    from mimicbench.robots.description import Robot
    from mimicbench.sensors.context import StepContext, Transition

BARE = ("pelvis", "hip", "shoulder", "elbow", "knee")
"""Links with any of this in their names must touch nothing."""


@dataclass(frozen=True)
class TransformerConfig:
    """One token a frame; self-attention; the last token gives the numbers."""

    tokens: Positive = 128
    """Width of the tokens."""
    heads: Positive = 4
    """Attention heads."""
    blocks: Positive = 4
    """Of attention and a layer four times as wide."""
    dropout: Share = 0.1
    """Share of activations that are dropped, while robots explore as well as while the network learns."""

    normalizes: ClassVar[bool] = False
    widens: ClassVar[bool] = False

    @property
    def repeats(self) -> tuple[int, ...]:
        """Blocks."""
        return (self.blocks,)

    def build(self, width: int, frames: int, outputs: int) -> nn.Module:
        """Actor or critic: neither has anything of the other."""
        from mimicbench.track.trackers.transformer import Transformer

        return Transformer(self, width, frames, outputs)


@dataclass(frozen=True)
class HSTOriginalConfig:
    """Weights of the reward per second, and where an episode has failed."""

    joints: float = 1.0
    """Of exp(-4 e), e being the mean distance of the joints from their reference [rad]."""
    walk: float = 0.1
    """Of exp(-|dv|^2 / 0.25), v being the root's velocity forward and to the left [m/s]."""
    turn: float = 0.1
    """Of exp(-dw^2 / 0.25), w being how fast the root turns about its own upward axis [rad/s]."""
    max_force: float = 1.0
    """What may touch a link that must not be touched [N]."""
    max_tilt: float = 0.5
    """Roll and pitch to either side [rad]."""
    min_height: float = 0.85
    """Of the root above the floor [m]."""


def target(robot: Robot, next_joint_pos: Tensor, action: Tensor, settings: HSTOriginalConfig) -> Tensor:
    """(N, J) joint targets [rad]: the action is added to the rest pose, and kept within the limits."""
    low, high = action.new_tensor(robot.joint_range).T
    return (action.new_tensor(robot.rest_pose) + action).clamp(low, high)


def action(robot: Robot, next_joint_pos: Tensor, target: Tensor, settings: HSTOriginalConfig) -> Tensor:
    """(N, J) the inverse of `target`."""
    return target - target.new_tensor(robot.rest_pose)


def next_joint_pos(robot: Robot, terms: Terms) -> Tensor:
    """(N, J) joint angles [rad] of the next frame, as it is told them."""
    return terms["joint_target+1"]


def reward(context: StepContext, step: Transition, settings: HSTOriginalConfig) -> Tensor:
    """(N,) r_target_jt + r_tracking_lin_vel + r_tracking_ang_vel of HumanPlus, for the time of a control step."""
    from mimicbench.sensors.reference import walk_of

    state, ref = context.state, context.reference(0)
    joints = (state.joint_pos - ref.joint_pos).abs().mean(-1)
    wanted = walk_of(ref)
    velocity = rot.rotate_inverse(state.root_quat_w, state.root_lin_vel_w)[:, :2]
    slip = ((velocity - wanted[:, :2]) ** 2).sum(-1)
    turn = (state.root_ang_vel_b[:, 2] - wanted[:, 2]) ** 2
    per_second = (
        settings.joints * (-4.0 * joints).exp()
        + settings.walk * (-slip / 0.25).exp()
        + settings.turn * (-turn / 0.25).exp()
    )
    return CONTROL_DT * per_second


def touched(context: StepContext, settings: HSTOriginalConfig) -> Tensor:
    """(N,) bool whether something touches a link of BARE."""
    names = context.robot.link_names
    bare = [number for number, name in enumerate(names) if any(part in name for part in BARE)]
    return (context.contact_force[:, bare].norm(dim=-1) > settings.max_force).any(-1)


def rolled(context: StepContext, settings: HSTOriginalConfig) -> Tensor:
    """(N,) bool whether the root leans too far to a side."""
    from mimicbench.sensors.proprioception import tilt

    return tilt(context.state)[:, 0].abs() > settings.max_tilt


def pitched(context: StepContext, settings: HSTOriginalConfig) -> Tensor:
    """(N,) bool whether the root leans too far forward or back."""
    from mimicbench.sensors.proprioception import tilt

    return tilt(context.state)[:, 1].abs() > settings.max_tilt


def sank(context: StepContext, settings: HSTOriginalConfig) -> Tensor:
    """(N,) bool whether the root is too low."""
    return context.state.root_pos_w[:, 2] < settings.min_height


TRACKER = TrackerSpec(
    "hst-original",
    "paper",
    ("tilt", "root_ang_vel", "walk+1", "joint_offset", "joint_vel", "last_action", "joint_target+1"),
    target,
    next_joint_pos,
    reward,
    HSTOriginalConfig,
    measures_contact=True,
    network=TransformerConfig,
    frames=8,
    scales={"root_ang_vel": 0.25, "joint_vel": 0.05},
    action=action,
    ends={"touched": touched, "rolled": rolled, "pitched": pitched, "sank": sank},
)
