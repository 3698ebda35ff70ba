"""A page of every method, sensor and kind of file: what the docstrings of its module say, and its settings."""

from collections.abc import Iterator, Sequence
from importlib import import_module

from doc_pages.settings import own_settings
from doc_pages.tasks import privileged
from doc_pages.words import defined_in, summary, table
from mimicbench.imitate.registry import LEARNERS
from mimicbench.references.importers.registry import FORMATS
from mimicbench.retarget.registry import METHODS
from mimicbench.sensors.observations import TERMS
from mimicbench.sensors.term import WORDS
from mimicbench.track.registry import TRACKERS

FOLDERS = {
    "retargeting": ("Ways to retarget", METHODS, "mimicbench retarget --method {}"),
    "trackers": ("Trackers", TRACKERS, "mimicbench track --track.tracker {}"),
    "learners": ("Learners", LEARNERS, "mimicbench imitate --learner {}"),
    "recordings": ("Formats of recordings", FORMATS, "mimicbench import FILE --format {}"),
}
"""Folder of pages -> their title, registry, and the command with an item's name."""
CHOSEN = {"trackers": ("track", "tracker"), "learners": ("imitate", "learner")}
"""Folder of pages -> the stage whose settings follow from an item, and the setting that names it."""
SENSORS = {
    "proprioception": (
        "sensors.proprioception",
        (
            *("gravity", "tilt", "root_ang_vel", "root_height", "joint_pos", "joint_offset", "joint_vel", "proprio"),
            *("body", "state", "last_action", "last_target", "time", "odometry"),
        ),
    ),
    "cameras": ("sensors.cameras", ("depth", "color", "labels")),
    "views": ("sensors.sight.views", ("views",)),
    "elevation-map": ("sensors.elevation", ("elevation", "gray", "target_elevation")),
    "height-map": ("sensors.heightmap", ("heightmap",)),
    "targets": ("sensors.targets", ("targets", "hands")),
}
"""Page -> the module that senses, and the observation terms that come of it; privileged ones are no sensor's."""
FILES = {
    "stages": ("core.stage", "a-stages-folder"),
    "objects": ("objects.shape", "objects-objectsidjson"),
    "motions": ("core.motion", "motions-referencesidnpz-retargetidnpz"),
    "demonstrations": ("imitate.lerobot", "demonstrations"),
    "checkpoints": ("core.checkpoint", "checkpoints-a-folder-with-two-files"),
    "episodes": ("evaluate.rows", "results-episodesparquet"),
}
"""Page -> the module that reads and writes such files, and the heading of formats.md that has their layout."""


def each_pages() -> Iterator[tuple[str, str]]:
    """Path and Markdown of every such page."""
    for folder, (_, registry, command) in FOLDERS.items():
        for name in registry:
            settings = own_settings(*CHOSEN[folder], name) if folder in CHOSEN else ""
            parts = [f"`{command.format(name)}`", f"## Settings of its own\n\n{settings}" if settings else ""]
            yield f"methods/{folder}/{name}.md", _page(name, defined_in(registry, name), parts)
    for name, (module, terms) in SENSORS.items():
        rows = ((f"`{term}`", WORDS[term], privileged(TERMS[term])) for term in terms)
        told = table(("term", "what", "who may use it"), rows)
        more = "Shapes: [observation terms](../observations.md). How it works: [senses](../../senses.md)."
        yield f"methods/sensors/{name}.md", _page(name.replace("-", " "), f"mimicbench.{module}", [told, more])
    for name, (module, heading) in FILES.items():
        more = f"What such files hold, field by field: [formats](../../formats.md#{heading})."
        yield f"methods/files/{name}.md", _page(name, f"mimicbench.{module}", [more])


def titles() -> dict[str, str]:
    """Folder of such pages -> its title in the navigation."""
    found = {f"methods/{folder}": title for folder, (title, *_) in FOLDERS.items()}
    return found | {"methods/sensors": "Sensors", "methods/files": "Files"}


def _page(title: str, module: str, parts: Sequence[str]) -> str:
    """A page: what the module is, the parts, and its interface, which mkdocstrings fills in."""
    said = summary(import_module(module).__doc__)
    return "\n\n".join([f"# {title}", said, *filter(None, parts), f"## In Python\n\n::: {module}"]) + "\n"
