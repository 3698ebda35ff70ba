"""A trained tracker on disk and in memory."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mimicbench.core.checkpoint import BadCheckpoint, load_checkpoint, save_checkpoint
from mimicbench.robots.description import Robot
from mimicbench.track.network import TrackerNetwork
from mimicbench.track.tracker import TrackerKind, get_kind

MAX_WIDTH, MAX_LAYERS = 8192, 16
"""What a tracker may ask for before its weights have been seen."""


@dataclass(frozen=True)
class TrackerConfig:
    """What a tracker's network is built from."""

    preset: str
    """Name of the tracker's kind."""
    observations: int
    """Width of its observation."""
    actions: int
    """Width of its action."""
    hidden: tuple[int, ...]
    """Widths of the hidden layers."""


@dataclass(frozen=True)
class Tracker:
    """A tracker ready to run."""

    kind: TrackerKind
    config: TrackerConfig
    network: TrackerNetwork


def save_tracker(
    folder: Path, robot: Robot, config: TrackerConfig, tensors: Mapping[str, np.ndarray], notes: Mapping[str, Any]
) -> None:
    """Write a tracker's checkpoint."""
    save_checkpoint(folder, "tracker", robot.name, config, tensors, notes)


def load_tracker(folder: Path, robot: Robot) -> Tracker:
    """Read a tracker for this robot. Raises BadCheckpoint."""
    checkpoint = load_checkpoint(folder, "tracker", robot.name)
    config = checkpoint.config_as(TrackerConfig)
    if max(config.observations, config.actions, *config.hidden) > MAX_WIDTH or len(config.hidden) > MAX_LAYERS:
        raise BadCheckpoint(
            f"{folder} describes a tracker wider than {MAX_WIDTH} or deeper than {MAX_LAYERS} layers; "
            "it is not one of ours"
        )
    network = TrackerNetwork(config.observations, config.actions, config.hidden)
    network.load_tensors(
        checkpoint.matching({name: tuple(value.shape) for name, value in network.state_dict().items()})
    )
    network.eval()
    return Tracker(get_kind(config.preset), config, network)
