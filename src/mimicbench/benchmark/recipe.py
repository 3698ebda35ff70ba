"""A run as data: one configuration per stage, from defaults, a preset, a file and the command line."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mimicbench.benchmark.presets import Chosen, preset_tree
from mimicbench.core.errors import BadFile
from mimicbench.core.settings import BadSetting, Count, Seed, check, merge, read, to_tree
from mimicbench.robots.registry import DEFAULT_ROBOT
from mimicbench.tasks.registry import DEFAULT_TASK

if TYPE_CHECKING:  # each is imported with its part: who makes objects needs no tracker's settings
    from mimicbench.imitate.settings.demos import DemosConfig
    from mimicbench.imitate.spec import ImitateConfig
    from mimicbench.objects.make import ObjectsConfig
    from mimicbench.references.settings import ReferencesConfig
    from mimicbench.retarget.settings import RetargetConfig
    from mimicbench.track.settings import TrackConfig

MAX_BYTES = 1 << 20
"""Of a recipe's file."""


@dataclass(frozen=True)
class EvaluateConfig:
    """Who is judged, on what."""

    policy: tuple[str, ...] = ("best",)
    """Who: `tracker`, a learner's name or another checkpoint that comes with the package, the path of a checkpoint, a
    Python or an ONNX file, or `best`. What this workdir has learned comes before what the package brings."""
    episodes: Count = 400
    """Episodes of each policy: unseen objects, unseen starts."""
    tracked: Count = 256
    """Clips that the tracker is to follow."""
    split: str = "test"
    """Whose objects: `test` (unseen), `train` or `all`."""

    def __post_init__(self) -> None:
        if self.split not in ("test", "train", "all"):
            raise BadSetting(f"evaluate.split is {self.split!r}; give test, train or all")
        if not self.policy:
            raise BadSetting("evaluate.policy names nobody; name a policy, such as best")


@dataclass(frozen=True)
class Common:
    """What all stages share."""

    task: str = DEFAULT_TASK
    """Which task."""
    robot: str = DEFAULT_ROBOT
    """Which robot."""
    seed: Seed = 0
    """Same seed, same results, whatever the number of workers."""


@dataclass(frozen=True)
class Recipe(Common):
    """Everything that a run depends on. None stands for a stage's defaults."""

    objects: ObjectsConfig | None = None
    references: ReferencesConfig | None = None
    retarget: RetargetConfig | None = None
    track: TrackConfig | None = None
    demos: DemosConfig | None = None
    imitate: ImitateConfig | None = None
    evaluate: EvaluateConfig = field(default_factory=EvaluateConfig)

    def tree(self, *stages: str) -> dict[str, Any]:
        """This recipe as plain JSON values, resolved, with the parts of these stages."""
        parts = {name: to_tree(getattr(self, name) or stage_type(name)()) for name in stages}
        return {"task": self.task, "robot": self.robot, "seed": self.seed, **parts}


PARTS = ("objects", "references", "retarget", "track", "demos", "imitate", "evaluate")
"""The parts of a recipe, in the order of the stages."""
_TYPES = {
    "objects": "mimicbench.objects.make:ObjectsConfig",
    "references": "mimicbench.references.settings:ReferencesConfig",
    "retarget": "mimicbench.retarget.settings:RetargetConfig",
    "track": "mimicbench.track.settings:TrackConfig",
    "demos": "mimicbench.imitate.settings.demos:DemosConfig",
    "imitate": "mimicbench.imitate.spec:ImitateConfig",
    "evaluate": "mimicbench.benchmark.recipe:EvaluateConfig",
}


def stage_type(part: str, tree: Mapping[str, Any] | None = None) -> Any:
    """The class of a part's configuration.

    For a part whose class follows from a name in it, such as a learner's, `tree` gives that name.
    """
    module, _, name = _TYPES[part].partition(":")
    kind = getattr(import_module(module), name)
    return kind.chosen(tree or {}) if hasattr(kind, "chosen") else kind


def read_file(path: Path) -> dict[str, Any]:
    """The tree of values in a TOML file. Raises BadFile or BadSetting."""
    try:
        if path.stat().st_size > MAX_BYTES:
            raise BadFile(f"{path} is larger than {MAX_BYTES >> 20} MiB; it is no recipe")
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))  # some editors begin a file with a mark
    except FileNotFoundError:
        raise BadFile(f"{path} does not exist; --config takes a TOML file with a recipe") from None
    except (IsADirectoryError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise BadFile(f"{path} is no TOML file ({error})") from None


def recipe_tree(
    presets: Sequence[str], file: Path | None, names: Mapping[str, Any], implied: Sequence[str] = ()
) -> dict[str, Any]:
    """Presets, then a file, then what is said elsewhere, as one tree of values. Those that are implied come before the
    file's own presets, the others after them.

    A preset may differ from task to task and from learner to learner, so those are found first. Raises UnknownName
    for an unknown preset.
    """
    said = read_file(file) if file is not None else {}
    chosen = said.pop("preset", [])
    named = [chosen] if isinstance(chosen, str) else chosen
    if not isinstance(named, list) or not all(isinstance(name, str) for name in named):
        raise BadSetting(f"preset = {chosen!r} (in {file}) cannot be: give a preset's name, or a list of names")
    presets = [*implied, *named, *presets]
    heard = merge(said, names)
    imitate = heard.get("imitate")
    learner = imitate.get("learner") if isinstance(imitate, Mapping) else None
    chosen = Chosen(str(heard.get("task", Recipe.task)), None if learner is None else str(learner))
    return merge(*(preset_tree(name, chosen) for name in presets), said, names)


def read_recipe(tree: Mapping[str, Any], source: str = "") -> Recipe:
    """The recipe that a tree of values gives; parts that it leaves out have their defaults.

    Raises BadSetting: unknown names, wrong types, numbers out of bounds, or what cannot go together.
    """
    unknown = [name for name in tree if name not in {entry.name for entry in fields(Recipe)}]
    if unknown:
        known = ", ".join([*(["preset"] if source else []), *(entry.name for entry in fields(Recipe))])
        raise BadSetting(f"unknown setting {unknown[0]}{f' (in {source})' if source else ''}; known are: {known}")
    parts = {}
    for part in PARTS:
        if part in tree:
            if not isinstance(tree[part], Mapping):
                raise BadSetting(f"{part} is a table of settings, not {tree[part]!r}")
            parts[part] = read(stage_type(part, tree[part]), tree[part], f"{part}.", source)
    whole = read(Common, {name: value for name, value in tree.items() if name not in PARTS}, "", source)
    recipe = Recipe(whole.task, whole.robot, whole.seed, **parts)
    check_recipe(recipe)
    return recipe


def check_recipe(recipe: Recipe) -> None:
    """Raise UnknownName or BadSetting for what does not exist, is out of bounds, or cannot go together."""
    from mimicbench.benchmark.rules import RULES

    check(Common(recipe.task, recipe.robot, recipe.seed))
    for part in PARTS:
        config = getattr(recipe, part)
        if config is None:
            continue
        if not is_dataclass(config):
            given = type(config).__name__
            raise BadSetting(f"{part} is a {given}; give its configuration, or read a whole recipe from a table")
        check(config, f"{part}.")
    for rule in RULES:
        rule(recipe)
