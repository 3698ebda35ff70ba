"""From a command line to a recipe, in two passes.

The first looks for the names that settle which settings there are: presets, a file, the task, the tracker, the learner.
The second is tyro's, over the recipe as those have left it. Within a command, the settings of its own stage may be
given without the stage's name: `mimicbench track --samples 1e6` is `mimicbench track --track.samples 1e6`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import Field, dataclass, field, fields, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any

import tyro

from mimicbench.benchmark.recipe import PARTS, Common, Recipe, check_recipe, read_recipe, recipe_tree, stage_type
from mimicbench.comparisons.spec import CHOOSING, Comparison, Said, choice, recipe_of
from mimicbench.core.run import RunContext
from mimicbench.core.settings import BadSetting, differences, merge, to_tree

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


@dataclass(frozen=True)
class ComparisonCall:
    """A command line that asks for a comparison, read and checked."""

    options: Any
    """An Options, or what the command has in its place."""
    comparison: Comparison
    """With the variants that are wanted."""
    recipes: tuple[tuple[Recipe, ...], ...]
    """Of each task, one for each variant."""


def read_call(
    stage: str,
    argv: Sequence[str],
    kind: type[Options] = Options,
    presets: Sequence[str] = (),
    command: str | None = None,
    implied: Sequence[str] = (),
) -> Call:
    """Read the arguments of a stage's command.

    Args:
        stage: Its part of the recipe; settings of this and earlier parts are understood.
        argv: What follows the command.
        kind: The command's options.
        presets: Come before those that the user names by `--preset`, and after those of a file.
        command: Its name, if not the stage's.
        implied: Presets that nobody named, which come before all others.

    Raises:
        BadSetting: A recipe is not possible. Nothing has been done yet.
    """
    named = _Named(tuple(implied), tuple(presets))
    lines = [_read((stage,), part, kind, named, command or stage) for part in _by_task(argv)]
    return Call(lines[0].options, tuple(line.recipe for line in lines))


def read_compared(comparison: Comparison, argv: Sequence[str], kind: type[Any]) -> ComparisonCall:
    """Read what follows a comparison's name: settings that all its variants share.

    `kind` is an Options with the labels `only` that are wanted. Raises as `read_call` does.
    """
    command = f"compare {comparison.name}"
    stages = (comparison.of, PARTS[-1])
    # what may be said is what the first variant has; where another one has no such setting, its recipe says so
    common = merge(comparison.common, choice(comparison.variants[0].change))
    lines = [_read(stages, part, kind, _Named(), command, common) for part in _by_task(argv)]
    options = lines[0].options
    wanted = comparison.chosen(options.only)
    recipes = tuple(tuple(recipe_of(wanted, one, line.said) for one in wanted.variants) for line in lines)
    return ComparisonCall(options, wanted, recipes)


def _by_task(argv: Sequence[str]) -> Iterator[Sequence[str]]:
    """The arguments for each task that they mean. Raises BadSetting for a folder without a name."""
    if said(argv, "workdir") == "":
        raise BadSetting("--workdir is empty; give a folder, such as --workdir work")
    if said(argv, "task") != ALL:
        yield argv
        return
    from mimicbench.tasks.registry import TASKS

    yield from (list(_with_task(argv, name)) for name in TASKS)


def said(argv: Sequence[str], name: str) -> str | None:
    """The last value of `--name` on a command line; None if it is not there."""
    found = None
    for i, word in enumerate(argv):
        flag, equals, value = word.partition("=")
        if flag.startswith("--") and flag[2:].replace("_", "-") == name.replace("_", "-"):
            found = value if equals else next(iter(argv[i + 1 :]), None)
    return found


@dataclass(frozen=True)
class _Named:
    """Presets of a command's own."""

    implied: tuple[str, ...] = ()
    """Before those of a file."""
    asked: tuple[str, ...] = ()
    """After those of a file."""


@dataclass(frozen=True)
class _Line:
    options: Any
    recipe: Recipe
    said: Said


def _read(
    stages: tuple[str, ...],
    argv: Sequence[str],
    kind: type[Any],
    named: _Named,
    command: str,
    common: Mapping[str, Any] = MappingProxyType({}),
) -> _Line:
    """Of one task: settings up to the last of the stages, of which all have short names. `common` comes before presets,
    file and arguments.
    """
    parts = PARTS[: PARTS.index(stages[-1]) + 1]
    names: dict[str, Any] = {}
    for name in ("task", *CHOOSING):
        part, _, short = name.partition(".")
        value = said(argv, name) or (said(argv, short) if part in stages else None)
        if value is not None:
            names = merge(names, _nested(name, value))
    place = said(argv, "config")
    file = None if place is None else Path(place)
    presets = (*named.asked, *_presets(argv))
    # a preset may differ by who learns, which a comparison says where nobody else does
    tree = merge(common, recipe_tree(presets, file, merge(choice(common), names), named.implied))
    before = read_recipe(tree, place or "")
    before = replace(
        before, **{part: getattr(before, part) or stage_type(part, tree.get(part, {}))() for part in parts}
    )
    for stage in reversed(stages):
        argv = list(_in_full(argv, stage, fields(stage_type(stage, tree.get(stage, {}))), kind))
    parsed = tyro.cli(
        _command(before, parts, kind),
        args=argv,
        prog=f"mimicbench {command}",
        description=_about(stages, parts),
    )
    given = parsed.recipe
    recipe = replace(before, **{name: getattr(given, name) for name in ("task", "robot", "seed", *parts)})
    check_recipe(recipe)
    parsed.options.context()
    # what is said counts, also where it is what would have been, for others would have been given something else
    given = merge(names, differences(recipe, before), _spoken(to_tree(recipe), _flags(argv)))
    return _Line(parsed.options, recipe, Said(presets, file, given))


def _about(stages: Sequence[str], parts: Sequence[str]) -> str:
    """What stands above the options: how they may be shortened, and what is to be had by name."""
    from mimicbench.benchmark.presets import PRESETS
    from mimicbench.imitate.registry import LEARNERS
    from mimicbench.retarget.registry import METHODS
    from mimicbench.robots.registry import ROBOTS
    from mimicbench.tasks.registry import TASKS
    from mimicbench.track.registry import TRACKERS

    named = {"task": TASKS, "robot": ROBOTS, "preset": PRESETS}
    of_parts = {"retarget.method": METHODS, "track.tracker": TRACKERS, "imitate.learner": LEARNERS}
    named |= {name: names for name, names in of_parts.items() if name.partition(".")[0] in parts}
    return "\n".join(
        [
            *(f"Settings of {stage} may be given without `{stage}.` before them." for stage in stages),
            *(f"--{name}: {', '.join(names)}" for name, names in named.items()),
        ]
    )


def _flags(argv: Sequence[str]) -> set[str]:
    """The settings that are named on a command line, in full, as `imitate.train.steps`."""
    return {word[2:].partition("=")[0].replace("-", "_") for word in argv if word.startswith("--")}


def _spoken(tree: Mapping[str, Any], flags: set[str], where: str = "") -> dict[str, Any]:
    """Of a tree of values: those whose names are among the flags, or `no_` and their names, where they are switches."""
    found: dict[str, Any] = {}
    for name, value in tree.items():
        if isinstance(value, Mapping):
            found |= {name: inner} if (inner := _spoken(value, flags, f"{where}{name}.")) else {}
        elif {f"{where}{name}", f"{where}no_{name}"} & flags:
            found[name] = value
    return found


def _command(recipe: Recipe, parts: Sequence[str], kind: type[Any]) -> Any:
    """What tyro is to fill in: the options, and a recipe with the parts given, each of the class that it has."""
    made: list[Any] = []
    for part in parts:
        default = getattr(recipe, part)
        made.append((part, type(default), field(default_factory=partial(_same, default))))
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
        short = word.startswith("--") and first not in taken and {first, first.removeprefix("no_")} & own
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
