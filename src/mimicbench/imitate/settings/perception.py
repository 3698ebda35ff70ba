"""What can be set of how a goal is found in maps."""

from dataclasses import dataclass
from typing import Annotated

from mimicbench.core.settings import Positive, Seed, Sizes, Within


@dataclass(frozen=True)
class PerceptionConfig:
    """The network, the maps that it learns from, and how long."""

    window: int | None = None
    """Side of the window, in cells; None: as large as the task's goal says."""
    widths: Sizes = (24, 48, 64)
    """Channels of the three strided convolutions."""
    hidden: Positive = 128
    """Width of the layer after them."""
    hypotheses: Positive = 4
    """Goals that it weighs against each other, which begin with fronts that are spread evenly around the robot."""
    maps: Positive = 16000
    """Maps to learn from, before turning and mirroring."""
    seen: float = 0.7
    """Share of them that show what the cameras see, rounded up to 64 maps of a batch; the others are complete, or hide
    only what is behind something."""
    heights: Annotated[tuple[float, float], Within(0.1, 10.0)] = (0.4, 1.2)
    """Every object is seen once more, with all of its heights times a number between these; of 1 and 1, it is not. Who
    has only met heights of at least 0.36 m takes one of 0.22 m for as high as that."""
    distance: tuple[float, float] = (0.5, 2.3)
    """[m] From the object's middle to the robot in the training maps; from large objects farther, outside of them."""
    root_height: tuple[float, float] = (0.85, 1.1)
    """[m] Of the root above the floor in the training maps."""
    tilt: float = 0.03
    """[rad] Deviation of the root's roll and pitch in the training maps."""
    noise: float = 0.01
    """[m] Deviation of each cell's height."""
    dropout: float = 0.03
    """Share of cells without a measurement."""
    steps: Positive = 8000
    """Batches."""
    batch: Positive = 128
    """Maps per batch."""
    learning_rate: float = 2e-3
    """At the start; falls to 0 along a cosine."""
    save_every: float = 120.0
    """Seconds between saves: what a kill can lose at most."""
    threads: Positive = 2
    """Threads of the network's arithmetic. Sums round differently with another number, so it is part of the result."""
    seed: Seed = 0
    """Of poses, noise and initial weights."""
