"""What a comparison is: recipes that have everything in common but one thing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from mimicbench.benchmark.recipe import Recipe, read_recipe, recipe_tree, stage_type
from mimicbench.core.errors import guess
from mimicbench.core.settings import BadSetting, Share, merge
from mimicbench.references.settings import MADE

Tree = Mapping[str, Any]
CHOOSING = ("imitate.learner", "track.tracker")
"""Settings on which depends what other settings there are."""


@dataclass(frozen=True)
class Variant:
    """One of the recipes."""

    label: str
    """What is different in it, in a few words: the name of a row."""
    change: Tree = field(default_factory=dict)
    """Settings on top of those that all share, as in a recipe's file."""
    share: Share = 1.0
    """Part of the human clips that it learns from."""
    counterpart: str = ""
    """The row of the paper's table that it is; empty if it is none."""


@dataclass(frozen=True)
class Comparison:
    """A list of recipes, whose trackers or policies are learned and judged on the same episodes.

    Where they differ in how clips are retargeted, it is on as many clips of the same people: each way loses others, so
    that tables also have the rates of those clips that all variants have.
    """

    name: str
    what: str
    """What it finds out, in one line."""
    of: Literal["track", "imitate"]
    """The stage whose result is judged."""
    variants: tuple[Variant, ...]
    common: Tree = field(default_factory=dict)
    """Settings that all share. Presets, a file and the command line come on top."""
    learns: bool = True
    """Whether each variant learns; else who is there, such as the shipped tracker, is judged in each."""
    paper: tuple[str, ...] = ()
    """LaTeX labels of the paper's tables that its rows are of, the first that has one."""

    def __post_init__(self) -> None:
        labels = [variant.label for variant in self.variants]
        if len(set(labels)) < len(labels):
            raise BadSetting(f"comparison {self.name!r} has two variants of one label; give each its own")

    def chosen(self, labels: tuple[str, ...]) -> Comparison:
        """The same with these variants alone, each once; with all of them if none is named. Raises BadSetting."""
        known = {variant.label: variant for variant in self.variants}
        for label in labels:
            if label not in known:
                told = f"{self.name} has no variant {label!r}; there are: {', '.join(known)}"
                raise BadSetting(told + guess(label, known))
        return replace(self, variants=tuple(known[label] for label in dict.fromkeys(labels))) if labels else self


@dataclass(frozen=True)
class Said:
    """What whoever asks for a comparison wants besides."""

    presets: tuple[str, ...] = ()
    file: Path | None = None
    """A TOML file with a recipe."""
    settings: Tree = field(default_factory=dict)
    """On top of both."""


def recipe_of(comparison: Comparison, variant: Variant, said: Said) -> Recipe:
    """The recipe of a variant.

    A preset may say something else for another tracker or learner, so it is asked for each variant anew.

    Raises BadSetting or UnknownName for what does not exist, or cannot go together in this variant.
    """
    settings = merge(choice(comparison.common), said.settings, variant.change)
    tree = merge(comparison.common, recipe_tree(said.presets, said.file, settings))
    try:
        recipe = read_recipe(tree)
    except BadSetting as error:
        raise BadSetting(f"{comparison.name}, {variant.label}: {error}") from None
    return recipe if variant.share == 1.0 else _with_share(recipe, variant.share, f"{comparison.name}, {variant.label}")


def _with_share(recipe: Recipe, share: float, where: str) -> Recipe:
    """The same with that share of what demonstrations begin from: human clips, or starts drawn by rule. Raises
    BadSetting.
    """
    from mimicbench.imitate.settings.demos import CLIPS

    demos, references = (getattr(recipe, name) or stage_type(name)() for name in ("demos", "references"))
    if demos.starts != CLIPS:
        return replace(recipe, demos=replace(demos, clips=max(1, round(share * demos.clips))))
    if references.source != MADE:
        raise BadSetting(
            f"{where}: the set {references.source!r} is used whole; compare shares of people who are made "
            "(references.source made)"
        )
    fewer = {
        "references": replace(references, count=max(1, round(share * references.count))),
        "demos": replace(demos, clips=max(1, round(share * demos.clips))),  # or they would be as many in the end
    }
    return replace(recipe, **fewer)


def choice(tree: Tree) -> dict[str, Any]:
    """Of a tree of values: the names on which depends what other settings there are, and what a preset says."""
    chosen: dict[str, Any] = {}
    for name in CHOOSING:
        part, _, rest = name.partition(".")
        if rest in tree.get(part, {}):
            chosen[part] = {rest: tree[part][rest]}
    return chosen
