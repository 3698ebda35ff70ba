"""Networks that clone demonstrations, on disk."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from mimicbench.core.building import built
from mimicbench.core.checkpoint import load_checkpoint, save_checkpoint
from mimicbench.core.errors import MimicbenchError
from mimicbench.imitate.inputs import Learner
from mimicbench.imitate.settings.inputs import NetworkConfig
from mimicbench.robots.description import Robot


def save_learner(folder: Path, learner: Learner, robot: str, notes: Mapping[str, Any] | None = None) -> None:
    """Write a checkpoint whose kind is the network's."""
    tensors = {name: value.detach().cpu().numpy() for name, value in learner.state_dict().items()}
    save_checkpoint(folder, learner.kind, robot, learner.config, tensors, notes)


def load_learner(folder: Path, robot: Robot, config_type: type[NetworkConfig]) -> tuple[Learner, Mapping[str, Any]]:
    """Read what `save_learner` wrote, and its notes. Raises BadCheckpoint."""
    checkpoint = load_checkpoint(folder, robot=robot.name)
    config = checkpoint.config_as(config_type)
    if not config.inputs.joints:  # those of 0.1.0 do not say
        config = replace(config, inputs=config.inputs.on(robot))
    if "cameras" not in (checkpoint.config.get("inputs") or {}):  # those of before saw what rays straight down see
        config = replace(config, inputs=replace(config.inputs, cameras=False))
    return built(checkpoint, config.build, config.layers), checkpoint.notes


def take_over(learner: Learner, begin_from: Learner) -> None:
    """Weights and statistics of another network, where that has them. Raises MimicbenchError if it has others.

    A head that found the goals of another task is left out: what it found is something else.
    """
    own, given = learner.state_dict(), begin_from.state_dict()
    if learner.config.goal_size != begin_from.config.goal_size:
        given = {name: value for name, value in given.items() if not name.startswith("finds.")}
    for name, value in given.items():
        if name not in own or own[name].shape != value.shape:
            raise MimicbenchError(
                f"{name} of the policy to begin from has the shape {tuple(value.shape)}, and not what this network's "
                "configuration makes of it; begin from a policy of the same sizes and inputs"
            )
    learner.load_state_dict({**own, **given})
