"""Improved HST as the paper has it (appendix F): 578 inputs, absolute joint targets, rewards by task."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from mimicbench.core import rotations as rot
from mimicbench.sim.timing import CONTROL_DT
from mimicbench.track.spec import Terms, TrackerSpec

if TYPE_CHECKING:
    from torch import Tensor

    from mimicbench.robots.description import Robot
    from mimicbench.sensors.context import StepContext, Transition
    from mimicbench.sim.physics import LinkState


@dataclass(frozen=True)
class AgreementConfig:
    """Coefficients of agreement with the reference (F.3)."""

    position: float = 5.0
    """Of the links' squared distances in r_pos [1/m^2]."""
    root: float = 5.0
    """Weight of the root's agreement in r_root."""
    distance: float = 10.0
    """Of L1 distances in r_root, r_wrist, r_w->o and r_object [1/m]."""


@dataclass(frozen=True)
class HSTConfig(AgreementConfig):
    """Coefficients of the whole reward (F.3)."""

    action: float = 1e-3
    """Penalty on the squared change of the action."""
    velocity: float = 2e-3
    """Penalty on squared joint velocity errors [s^2/rad^2]."""
    acceleration: float = 5e-7
    """Penalty on squared joint acceleration errors [s^4/rad^2]."""
    energy: float = 1e-6
    """Penalty on the squared mechanical power [1/W^2]."""


def target(robot: Robot, next_joint_pos: Tensor, action: Tensor, settings: AgreementConfig) -> Tensor:
    """(N, J) joint targets [rad]: the action is the joint angle itself (F.2), kept within the limits."""
    low, high = action.new_tensor(robot.joint_range).T
    return action.clamp(low, high)


def action(robot: Robot, next_joint_pos: Tensor, target: Tensor, settings: AgreementConfig) -> Tensor:
    """(N, J) the inverse of `target`: the same."""
    return target


def next_joint_pos(robot: Robot, terms: Terms) -> Tensor:
    """(N, J) joint angles [rad] of the next frame, the first numbers of its target."""
    return terms["body_target"][:, : len(robot.joints)]


def reward(context: StepContext, step: Transition, settings: HSTConfig) -> Tensor:
    """(N,) r_overall of F.3 as written, with the sign of r_energy mended: the text says that it penalizes."""
    return agreement(context, settings) + r_reg(context, step, settings)


def agreement(context: StepContext, settings: AgreementConfig) -> Tensor:
    """(N,) r_human x r_wrist where wrists have targets, r_human x r_w->o x r_object where the object moves (F.3)."""
    from mimicbench.sensors.reference import reference_links

    links, wanted = context.links, reference_links(context.robot, context.reference(0))
    human = r_human(context, links, wanted, settings)
    wrists, wanted_wrists = _wrists(context.robot, links), _wrists(context.robot, wanted)
    if context.task.wrist_goals:
        human = human * near(wrists - wanted_wrists, settings).sum(-1)
    if context.task.moves_object:
        there, to_be = context.object.pos_w, context.reference(0).object.pos_w
        relative = (wrists - there[:, None]) - (wanted_wrists - to_be[:, None])
        human = human * near(relative, settings).sum(-1) * near(there - to_be, settings)
    return human


def near(difference: Tensor, settings: AgreementConfig) -> Tensor:
    """(...) exp(-10 |d|_1) of differences (..., 3) [m]."""
    return (-settings.distance * difference.abs().sum(-1)).exp()


def r_human(context: StepContext, links: LinkState, wanted: LinkState, settings: AgreementConfig) -> Tensor:
    """(N,) r_pos + r_ori + r_root; r_ori is a sum over all links, so 20 at most."""
    r_pos = (-settings.position * ((links.pos_w - wanted.pos_w) ** 2).sum((-1, -2))).exp()
    r_ori = (-rot.angle_between(links.quat_w, wanted.quat_w)).exp().sum(-1)
    away = links.pos_w[:, 0] - wanted.pos_w[:, 0]
    r_root = settings.root * near(away, settings) - context.task.height_weight * away[:, 2] ** 2
    return r_pos + r_ori + r_root


def r_reg(context: StepContext, step: Transition, settings: HSTConfig) -> Tensor:
    """(N,) r_action + r_vel + r_acc + r_energy."""
    state, ref, before = context.state, context.reference(0), step.previous
    acceleration = (state.joint_vel - before.state.joint_vel) / CONTROL_DT
    wanted_acceleration = (ref.joint_vel - before.reference(0).joint_vel) / CONTROL_DT
    return (
        -settings.action * ((step.action - before.last_action) ** 2).sum(-1)
        - settings.velocity * ((state.joint_vel - ref.joint_vel) ** 2).sum(-1)
        - settings.acceleration * ((acceleration - wanted_acceleration) ** 2).sum(-1)
        - settings.energy * step.effort
    )


def _wrists(robot: Robot, links: LinkState) -> Tensor:
    """(N, 2, 3) where left and right wrist are [m]."""
    import torch

    found = []
    for side in ("left", "right"):
        link, offset = robot.keypoints[f"{side}_wrist"]
        away = links.pos_w.new_tensor(offset).expand(len(links.pos_w), 3)
        found.append(links.pos_w[:, link] + rot.rotate(links.quat_w[:, link], away))
    return torch.stack(found, 1)


TRACKER = TrackerSpec(
    "hst",
    "paper",
    ("body", "body_target", "last_action", "gravity", "targets", "object", "object+1"),
    target,
    next_joint_pos,
    reward,
    HSTConfig,
    measures_effort=lambda settings: True,
    action=action,
)
