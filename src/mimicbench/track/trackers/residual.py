"""Our tracker: actions move the reference's joint angles a little, and the observation is what that needs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from mimicbench.track.spec import Terms, TrackerSpec

if TYPE_CHECKING:
    from torch import Tensor

    from mimicbench.robots.description import Robot
    from mimicbench.sensors.context import StepContext, Transition

GAINS = "improved"


@dataclass(frozen=True)
class ResidualConfig:
    """Weights of the reward: of agreement with the reference, in parts of at most 1, and of the penalties."""

    position: float = 0.35
    """Of exp(-10 d^2), d being the root's distance from its reference [m]."""
    orientation: float = 0.20
    """Of 1 / (1 + 5 a^2), a being the angle between the root and its reference [rad]. A robot
    that swings the legs up to lie and does not turn with them is a radian off, where exp(-5 a^2), the same near 0, has
    no gradient."""
    joints: float = 0.25
    """Of 1 / (1 + sum dq^2) over the joints [rad]."""
    velocity: float = 0.10
    """Of exp(-2 dv^2) of the root [m/s]."""
    joint_velocity: float = 0.10
    """Of exp(-0.02 sum dq'^2) over the joints [rad/s]."""
    wrists: float = 0.20
    """Of exp(-10 d), d being a wrist's distance from its reference [m], in the mean of both."""
    ankles: float = 0.20
    """Of exp(-5 d), d being an ankle's distance from its reference [m], in the mean of both. Lying down, legs in the
    air are half a meter off, where a narrower kernel would have no gradient."""
    action_rate: float = 0.005
    """Penalty on the squared change of the action."""
    smoothing: float = 0.0
    """Share of the action before in the one that is carried out. Peaks of power come from jerks: with 0.4 a
    tracker that learned without it had K as often, and K and P in 84 instead of 74 % of 40 clips."""
    power: float = 0.0
    """Penalty on log(1 + e / 1e6 W^2), e being what P limits: peaks of power are few frames in an episode, and
    costly."""
    object: float = 0.5
    """Share of the whole that exp(-10 d) of the object's distance d [m] from its reference has, where it moves."""


def target(robot: Robot, next_joint_pos: Tensor, action: Tensor, settings: ResidualConfig) -> Tensor:
    """(N, J) joint targets [rad]: the reference's next joint angle + scale x action."""
    return next_joint_pos + action.new_tensor(robot.gains[GAINS].action_scale) * action


def action(robot: Robot, next_joint_pos: Tensor, target: Tensor, settings: ResidualConfig) -> Tensor:
    """(N, J) the inverse of `target`."""
    return (target - next_joint_pos) / target.new_tensor(robot.gains[GAINS].action_scale)


def next_joint_pos(robot: Robot, terms: Terms) -> Tensor:
    """(N, J) joint angles [rad] of the next frame: where the joints are, and the difference that the plan tells."""
    joints = len(robot.joints)
    now = terms["proprio"][:, -2 * joints : -joints]
    return now + terms["reference+1"][:, 12 : 12 + joints]


def reward(context: StepContext, step: Transition, settings: ResidualConfig) -> Tensor:
    """(N,) agreement with the reference, at most the sum of its weights, less the penalties."""
    state, ref = context.state, context.reference(0)
    position = ((state.root_pos_w - ref.root_pos_w) ** 2).sum(-1)
    joints = ((state.joint_pos - ref.joint_pos) ** 2).sum(-1)
    velocity = ((state.root_lin_vel_w - ref.root_lin_vel_w) ** 2).sum(-1)
    joint_velocity = ((state.joint_vel - ref.joint_vel) ** 2).sum(-1)
    agreement = (
        settings.position * (-10.0 * position).exp()
        + settings.orientation / (1.0 + 5.0 * context.root_angle_error**2)
        + settings.joints / (1.0 + joints)
        + settings.velocity * (-2.0 * velocity).exp()
        + settings.joint_velocity * (-0.02 * joint_velocity).exp()
    )
    points = context.body_points
    wrists = (points.wrist_pos_w - ref.wrist_pos_w).norm(dim=-1)
    ankles = (points.ankle_pos_w - ref.ankle_pos_w).norm(dim=-1)
    agreement = (
        agreement + settings.wrists * (-10.0 * wrists).exp().mean(-1) + settings.ankles * (-5.0 * ankles).exp().mean(-1)
    )
    if context.task.moves_object:
        away = (context.object.pos_w - ref.object.pos_w).norm(dim=-1)
        agreement = (1 - settings.object) * agreement + settings.object * (-10.0 * away).exp()
    if settings.power:
        agreement = agreement - settings.power * (step.effort / 1e6).log1p()
    return agreement - settings.action_rate * ((step.action - step.previous.last_action) ** 2).sum(-1)


TRACKER = TrackerSpec(
    "residual",
    GAINS,
    ("proprio", "last_action", "reference+1", "reference+5", "object", "object+1", "object+5"),
    target,
    next_joint_pos,
    reward,
    ResidualConfig,
    measures_effort=lambda settings: settings.power > 0.0,
    smoothing=lambda settings: settings.smoothing,
    action=action,
)
