"""The planner over the tracker, by DAgger: imitate.planner is what it is, imitate.learn_planner how it learns."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from mimicbench.core.progress import Pulse
from mimicbench.envs.vec_env import EnvConfig
from mimicbench.imitate.learn_planner import train_planner
from mimicbench.imitate.planner import PlannerConfig, load_network, save_planner
from mimicbench.imitate.spec import Given, ImitateConfig, LearnerSpec
from mimicbench.track.checkpoint import load_tracker


@dataclass(frozen=True)
class PlannerImitation(ImitateConfig):
    """A planner over the tracker, by DAgger."""

    planner: PlannerConfig = field(default_factory=PlannerConfig)
    begin_from: str = ""
    """Folder of a planner of the same layers, which sees and tells the same, whose network is where learning begins;
    empty: from nothing. It drives from the beginning if `planner.teacher_share` is small."""

    tracker: ClassVar[str | None] = None


def learn(folder: Path, given: Given, config: PlannerImitation) -> dict[str, Any]:
    """Learn the planner over the tracker beside it."""
    clips, context = given.clips, given.context
    tracker = load_tracker(folder.parent / "tracker", clips.robot)

    pulse = Pulse(context.say)

    def report(row: dict) -> None:
        speed = row["samples"] / row["seconds"]
        told = f"loss {row['loss']:.4f}  failed {row['failed']:.2f}"
        pulse(lambda: f"{row['samples'] / 1e6:6.2f} M frames  {speed:6.0f}/s  {told}")

    env_config = EnvConfig(device=context.device, workers=context.workers)
    before = load_network(Path(config.begin_from), clips.robot) if config.begin_from else None
    network = train_planner(folder, tracker, clips, config.planner, given.seed, env_config, report, before)
    told = {"clips": len(clips), "samples": config.planner.samples}
    save_planner(folder, clips.robot, network, config.planner, {"seed": given.seed, "task": clips.task.name, **told})
    return told


LEARNER = LearnerSpec("planner", PlannerImitation, learn)
