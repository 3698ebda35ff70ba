"""A trained tracker on disk and in memory."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from mimicbench.core.checkpoint import CONFIG, BadCheckpoint, load_checkpoint, save_checkpoint
from mimicbench.robots.description import Robot
from mimicbench.track.network import TrackerNetwork
from mimicbench.track.registry import TRACKERS
from mimicbench.track.spec import Layout, Tracker

CRITIC = "critic"
"""Folder in a tracker's, where the network that told the values of what it did is kept for who goes on from there."""
MAX_WIDTH, MAX_LAYERS = 8192, 16
"""What a tracker may ask for before its weights have been seen."""


@dataclass(frozen=True)
class TrackerConfig:
    """What a trained tracker is built from."""

    tracker: str
    """Name of its design in the registry."""
    observed: tuple[str, ...]
    """Names of the terms that it observes, in this order."""
    widths: tuple[int, ...]
    """Numbers in each of them."""
    actions: int
    """Width of its action."""
    hidden: tuple[int, ...]
    """Widths of the hidden layers."""
    settings: dict[str, Any] = field(default_factory=dict)
    """The design's own configuration, as plain values."""
    deviation: tuple[float, ...] = ()
    """Standard deviation of each number of its action when training ended, for who goes on from there."""

    @property
    def observations(self) -> int:
        """Width of its observation."""
        return sum(self.widths)


def build_tracker(config: TrackerConfig, tensors: Mapping[str, np.ndarray]) -> Tracker:
    """A tracker of that configuration with these weights. Raises UnknownName, BadCheckpoint."""
    spec = TRACKERS.get(config.tracker)
    try:
        settings = msgspec.convert(config.settings, spec.settings) if spec.settings is not type(None) else None
    except msgspec.ValidationError as error:
        raise BadCheckpoint(f"these are no settings of tracker {spec.name} ({error}); train it again") from None
    network = TrackerNetwork(config.observations, config.actions, config.hidden)
    network.load_tensors(tensors)
    return Tracker(spec, settings, network.eval(), Layout(config.observed, config.widths), config.deviation)


def save_tracker(
    folder: Path,
    robot: Robot,
    config: TrackerConfig,
    tensors: Mapping[str, np.ndarray],
    notes: Mapping[str, Any],
) -> None:
    """Write a tracker's checkpoint."""
    save_checkpoint(folder, "tracker", robot.name, config, tensors, notes)


def save_critic(folder: Path, robot: Robot, config: TrackerConfig, tensors: Mapping[str, np.ndarray]) -> None:
    """Write the critic of a tracker in `folder`."""
    save_checkpoint(folder / CRITIC, CRITIC, robot.name, replace(config, actions=1), tensors)


def load_critic(folder: Path, robot: Robot) -> Mapping[str, np.ndarray] | None:
    """Tensors of the critic of a tracker in `folder`; None if nobody kept it. Raises BadCheckpoint."""
    if not (folder / CRITIC / CONFIG).exists():
        return None
    return _load(folder / CRITIC, CRITIC, robot)[1]


def load_tracker(folder: Path, robot: Robot) -> Tracker:
    """Read a tracker for this robot. Raises BadCheckpoint."""
    return build_tracker(*_load(folder, "tracker", robot))


def _load(folder: Path, kind: str, robot: Robot) -> tuple[TrackerConfig, Mapping[str, np.ndarray]]:
    checkpoint = load_checkpoint(folder, kind, robot.name)
    config = checkpoint.config_as(TrackerConfig)
    widths = (*config.widths, config.observations, config.actions, *config.hidden)
    if (
        not all(1 <= width <= MAX_WIDTH for width in widths)
        or len(config.hidden) > MAX_LAYERS
        or len(config.widths) != len(config.observed)
    ):
        raise BadCheckpoint(
            f"{folder} describes a tracker with a layer outside 1 to {MAX_WIDTH}, or more than {MAX_LAYERS} layers; it "
            "is not one of ours"
        )
    shapes = TrackerNetwork.shapes(config.observations, config.actions, config.hidden)
    return config, checkpoint.matching(shapes)
