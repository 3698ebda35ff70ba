"""Who demonstrates, as a recipe says it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from mimicbench.benchmark.keys import Run, expert_folder

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
