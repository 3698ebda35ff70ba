"""How fast retargeting is, on synthetic clips of the tasks."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass

from mimicbench.objects.registry import FAMILIES
from mimicbench.references.paper import PAPER_SETS
from mimicbench.references.synthesis.registry import synthesize
from mimicbench.report.table import Table
from mimicbench.retarget.baselines.speed import RetargetBenchConfig, bench_retargeting
from mimicbench.retarget.clip import Clip
from mimicbench.robots.registry import DEFAULT_ROBOT, ROBOTS
from mimicbench.tasks.registry import TASKS


@dataclass(frozen=True)
class ClipsConfig:
    """Which clips are retargeted."""

    tasks: tuple[str, ...]
    """The first one's first clip is also what Adam and mink get."""
    clips: int = 2
    """Of each task, each on an object of its own."""
    robot: str = DEFAULT_ROBOT
    seed: int = 0


def bench(clips: ClipsConfig, config: RetargetBenchConfig, say: Callable[[str], None]) -> dict[str, object]:
    """Measure the methods; see retarget.bench.bench_retargeting."""
    robot, made, paper = ROBOTS.get(clips.robot), {}, {}
    for slug in clips.tasks:
        objects = [FAMILIES.get(TASKS.get(slug).family).make(index, clips.seed) for index in range(clips.clips)]
        made[slug] = [Clip(synthesize(slug, index, obj, clips.seed), obj, robot) for index, obj in enumerate(objects)]
        known = PAPER_SETS.get(slug)  # tasks of others have no clips in the paper
        paper[slug] = known.clips * known.duration[0] * made[slug][0].motion.fps if known else 0.0
    return {**bench_retargeting(made, paper, config, say), "clips": asdict(clips), "config": asdict(config)}


def speed_table(found: dict, tasks: Sequence[str]) -> Table:
    """Frames per second of one core by method and task."""
    rows = [
        (
            name,
            *(round(by_task[task]) for task in tasks),
            round(by_task["all"]),
            round(found["two_core_hours"][name], 2),
        )
        for name, by_task in found["frames_per_second"].items()
    ]
    adam, mink, ratios = found["adam"], found["mink"], found["ratios"]
    note = (
        f"On the paper's loss, {adam['frames']} frames: the banded solver "
        f"{found['solver_frames_per_second']:.0f} frames/s at a loss of "
        f"{adam['solver_loss']:.6f} ({adam['solver_converged_loss']:.6f} if it goes on); Adam, "
        f"{adam['epochs']} epochs, {adam['frames_per_second']:.1f} "
        f"frames/s at {adam['loss']:.6f} ({adam['falling_rate_loss']:.6f} with a falling rate), "
        f"{ratios['solver_over_adam']:.0f} times slower. "
    )
    if "left_out" in mink:
        note += f"mink: {mink['left_out']}."
    else:
        note += (
            f"mink: {mink['frames_per_second']:.0f} frames/s, {mink['programs_per_frame']:.1f} programs per frame, "
            f"{ratios['solver_over_mink']:.1f} times slower, points "
            f"{100 * mink['position_error']:.1f} cm off, the solver's {100 * mink['solver_position_error']:.1f} cm."
        )
    note += f" Memory grew by {found['memory_growth_mb']:.1f} MB over a second round."
    columns = ("Method", *tasks, "all", "Hours of two cores for the paper's clips")
    return Table("retargeting-speed", "Frames per second of one core", columns, tuple(rows), note)
