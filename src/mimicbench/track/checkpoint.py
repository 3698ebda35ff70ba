"""A trained tracker on disk and in memory."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import torch

from mimicbench.core.building import built
from mimicbench.core.checkpoint import CONFIG, BadCheckpoint, checkpoint_digest, load_checkpoint, save_checkpoint
from mimicbench.robots.description import Robot
from mimicbench.track.network import Blueprint, MLPConfig, NetworkConfig, TrackerNetwork
from mimicbench.track.registry import TRACKERS
from mimicbench.track.spec import TrackerSpec
from mimicbench.track.tracker import Layout, Tracker

CRITIC = "critic"
"""Folder in a tracker's, where the network that told the values of what it did is kept for who goes on from there."""
MAX_WIDTH, MAX_LAYERS, MAX_FRAMES = 8192, 16, 256
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
    """Widths of the hidden layers, where they are such layers."""
    settings: dict[str, Any] = field(default_factory=dict)
    """The design's own configuration, as plain values."""
    deviation: tuple[float, ...] = ()
    """Standard deviation of each number of its action when training ended, for who goes on from there."""
    frames: int = 1
    """Frames that its network sees: the present one and those before it."""
    network: dict[str, Any] | None = None
    """Configuration of a network of its design's own kind, as plain values; None: linear layers, `hidden` wide."""

    def layout(self) -> Layout:
        """How its input is laid out. Raises UnknownName."""
        return Layout.known(TRACKERS.get(self.tracker), self.observed, self.widths, self.frames)

    def blueprint(self) -> Blueprint:
        """What its networks are built by. Raises UnknownName, BadCheckpoint."""
        return self.layout().blueprint(_network_of(TRACKERS.get(self.tracker), self))


def _network_of(spec: TrackerSpec, config: TrackerConfig) -> NetworkConfig:
    if config.network is None:
        return MLPConfig(config.hidden)
    if spec.network is None:
        raise BadCheckpoint(f"tracker {spec.name} has no kind of network of its own any more; train it again")
    return _converted(spec, config.network, spec.network)


def _converted(spec: TrackerSpec, values: Mapping[str, Any], kind: type) -> Any:
    try:
        return msgspec.convert(values, kind)
    except msgspec.ValidationError as error:
        raise BadCheckpoint(f"these are no settings of tracker {spec.name} ({error}); train it again") from None


def build_tracker(config: TrackerConfig, tensors: Mapping[str, np.ndarray]) -> Tracker:
    """A tracker of that configuration with these weights. Raises UnknownName, BadCheckpoint."""
    with torch.random.fork_rng(devices=[]):  # first weights are not kept, and who learns draws on as if there were none
        network = config.blueprint().network(config.actions)
    network.load_tensors(tensors)
    return _tracker_of(config, network)


def _tracker_of(config: TrackerConfig, network: TrackerNetwork) -> Tracker:
    spec = TRACKERS.get(config.tracker)
    settings = _converted(spec, config.settings, spec.settings) if spec.settings is not type(None) else None
    return Tracker(spec, settings, network.eval(), config.layout(), config.deviation)


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
    return _load(folder / CRITIC, CRITIC, robot)[1].tensors()


def tracker_digest(folder: Path) -> str:
    """Stands for all that goes on from a tracker: its network, and its critic if it was kept. Raises BadCheckpoint."""
    kept = folder / CRITIC
    return checkpoint_digest(folder) + (checkpoint_digest(kept) if (kept / CONFIG).exists() else "")


def load_tracker(folder: Path, robot: Robot) -> Tracker:
    """Read a tracker for this robot. Raises BadCheckpoint."""
    return _tracker_of(*_load(folder, "tracker", robot))


def _load(folder: Path, kind: str, robot: Robot) -> tuple[TrackerConfig, TrackerNetwork]:
    checkpoint = load_checkpoint(folder, kind, robot.name)
    config = checkpoint.config_as(TrackerConfig)
    widths = (*config.widths, sum(config.widths), config.actions, *config.hidden)
    if (
        not all(1 <= width <= MAX_WIDTH for width in widths)
        or len(config.hidden) > MAX_LAYERS
        or not 1 <= config.frames <= MAX_FRAMES
        or len(config.widths) != len(config.observed)
    ):
        raise BadCheckpoint(
            f"{folder} describes a tracker with a layer outside 1 to {MAX_WIDTH}, or more than {MAX_LAYERS} layers; it "
            "is not one of ours"
        )
    blueprint = config.blueprint()
    return config, built(checkpoint, lambda: blueprint.network(config.actions), blueprint.config.repeats)
