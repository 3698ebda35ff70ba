"""What can be set of how demonstrations are cloned."""

from dataclasses import dataclass, field
from typing import Annotated, Literal

from mimicbench.core.settings import Positive, Share, Within
from mimicbench.track.settings import DrivenConfig


@dataclass(frozen=True)
class MapErrors:
    """What is wrong with the elevation maps that are learned from, drawn anew for each of them: a robot's own are less
    than perfect, too.
    """

    cells: Annotated[float, Within(0, 10)] = 0.0
    """[m] deviation of the height of each cell."""
    height: Annotated[float, Within(0, 10)] = 0.0
    """[m] deviation of the height of all of them together."""
    missing: Share = 0.0
    """Part of the squares of 8 x 8 cells of which nothing is known, so that they are at floor level."""
    shift: Annotated[float, Within(0, 64)] = 0.0
    """[cells] deviation of how far the map is shifted, forward and to the side."""
    late: Annotated[int, Within(0, 1000)] = 0
    """[control steps] A map is up to so old, seen from where the robot was then."""


@dataclass(frozen=True)
class TrainConfig:
    """How long and how. The defaults are for a CPU."""

    steps: Positive = 3000
    """Batches to learn from: a faster machine gets the same network, sooner."""
    batch: Positive = 128
    """Frames per batch."""
    driven: Share = 0.0
    """Part of every batch that comes from what a learner got into itself (DAgger); 0 for as much of it as there is of
    all frames. Demonstrations are many and alike, and what goes wrong is rare."""
    wrong: Share = 0.0
    """Part of these that is drawn by how far the learner was from what it should have done: to stand still where one
    ought to go on is wrong in few frames, and for ever."""
    soon: Share = 0.0
    """Part of every batch that comes from the first second of episodes. All begin at rest, and who does not take the
    first step as it has to be taken slowly sinks and tips over, whatever it knows of later ones."""
    maps: MapErrors = field(default_factory=MapErrors)
    """What is wrong with the elevation maps that are learned from."""
    learning_rate: float = 1e-3
    """The highest."""
    schedule: Literal["cosine", "constant"] = "cosine"
    """`cosine`: falls to 0 over all batches; `constant`."""
    warmup: float = 0.02
    """Share of the batches over which the learning rate rises from 0."""
    weight_decay: float = 1e-4
    """Of AdamW."""
    betas: tuple[float, float] = (0.9, 0.999)
    """Decay of AdamW's averages of the gradient and of its square."""
    clip: float = 1.0
    """Longest gradient; 0 for no limit."""
    average: float = 0.999
    """Decay of the moving average of the weights, which is what is kept; 0 for the weights themselves."""
    save_every: float = 120.0
    """Seconds between saves: what a kill can lose at most."""
    log_steps: Positive = 50
    """Batches per line of metrics.jsonl."""
    precision: Literal["float32", "bfloat16"] = "float32"
    """Of the products of matrices; weights, and what the network does in use, stay float32. Worth it where a processor
    multiplies bfloat16 (avx512_bf16, amx_bf16 in /proc/cpuinfo), on recent GPUs, and for large networks."""
    threads: Positive = 2
    """Of torch, for the network; how sums are rounded depends on it, so it is not left to the machine."""


@dataclass(frozen=True)
class DaggerConfig:
    """What a cloner learns from beside the demonstrations: what it got into itself, and what who demonstrated would
    have done there (DAgger, Ross et al. 2011).
    """

    rounds: Annotated[int, Within(0, 1000)] = 0
    """How often, between trainings of all its batches, it drives robots for more frames to learn from."""
    clips: Positive = 128
    """Training clips, drawn anew in each round, on which it drives from a random moment on."""
    batch: Positive = 64
    """Clips side by side, and a shard of the data set."""
    driven: DrivenConfig = field(default_factory=DrivenConfig)
    rounds_of: tuple[str, ...] = ()
    """Folders of other policies that cloned the same demonstrations: from what they got into in their rounds is learned
    too, before the rounds of one's own. What one learner ran into serves others, who are then compared on the same
    frames, or learn in one long training what took it many short ones."""
