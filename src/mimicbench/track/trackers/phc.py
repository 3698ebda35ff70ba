"""Simplified PHC as the paper has it (appendix F): improved HST that is also told the differences to its target, 698
inputs, and pays nothing for haste.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from mimicbench.track.spec import TrackerSpec
from mimicbench.track.trackers.hst import AgreementConfig, action, agreement, next_joint_pos, target

if TYPE_CHECKING:
    from torch import Tensor

    from mimicbench.sensors.context import StepContext, Transition


def reward(context: StepContext, step: Transition, settings: AgreementConfig) -> Tensor:
    """(N,) the reward of improved HST without its regularizers (F.3)."""
    return agreement(context, settings)


TRACKER = TrackerSpec(
    "phc",
    "paper",
    (
        "body",
        "body_target",
        "body_difference",
        "last_action",
        "gravity",
        "targets",
        "object",
        "object+1",
    ),
    target,
    next_joint_pos,
    reward,
    AgreementConfig,
    action=action,
)
