"""Networks that clone demonstrations, on disk."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mimicbench.core.building import built
from mimicbench.core.checkpoint import load_checkpoint, save_checkpoint
from mimicbench.imitate.inputs import Learner


def save_learner(folder: Path, learner: Learner, robot: str, notes: Mapping[str, Any] | None = None) -> None:
    """Write a checkpoint whose kind is the network's."""
    tensors = {name: value.detach().cpu().numpy() for name, value in learner.state_dict().items()}
    save_checkpoint(folder, learner.kind, robot, learner.config, tensors, notes)


def load_learner(folder: Path, robot: str, config_type: type) -> tuple[Learner, Mapping[str, Any]]:
    """Read what `save_learner` wrote, and its notes. Raises BadCheckpoint."""
    checkpoint = load_checkpoint(folder, robot=robot)
    config = checkpoint.config_as(config_type)
    return built(checkpoint, config.build, config.layers), checkpoint.notes
