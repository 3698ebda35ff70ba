"""Pages of every stage's settings, and of the presets."""

import inspect
import sys
from dataclasses import fields, is_dataclass
from typing import Any, get_type_hints

from doc_pages.words import field_docs, summary, table
from mimicbench.benchmark.presets import PRESETS
from mimicbench.benchmark.recipe import stage_type
from mimicbench.core.settings import Within
from mimicbench.imitate.registry import LEARNERS
from mimicbench.track.registry import TRACKERS

_ENDLESS = 1e6
"""Bounds from here on only keep out what is a mistake."""


def presets_page() -> str:
    """The names that `--preset` takes."""
    module = sys.modules[next(iter(PRESETS.values())).__module__]
    names = ", ".join(f"`{name}`" for name in PRESETS)
    said = inspect.cleandoc(module.__doc__ or "").split("\n\n", 1)[-1]
    return f"# Presets\n\n`--preset <name>`, several if you like: {names}.\n\n{said}\n\nMore: [recipes](../recipes.md)."


def settings_page(part: str) -> str:
    """Every setting of a stage; those that follow from a name in it, for each of the names."""
    kind = _shared(part)
    found = [f"# Settings: {part}", summary(kind.__doc__), settings_table(kind, part, seen=set())]
    for choice, registry in (("tracker", TRACKERS), ("learner", LEARNERS)):
        if hasattr(kind, choice) and hasattr(kind, "chosen"):
            for name in registry:
                own = own_settings(part, choice, name)
                found.append(f"## With `--{part}.{choice} {name}`\n\n{own or 'Nothing else.'}")
    found.append(f"`mimicbench {part} --help` says the same. How they are given: [recipes](../recipes.md).")
    return "\n\n".join(found)


def own_settings(part: str, choice: str, name: str) -> str:
    """Settings of a stage that only the item of that name has, such as a tracker; empty if there are none."""
    return settings_table(stage_type(part, {choice: name}), part, seen=set(dotted(_shared(part)())))


def _shared(part: str) -> type:
    """What all of a stage's items share: a stage whose settings follow from a name says so in `chosen`."""
    made = stage_type(part)
    return next((base for base in made.__mro__ if "chosen" in vars(base)), made)


def settings_table(kind: type, part: str, seen: set[str]) -> str:
    """A configuration's settings, but for those already seen with it."""
    rows = [
        (f"`--{part}.{option(name)}`", f"`{value(default)}`", bounds, words)
        for name, (default, bounds, words) in dotted(kind()).items()
        if name not in seen
    ]
    return table(("setting", "default", "within", "what"), rows) if rows else ""


def dotted(config: Any) -> dict[str, tuple[object, str, str]]:
    """Dotted name -> default, bounds and words of every setting in a configuration."""
    found = {}
    words, hints = field_docs(type(config)), get_type_hints(type(config), include_extras=True)
    for field in fields(config):
        default = getattr(config, field.name)
        if is_dataclass(default):
            found |= {f"{field.name}.{name}": entry for name, entry in dotted(default).items()}
        else:
            found[field.name] = default, within(hints[field.name]), words.get(field.name, "")
    return found


def within(hint: Any) -> str:
    """The bounds that an annotation carries, of itself or of one of its options."""
    every = [
        bound for option in (hint, *getattr(hint, "__args__", ())) for bound in getattr(option, "__metadata__", ())
    ]
    return ", ".join(
        f"{bound.low:g} to {bound.high:g}" if bound.high < _ENDLESS else f"{bound.low:g} or more"
        for bound in every
        if isinstance(bound, Within)
    )


def option(name: str) -> str:
    """A setting's name as on the command line."""
    return name.replace("_", "-")


def value(default: object) -> str:
    """A default as one would type it."""
    return " ".join(map(str, default)) or "none" if isinstance(default, tuple) else str(default) or "empty"
