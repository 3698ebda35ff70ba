"""Who demonstrates, as a recipe says it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from mimicbench.benchmark.keys import Run, expert_folder
from mimicbench.core.errors import UnknownName
from mimicbench.core.settings import BadSetting
from mimicbench.core.stage import Stage, StageKey, read_stage
from mimicbench.objects.make import MADE

if TYPE_CHECKING:
    from mimicbench.track.experts import Expert


def expert_of(run: Run, tracker: Path) -> Expert:
    """The tracker in a folder on its clips, or the policy that the recipe names. Raises BadFile if it is not there."""
    from mimicbench.policies.loading import load_policy
    from mimicbench.track.checkpoint import load_tracker
    from mimicbench.track.experts import ClipExpert, SensingExpert

    folder = expert_folder(run, tracker)
    if folder == tracker:
        return ClipExpert(load_tracker(tracker, run.robot), run.robot)
    return SensingExpert(load_policy(folder, run.robot, run.task))


def who_demonstrated(run: Run, demos: Stage, tracker: Path) -> tuple[Expert | None, bool]:
    """Who demonstrated, for rounds of DAgger, and whether it followed clips; None where nobody here can have done that.

    Raises BadSetting if there are to be rounds nevertheless.
    """
    from mimicbench.benchmark.published import follow_clips

    if run.part("demos").source == MADE or follow_clips(demos):
        expert = expert_of(run, tracker)
        return expert, expert.follows
    if run.part("imitate").dagger.rounds:
        raise BadSetting(
            f"the demonstrations {run.part('demos').source!r} follow no clips, so the tracker cannot have made them, "
            "and who did is not told: leave imitate.dagger.rounds out, or make demonstrations here (demos.expert)"
        )
    return None, False


def demonstrated_gains(run: Run, demos: Stage, tracker: Path) -> str:
    """Which of the robot's gains demonstrations were made with, as their data set says.

    Those of before that was recorded were made by whom the recipe names, as their key says. Published ones, of which
    examples/sample is one, were made by the tracker of their own recipe: of the sample that is `residual`, which drives
    `improved`. Raises UnknownName if the robot has no such gains.
    """
    from mimicbench.imitate.lerobot import DATASET, recorded_gains
    from mimicbench.track.registry import TRACKERS

    gains = recorded_gains(demos.folder / DATASET)
    if gains is None and run.part("demos").source != MADE:
        name = demos.header.get("recipe", {}).get("track", {}).get("tracker")
        gains = TRACKERS.get(name).gains if name and "tracker" in demos.header["made_from"] else None
    if gains is None:
        gains = expert_of(run, tracker).gains
    if gains not in run.robot.gains:
        raise UnknownName("gains", gains, list(run.robot.gains))
    return gains


def cloned_gains(run: Run, demos: Stage, tracker: Path) -> str:
    """Which gains a clone of demonstrations drives: theirs. Raises BadSetting if the recipe wants others."""
    gains, wanted = demonstrated_gains(run, demos, tracker), run.part("imitate").gains
    if wanted not in (None, gains):
        raise BadSetting(
            f"imitate.gains is {wanted!r}, but the demonstrations were made with {gains!r}; leave imitate.gains out"
        )
    return gains


def tell_unfinished(run: Run, folder: Path, wanted: StageKey) -> None:
    """Say if the tracker that was trained here was trained for less than the recipe says."""
    have = read_stage(folder).header["amounts"]
    if have.get("samples", 0) < wanted.amounts["samples"]:
        run.context.say(
            f"taking the tracker that was trained here for {have['samples'] / 1e6:g} of "
            f"{wanted.amounts['samples'] / 1e6:g} M samples; `mimicbench track` goes on with it"
        )
