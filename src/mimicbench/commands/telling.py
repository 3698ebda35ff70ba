"""How commands tell what came of them: words for people, or one line of JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from math import isfinite
from typing import TYPE_CHECKING, Any

from mimicbench.core.names import printable

if TYPE_CHECKING:
    from mimicbench.core.stage import Stage
    from mimicbench.evaluate.rows import EpisodeRow


def tell(found: Sequence[Mapping[str, Any]], as_json: bool, words: str) -> None:
    """Print `words`, or what was found as one line: an object, or a list of them where there are several.

    Names of folders are among the words, and are not to steer the terminal.
    """
    print(one_line(found[0] if len(found) == 1 else found) if as_json else printable(words, lines=True))


def one_line(found: Any) -> str:
    """Plain values as one line of JSON, which has no NaN and no infinity: what was not measured is null."""
    return json.dumps(_finite(found), allow_nan=False)


def _finite(found: Any) -> Any:
    if isinstance(found, Mapping):
        return {name: _finite(value) for name, value in found.items()}
    if isinstance(found, list | tuple):
        return [_finite(value) for value in found]
    return None if isinstance(found, float) and not isfinite(found) else found


def stage_summary(stage: Stage) -> dict[str, Any]:
    """What a stage came to, as plain values."""
    header = stage.header
    return {"stage": header["stage"], "task": header["task"], "folder": str(stage.folder), **stage.summary}


def stage_line(stage: Stage) -> str:
    """What a stage came to, in one line."""
    told = (f"{name} {f'{value:.3g}' if isinstance(value, float) else value}" for name, value in stage.summary.items())
    return f"{stage.header['stage']}: {', '.join(told)} ({stage.folder})"


def tell_rates(groups: Sequence[Sequence[EpisodeRow]], as_json: bool) -> None:
    """Print the rates of each group of episodes, of one policy each."""
    from mimicbench.evaluate.rows import summarize
    from mimicbench.report.table import to_terminal
    from mimicbench.report.tables.results import results_table

    found = [summarize(rows) for rows in groups]
    if as_json:
        tell([one.to_dict() for one in found], True, "")
        return
    for task in dict.fromkeys(one.task for one in found):
        print(to_terminal(results_table([one for one in found if one.task == task])))
    for one in found:
        for error, episodes in one.errors.items():
            numbers = ", ".join(map(str, episodes))
            print(f"{one.policy} failed {len(episodes)} of {one.kinematic.episodes} episodes: {error} (in {numbers})")
