"""A trained tracker on disk and in memory."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mimicbench.core.checkpoint import load_checkpoint, save_checkpoint
from mimicbench.robot.description import Robot
from mimicbench.track.network import TrackerNetwork
from mimicbench.track.tracker import TrackerKind, get_kind


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


def save_tracker(folder: Path, robot: Robot, config: TrackerConfig, tensors: Mapping[str, np.ndarray], notes: Mapping[str, Any]) -> None:
    """Write a tracker's checkpoint."""
    save_checkpoint(folder, "tracker", robot.name, config, tensors, notes)


def load_tracker(folder: Path, robot: Robot) -> Tracker:
    """Read a tracker for this robot. Raises BadCheckpoint."""
    checkpoint = load_checkpoint(folder, "tracker", robot.name)
    config = checkpoint.config_as(TrackerConfig)
    network = TrackerNetwork(config.observations, config.actions, config.hidden)
    network.load_tensors(checkpoint.matching({name: tuple(value.shape) for name, value in network.state_dict().items()}))
    network.eval()
    return Tracker(get_kind(config.preset), config, network)
