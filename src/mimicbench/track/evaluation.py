"""How a tracker in training does: K by its mean action, from the first frame."""

from collections.abc import Mapping, Sequence
from typing import Any

from mimicbench.envs.clips import ClipSet
from mimicbench.envs.vec_env import EnvConfig
from mimicbench.track.rollout import RolloutConfig, track_clips
from mimicbench.track.spec import Tracker


def evaluated(
    tracker: Tracker, clips: Sequence[ClipSet], held_out: Sequence[ClipSet], count: int, env_config: EnvConfig
) -> dict[str, Any]:
    """Share of about `count` clips of each set on which K is fulfilled: per task, and their mean.

    None where there are no clips.
    """
    found: dict[str, Any] = {}
    for name, sets in (("k_train", clips), ("k_held_out", held_out)):
        rates = {some.task.name: _success_rate(tracker, some.spread(count), env_config) for some in sets if len(some)}
        found[name] = sum(rates.values()) / len(rates) if rates else None
        found[f"{name}_of"] = rates
    return found


def good_enough(row: Mapping[str, Any], until: float) -> bool:
    """Whether K is `until` or more in every task, on unseen objects where there are any; at 1 it never is enough."""
    rates = row["k_held_out_of"] or row["k_train_of"]
    return until < 1 and min(rates.values()) >= until


def _success_rate(tracker: Tracker, clips: ClipSet, env_config: EnvConfig) -> float:
    verdict = track_clips(tracker, clips, RolloutConfig(stop_early=True), env_config).verdict
    return float(verdict.success.double().mean())
