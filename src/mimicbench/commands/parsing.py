"""From a command line to a recipe, in two passes.

The first looks for the names that settle which settings there are: presets, a file, the task, the tracker, the learner.
The second is tyro's, over the recipe as those have left it. Within a command, the settings of its own stage may be
given without the stage's name: `mimicbench track --samples 1e6` is `mimicbench track --track.samples 1e6`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import Field, dataclass, field, fields, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import tyro

from mimicbench.benchmark.recipe import PARTS, Common, Recipe, check_recipe, read_recipe, recipe_tree, stage_type
from mimicbench.core.run import RunContext
from mimicbench.core.settings import BadSetting, merge

CHOOSING = ("imitate.learner", "track.tracker")
"""Settings on which depends what other settings there are."""
ALL = "all"


@dataclass(frozen=True)
class Options:
    """How and where to run: no part of any result."""

    workdir: Path = Path("work")
    """Where all artefacts go, in <workdir>/<task>/<stage>/<words>-<digest>."""
    preset: tuple[str, ...] = ()
    """Named recipes to begin with, the last one first: see docs/recipes.md."""
    config: Path | None = None
    """A TOML file with a recipe, on top of the presets."""
    workers: int = 0
    """Threads or processes; 0 for all processors."""
    device: str = "cpu"
    """What computes the physics: cpu, cuda, cuda:1 (MuJoCo Warp on a GPU), or warp-cpu (slow, for tests)."""
    json: bool = False
    """Print the summary as one line of JSON and nothing else on stdout."""

    def context(self) -> RunContext:
        """How stages are to run. Raises MimicbenchError."""
        return RunContext(self.workers, self.device, quiet=self.json)


@dataclass(frozen=True)
class Call:
    """A command line that has been read and checked."""

    options: Any
    """An Options, or what the command has in its place."""
    recipes: tuple[Recipe, ...]
    """One per task."""


def read_call(
    stage: str,
    argv: Sequence[str],
    kind: type[Options] = Options,
    presets: Sequence[str] = (),
    command: str | None = None,
) -> Call:
    """Read the arguments of a stage's command.

    Args:
        stage: Its part of the recipe; settings of this and earlier parts are understood.
        argv: What follows the command.
        kind: The command's options.
        presets: Come before those that the user names.
        command: Its name, if not the stage's.

    Raises:
        BadSetting: A recipe is not possible. Nothing has been done yet.
    """
    if said(argv, "workdir") == "":
        raise BadSetting("--workdir is empty; give a folder, such as --workdir work")
    task = said(argv, "task")
    if task != ALL:
        options, recipe = _read(stage, argv, kind, presets, command or stage)
        return Call(options, (recipe,))
    from mimicbench.tasks.registry import TASKS

    found = [_read(stage, list(_with_task(argv, name)), kind, presets, command or stage) for name in TASKS]
    return Call(found[0][0], tuple(recipe for _, recipe in found))


def said(argv: Sequence[str], name: str) -> str | None:
    """The last value of `--name` on a command line; None if it is not there."""
    found = None
    for i, word in enumerate(argv):
        flag, equals, value = word.partition("=")
        if flag.startswith("--") and flag[2:].replace("_", "-") == name.replace("_", "-"):
            found = value if equals else next(iter(argv[i + 1 :]), None)
    return found


def _read(
    stage: str, argv: Sequence[str], kind: type[Options], presets: Sequence[str], command: str
) -> tuple[Any, Recipe]:
    parts = PARTS[: PARTS.index(stage) + 1]
    names: dict[str, Any] = {}
    for name in ("task", *CHOOSING):
        value = said(argv, name) or said(argv, name.removeprefix(f"{stage}."))
        if value is not None:
            names = merge(names, _nested(name, value))
    file = said(argv, "config")
    chosen = [*presets, *_presets(argv)]
    tree = recipe_tree(chosen, None if file is None else Path(file), names)
    recipe = read_recipe(tree, file or "")
    argv = list(_in_full(argv, stage, fields(stage_type(stage, tree.get(stage, {}))), kind))
    parsed = tyro.cli(
        _command(recipe, parts, tree, kind),
        args=argv,
        prog=f"mimicbench {command}",
        description=f"Settings of {stage} may be given without `{stage}.` before them.",
    )
    given = parsed.recipe
    recipe = replace(
        recipe, task=given.task, robot=given.robot, seed=given.seed, **{part: getattr(given, part) for part in parts}
    )
    check_recipe(recipe)
    parsed.options.context()
    return parsed.options, recipe


def _command(recipe: Recipe, parts: Sequence[str], tree: dict[str, Any], kind: type[Options]) -> Any:
    """What tyro is to fill in: the options, and a recipe with the parts given, each of the class that it chooses."""
    made: list[Any] = []
    for part in parts:
        chosen = stage_type(part, tree.get(part, {}))
        default = getattr(recipe, part) or chosen()
        made.append((part, chosen, field(default_factory=partial(_same, default))))
    shape = dataclasses.make_dataclass("Recipe", made, bases=(Common,), frozen=True)
    default = shape(task=recipe.task, robot=recipe.robot, seed=recipe.seed)
    unnamed = tyro.conf.arg(name="")
    return dataclasses.make_dataclass(
        "Command",
        [
            ("options", Annotated[kind, unnamed], field(default_factory=kind)),
            ("recipe", Annotated[shape, unnamed], field(default_factory=partial(_same, default))),
        ],
        frozen=True,
    )


def _same(value: Any) -> Any:
    return value


def _in_full(argv: Sequence[str], stage: str, settings: Sequence[Field], kind: type[Options]) -> Iterator[str]:
    """The arguments with the stage's name before its own settings where it was left out."""
    taken = {entry.name for cls in (kind, Common) for entry in fields(cls)} | set(PARTS) | {"help"}
    own = {entry.name for entry in settings}
    for word in argv:
        first = word[2:].partition("=")[0].partition(".")[0].replace("-", "_")
        short = word.startswith("--") and first not in taken and first in own
        yield f"--{stage}.{word[2:]}" if short else word


def _presets(argv: Sequence[str]) -> list[str]:
    """The words after `--preset`."""
    found: list[str] = []
    for i, word in enumerate(argv):
        if word == "--preset":
            for name in argv[i + 1 :]:
                if name.startswith("-"):
                    break
                found.append(name)
        elif word.startswith("--preset="):
            found.append(word.partition("=")[2])
    return found


def _nested(name: str, value: str) -> dict[str, Any]:
    part, _, rest = name.partition(".")
    return {part: {rest: value} if rest else value}


def _with_task(argv: Sequence[str], task: str) -> Iterator[str]:
    for i, word in enumerate(argv):
        if word == f"--task={ALL}":
            yield f"--task={task}"
        else:
            yield task if word == ALL and argv[i - 1] == "--task" else word
