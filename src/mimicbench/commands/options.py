"""Options that commands share which are not of a recipe."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, ParamSpec, TypeVar, get_type_hints

import tyro

from mimicbench.core.run import RunContext
from mimicbench.core.settings import BadSetting, Within, check_value
from mimicbench.tasks.registry import TASKS

if TYPE_CHECKING:
    from mimicbench.benchmark.recipe import Recipe

P = ParamSpec("P")
R = TypeVar("R")

Task = Annotated[str, tyro.conf.arg(help=f"which task: {', '.join(TASKS)}")]
Tasks = Annotated[str, tyro.conf.arg(name="task", help=f"which task: {', '.join(TASKS)}, or all")]
Workdir = Annotated[Path, tyro.conf.arg(help="where all artefacts go, in <workdir>/<task>/<stage>")]
Seed = Annotated[
    int, Within(0, 2**63 - 1), tyro.conf.arg(help="same seed, same results, whatever the number of workers")
]
Workers = Annotated[int, Within(0, 4096), tyro.conf.arg(help="threads or processes; 0 for all processors")]
Device = Annotated[
    str,
    tyro.conf.arg(
        help="what computes the physics: cpu, cuda, cuda:1 (MuJoCo Warp on a GPU), or warp-cpu (slow, for tests)"
    ),
]
Json = Annotated[
    bool, tyro.conf.arg(name="json", help="print the summary as one line of JSON and nothing else on stdout")
]
Format = Literal["terminal", "markdown", "latex", "csv"]
"""How tables are printed."""
Form = Annotated[Format, tyro.conf.arg(name="format", help="how to print them")]
Source = Annotated[str, tyro.conf.arg(help="`made`, or the name of an imported or augmented set")]
SetName = Annotated[str, tyro.conf.arg(help="name of the set: <workdir>/<task>/objects/<name>, and so on")]
Axis = Literal["x+", "x-", "y+", "y-", "z+", "z-"]
WORK = Path("work")


@dataclass(frozen=True)
class Making:
    """Options of commands that make something without a recipe of their own."""

    workdir: Workdir = WORK
    seed: Seed = 0
    workers: Workers = 0
    as_json: Json = False

    def context(self) -> RunContext:
        """How stages are to run. Raises MimicbenchError."""
        return RunContext(self.workers, quiet=self.as_json)


How = Annotated[Making, tyro.conf.arg(name="")]
"""Its options have no prefix."""
AS_USUAL = Making()


def checked(function: Callable[P, R]) -> Callable[P, R]:
    """The function, which raises BadSetting for numbers that are not finite, or out of the bounds in its annotations,
    and for a set's name that is no name.
    """
    hints = get_type_hints(function, include_extras=True)

    @wraps(function)
    def inside(*args: P.args, **values: P.kwargs) -> R:
        for name, value in values.items():
            _check_option(name, value, hints[name])
        name: Any = values.get("to")
        if isinstance(name, str) and (
            not name.strip() or name == "made" or name.startswith(".") or not name.isprintable()
        ):
            raise BadSetting(f"--to is {name!r}; give the set a name, such as `recorded`")
        if isinstance(name, str) and "/" in name:
            raise BadSetting(f"--to is {name!r}; give a name, not a path")
        return function(*args, **values)

    return inside


def _check_option(name: str, value: Any, hint: Any) -> None:
    if is_dataclass(value):
        hints = get_type_hints(type(value), include_extras=True)
        for one in fields(value):
            _check_option(one.name, getattr(value, one.name), hints[one.name])
    else:
        option = f"--{name.replace('_', '-')}"
        check_value(option, value, hint)
        if value == () and any(isinstance(bounds, Within) for bounds in getattr(hint, "__metadata__", ())):
            raise BadSetting(f"{option} has no numbers; give at least one")


def check_png(option: str, path: Path) -> None:
    """Raises BadSetting if what is to become a picture is called something else."""
    if path.suffix.lower() != ".png":
        raise BadSetting(f"{option} is {str(path)!r}; give a name that ends in .png")


def recipes(
    task: str, seed: int = 0, source: str = "made", count: int | None = None, workdir: Path | None = None
) -> list[Recipe]:
    """A recipe for each task that the user means, with so many human clips; `all` are all tasks, or those that have
    the set `source` in a workdir, if any has.
    """
    from mimicbench.benchmark.keys import is_complete
    from mimicbench.benchmark.recipe import Recipe
    from mimicbench.references.settings import MADE, ReferencesConfig

    config = ReferencesConfig(source) if count is None else ReferencesConfig(source, count)
    named = [] if workdir is None or source == MADE else [workdir / name / "references" / source for name in TASKS]
    having = [place.parts[-3] for place in named if is_complete(place)]
    names = (having or TASKS) if task == "all" else [TASKS.get(task).name]
    return [Recipe(name, seed=seed, references=config) for name in names]
