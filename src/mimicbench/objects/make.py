"""Stage `objects`: make a set of objects of one family and keep them on disk."""

from dataclasses import asdict, dataclass
from pathlib import Path

from mimicbench.core.stage import Stage, open_stage
from mimicbench.objects.registry import FAMILIES
from mimicbench.objects.shape import SceneObject, load_object, save_object


@dataclass(frozen=True)
class ObjectsConfig:
    """Which objects to make."""

    count: int = 400
    """How many; about a quarter of them belong to the test split."""


def make_objects(folder: Path, task: str, family: str, config: ObjectsConfig, seed: int) -> Stage:
    """Make the objects, one `<id>.json` each, and the header. Does nothing if they are there."""
    stage = open_stage(folder, "objects", task, seed, asdict(config))
    if stage.complete:
        return stage
    made = [FAMILIES.get(family).make(index, seed) for index in range(config.count)]
    for obj in made:
        save_object(folder, obj)
    return stage.finish(count=len(made), test=sum(obj.split == "test" for obj in made))


def read_objects(folder: Path) -> dict[str, SceneObject]:
    """All objects of a finished stage by id, in order of their ids."""
    return {
        path.stem: load_object(folder, path.stem)
        for path in sorted(folder.glob("*.json"))
        if path.name != "header.json"
    }
