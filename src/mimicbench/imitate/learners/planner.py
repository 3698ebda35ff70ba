"""The planner over the tracker, by DAgger: imitate.planner is what it is, imitate.learn_planner how it learns."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from mimicbench.core.settings import BadSetting, Positive, Share, Sizes
from mimicbench.envs.settings import ClipStartConfig
from mimicbench.imitate.spec import Given, ImitateConfig, LearnerSpec
from mimicbench.track.settings import EndConfig, TrackingConfig


@dataclass(frozen=True)
class PlannerConfig:
    """The planner's network and its training."""

    hidden: Sizes = (512, 512, 256)
    """Widths of the hidden layers."""
    clock: bool = True
    """See a clock, and settle a style once. Without either, what it does follows from its body and its goal as they are
    now, and so can be learned by who sees no clock, such as ACT and BC, also where that got to itself: if the clock is
    half a second off, what a planner with one says is other by half of its spread."""
    pace: Share = 0.0
    """How often a clip waits for a frame where the robot lags behind it on the way, and leaves one out where it is
    ahead. Who sees no clock cannot know that the clip is ahead, and learns to hurry everywhere."""
    mirrored: bool = False
    """Learn from the mirror images of all clips, too: twice as many starts and objects for nothing."""
    samples: Positive = 3_200_000
    """Control steps to see, over all robots."""
    num_envs: Positive = 256
    """Robots side by side."""
    steps: Positive = 24
    """Control steps between rounds of learning."""
    batches: Positive = 40
    """Batches per round."""
    batch: Positive = 768
    """Frames per batch."""
    memory: Positive = 400_000
    """Most recent frames that are learned from."""
    teacher_share: float = 0.2
    """Part of the training over which the tracker on true references drives ever less."""
    action_weight: float = 0.5
    """Weight of the difference that the plan makes to the tracker's action."""
    learning_rate: float = 1e-3
    """Of Adam at the start; falls to a tenth along a cosine."""
    save_every: float = 120.0
    """Seconds between saves: what a kill can lose at most."""
    threads: Positive = 2
    """Threads of the network's arithmetic. Sums round differently with another number, so it is part of the result."""
    tracking: TrackingConfig = field(
        default_factory=lambda: TrackingConfig(
            ClipStartConfig(first_frame=0.5),
            hold=4.0,
            push=0.2,
            ends=EndConfig(max_pos_error=0.5, max_angle_error=1.0, max_drop=0.25, max_ankle_error=0.3),
        )
    )
    """Starts, disturbances and ends of training episodes. Pushed no harder than what the tracker survives: who falls
    teaches nothing. They hold the last pose long enough for a slow drift to show, and the clock shows all times to the
    time limit meanwhile (imitate.dagger)."""


@dataclass(frozen=True)
class PlannerImitation(ImitateConfig):
    """A planner over the tracker, by DAgger."""

    planner: PlannerConfig = field(default_factory=PlannerConfig)
    also: tuple[str, ...] = ()
    """Other tasks, which the same network learns beside the recipe's task, and is told which; over the tracker of
    several tasks, without clock and style."""
    recorded: tuple[str, ...] = ()
    """Imported or augmented sets of clips, learned from beside the recipe's own at every task that has such a set."""
    begin_from: str = ""
    """Folder of a planner of the same layers, which sees and tells the same, whose network is where learning begins;
    empty: from nothing. It drives from the beginning if `planner.teacher_share` is small."""

    tracker: ClassVar[str | None] = None

    def __post_init__(self) -> None:
        if self.also and self.planner.clock:
            raise BadSetting("a planner of several tasks sees no clock; give --imitate.planner.no-clock")
        if self.planner.num_envs <= len(self.also):
            raise BadSetting(
                f"imitate.planner.num-envs is {self.planner.num_envs} for {1 + len(self.also)} tasks; give at least "
                "one robot for each"
            )

    @property
    def tasks_beside(self) -> tuple[str, ...]:
        """Of one network for several tasks."""
        return self.also

    @property
    def sets_beside(self) -> tuple[str, ...]:
        """Of clips of people."""
        return self.recorded


def learn(folder: Path, given: Given, config: PlannerImitation) -> dict[str, Any]:
    """Learn the planner over the tracker beside it."""
    from mimicbench.core.progress import Pulse
    from mimicbench.envs.vec_env import EnvConfig
    from mimicbench.imitate.learn_planner import train_planner
    from mimicbench.imitate.planner import load_network, save_planner
    from mimicbench.track.checkpoint import load_tracker

    clips, context = (given.clips, *given.beside), given.context
    robot = given.clips.robot
    tracker = load_tracker(folder.parent / "tracker", robot)

    pulse = Pulse(context.say)

    def report(row: dict) -> None:
        speed = row["samples"] / row["seconds"]
        told = f"loss {row['loss']:.4f}  failed {row['failed']:.2f}"
        pulse(lambda: f"{row['samples'] / 1e6:6.2f} M frames  {speed:6.0f}/s  {told}")

    env_config = EnvConfig(device=context.device, workers=context.workers)
    before = load_network(Path(config.begin_from), robot) if config.begin_from else None
    network = train_planner(folder, tracker, clips, config.planner, given.seed, env_config, report, before)
    told = {"clips": sum(map(len, clips)), "samples": config.planner.samples}
    names = [some.task.name for some in clips]
    learned = {"tasks": names} if len(names) > 1 else {"task": names[0]}
    save_planner(folder, robot, network, config.planner, {"seed": given.seed, **learned, **told})
    return told


LEARNER = LearnerSpec("planner", PlannerImitation, learn)
