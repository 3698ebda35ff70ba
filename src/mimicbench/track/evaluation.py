"""How a tracker in training does, by its mean action, from the first frame: K, and who stays."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from mimicbench.core.training import METRICS, read_metrics
from mimicbench.envs.clips import ClipSet
from mimicbench.envs.metrics import Verdict
from mimicbench.envs.vec_env import EnvConfig
from mimicbench.track.rollout import RolloutConfig, track_clips
from mimicbench.track.tracker import Tracker


def evaluated(
    tracker: Tracker, clips: Sequence[ClipSet], held_out: Sequence[ClipSet], count: int, env_config: EnvConfig
) -> dict[str, Any]:
    """Shares of about `count` clips of each set, per task and their means: of those on which K is fulfilled, and of
    those on which its condition still holds a second after the clip.

    Means are None, and shares empty, where there are no clips.
    """
    found: dict[str, Any] = {}
    for name, sets in (("train", clips), ("held_out", held_out)):
        verdicts = {some.task.name: _verdict(tracker, some.spread(count), env_config) for some in sets if len(some)}
        for measure, kind in (("k", "success"), ("stays", "stays")):
            rates = {task: float(getattr(verdict, kind).double().mean()) for task, verdict in verdicts.items()}
            found[f"{measure}_{name}"] = sum(rates.values()) / len(rates) if rates else None
            found[f"{measure}_{name}_of"] = rates
    return found


def in_words(row: Mapping[str, Any]) -> str:
    """A line about how far a training is, of what is logged of it and `evaluated`."""
    told = {"training clips": "train", "unseen objects": "held_out"}
    rates = [
        f"{row[f'k_{name}']:.2f} / {row[f'stays_{name}']:.2f} on {words}"
        for words, name in told.items()
        if row[f"k_{name}"] is not None
    ]
    return (
        f"{row['samples'] / 1e6:6.2f} M samples  {row['samples'] / row['seconds']:6.0f}/s  reward "
        f"{row['reward']:.3f}  K / stays {', '.join(rates)}"
    )


def good_enough(row: Mapping[str, Any], until: float) -> bool:
    """Whether `until` or more stay in every task, on training objects: those of the test split choose nothing. At 1 it
    never is enough.
    """
    return until < 1 and min(row["stays_train_of"].values()) >= until


def was_good_enough(folder: Path, progress: Mapping[str, float], until: float) -> bool:
    """Whether the training in a folder ended early, and was killed before anybody was told."""
    rows = read_metrics(folder / METRICS)
    return bool(rows) and rows[-1]["samples"] == progress["samples"] and good_enough(rows[-1], until)


def _verdict(tracker: Tracker, clips: ClipSet, env_config: EnvConfig) -> Verdict:
    return track_clips(tracker, clips, RolloutConfig(leave_fallen=True), env_config).verdict
