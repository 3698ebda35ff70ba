"""What can be set of trackers, known without torch."""

from collections.abc import Mapping
from dataclasses import dataclass, field, make_dataclass, replace
from functools import cache
from typing import Annotated, Any

from mimicbench.core.settings import Amount, Positive, Share, Within
from mimicbench.envs.settings import ClipStartConfig
from mimicbench.sim.timing import CONTROL_DT
from mimicbench.track.learning.ppo_config import PPOConfig
from mimicbench.track.registry import TRACKERS

ANYWHERE = 1e3
"""[m] No ankle is ever farther away."""


@dataclass(frozen=True, kw_only=True)
class EndConfig:
    """When the robot of a training episode has failed."""

    max_pos_error: float = 0.4
    """The root is farther than this from its reference [m]; 0.5 in the paper (F.4)."""
    max_angle_error: float = 0.7
    """Its orientation is farther than this [rad]; a large number asks nothing of it."""
    max_drop: float = 0.2
    """It is this much lower [m]."""
    max_ankle_error: float = ANYWHERE
    """An ankle is farther than this from its reference [m]: who is to lie and leaves a leg behind can be upright and in
    place. A large number asks nothing of them."""
    max_object_error: float = 0.3
    """The object, where it moves, is farther than this from its reference [m]."""


@dataclass(frozen=True)
class TrackingConfig:
    """How training episodes start, are disturbed, and end."""

    starts: ClipStartConfig = field(default_factory=ClipStartConfig)
    """Where in their clips they start, and with how much noise."""
    focus: Share = 0.5
    """Share of the starts that are drawn from where in their clips robots fail; the others are drawn from all of it."""
    hold: float = 2.0
    """[s] that episodes go on after their clip is over: its last pose is to be held."""
    push: float = 0.4
    """Standard deviation of the horizontal velocity that a push adds [m/s]."""
    push_interval: Annotated[float, Within(CONTROL_DT, 1e6)] = 2.0
    """Mean time between pushes [s]."""
    assist: Share = 0.0
    """How much of an assisting wrench pulls the root towards its reference at first, for what is lost before anything
    can be learned of it."""
    assist_steps: Positive = 5000
    """Control steps over which it fades to nothing."""
    wait: Share = 0.0
    """Share of the episodes in which the clip waits for a robot whose joints lag behind, for 3 s in all at most."""
    fulfilled: float = 0.0
    """Reward of a control step in which the condition of K holds, beside that of the design, to which a foot that slips
    off an edge is little."""
    ends: EndConfig = field(default_factory=EndConfig)
    """When an episode has failed."""


@dataclass(frozen=True)
class DrivenConfig:
    """How far others may stray."""

    ends: EndConfig = EndConfig(max_pos_error=0.3, max_angle_error=0.5, max_drop=0.15)
    """Where an episode is over: a tracker no longer knows what to do, and what it says to robots that tumble is large
    enough to outweigh all others. A policy that is learned from follows no clip: with it, an episode is over when the
    robot has fallen."""
    settle: float = 2.0
    """[s] that episodes go on after their clip. Beside an expert that follows none they go on to the time limit."""
    at_once: Share = 0.0
    """Part of the episodes in which the policy drives from the first frame on, as it will in use."""


@dataclass(frozen=True)
class DistillConfig:
    """How a tracker learns from teachers, if it has any."""

    noise: float = 0.1
    """Standard deviation of what is added to the learner's actions, so that more is seen than it would lead to."""
    batch: Positive = 1024
    """Frames in a step of the optimizer (Adam); every frame is learned from once."""
    learning_rate: float = 5e-4
    """Of all steps: it never falls, and what is kept is the average below."""
    average: Share = 0.999
    """Decay of the moving average of the weights, which is what is kept; 0: the last weights."""
    max_grad_norm: float = 1.0
    """Longest gradient."""


@dataclass(frozen=True)
class TrackConfig:
    """A tracker's training."""

    tracker: str = "residual"
    """Its design: a name of the registry."""
    settings: Any = None
    """The design's own configuration; None: its defaults."""
    network: Any = None
    """Its network, where the design has a kind of its own; None: that by default, or linear layers of `ppo.hidden`."""
    frames: Annotated[int, Within(0, 256)] = 0
    """Frames that the network sees at once, the present one and those before it; 0: as many as the design says."""
    also: tuple[str, ...] = ()
    """Other tasks, whose clips the same network learns to follow beside those of the recipe's task."""
    recorded: tuple[str, ...] = ()
    """Imported or augmented sets of clips, learned from beside the recipe's own at every task that has such a set."""
    mirrored: bool = False
    """Learn from the mirror image of every clip, beside that of its object, as well."""
    begin_from: str = ""
    """Folder of a trained tracker of the same design, whose network is where learning begins; empty: from nothing."""
    teachers: tuple[str, ...] = ()
    """Folders of trackers, one for each task, the recipe's own first: learn what they would do where this one gets to
    (DAgger, `distill`), and not by reward."""
    critic_first: Annotated[int, Within(0, 1e6)] = 50
    """Updates after such a beginning in which the critic learns alone: it begins from nothing, or, where it was kept
    beside the tracker, has to learn what has changed."""
    explore_anew: bool = False
    """Begin with deviations of `ppo.initial_std`, not with those that the tracker to begin from came to: who is sure of
    what he does tries nothing else, and the divergence of a small deviation lets no rate but a tiny one through."""
    samples: Annotated[int, Amount()] = 30_000_000
    """Control steps to learn from, over all robots, at most."""
    until: Annotated[float, Amount(0, 1)] = 1.0
    """Share of robots that have to stay for training to be over: in every task, by an evaluation on training objects,
    for unseen ones are to choose nothing. At 1 it never is, for there are few clips in an evaluation."""
    num_envs: Positive = 1024
    """Robots side by side, over all tasks."""
    shares: tuple[Annotated[float, Within(1e-3, 1e3)], ...] = ()
    """How many robots each task gets in relation to the others, the recipe's own first; empty: all the same."""
    parts: Positive = 2
    """Parts that they are split into, at least one per task: while one is in Python, another's physics runs."""
    evaluate_every: Positive = 4_000_000
    """Samples between evaluations from the first frame."""
    evaluate_clips: Positive = 64
    """Clips of each task in an evaluation."""
    save_every: float = 120.0
    """Seconds between saves of the training state: what a kill can lose at most."""
    threads: Positive = 2
    """Threads of the network's arithmetic. Sums round differently with another number, so it is part of the result."""
    ppo: PPOConfig = field(default_factory=PPOConfig)
    """The reinforcement learning, and the sizes of networks and rounds."""
    distill: DistillConfig = field(default_factory=DistillConfig)
    """The learning from teachers."""
    tracking: TrackingConfig = field(default_factory=TrackingConfig)
    """How training episodes start, are disturbed, and end."""

    @property
    def learned_from(self) -> dict[str, str]:
        """Folders of the trackers that it is made from, by what they are to it."""
        begun = {"begin_from": self.begin_from} if self.begin_from else {}
        taught = zip(("own", *self.also), self.teachers, strict=False)
        return begun | {f"teacher/{task}": folder for task, folder in taught}

    @staticmethod
    def chosen(tree: Mapping[str, Any]) -> type["TrackConfig"]:
        """The class of the design that a tree of values names, with its settings. Raises UnknownName."""
        return _of_design(str(tree.get("tracker", TrackConfig.tracker)))

    def resolved(self) -> "TrackConfig":
        """The same with the design's own configurations in it. Raises UnknownName."""
        spec = TRACKERS.get(self.tracker)
        settings, network = self.settings, self.network
        if settings is None and spec.settings is not type(None):
            settings = spec.settings()
        if network is None and spec.network is not None:
            network = spec.network()
        return replace(self, settings=settings, network=network)


@cache
def _of_design(tracker: str) -> type[TrackConfig]:
    spec = TRACKERS.get(tracker)
    made: list[Any] = [("tracker", str, field(default=tracker))]
    if spec.settings is not type(None):
        made.append(("settings", spec.settings, field(default_factory=spec.settings)))
    if spec.network is not None:
        made.append(("network", spec.network, field(default_factory=spec.network)))
    return make_dataclass("TrackConfig", made, bases=(TrackConfig,), frozen=True)
