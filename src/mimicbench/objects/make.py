"""Stage `objects`: make a set of objects of one family and keep them on disk."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mimicbench.core.errors import BadObject
from mimicbench.core.settings import Count
from mimicbench.core.stage import HEADER, Stage
from mimicbench.objects.registry import FAMILIES
from mimicbench.objects.shape import SceneObject, load_object, save_object

MADE = "made"


@dataclass(frozen=True)
class ObjectsConfig:
    """Which objects there are."""

    source: str = MADE
    """`made`, or the name of a set that `mimicbench objects import` made of meshes."""
    count: Count = 400
    """How many to make; about a quarter of them belong to the test split."""


def make_objects(stage: Stage, family: str, config: ObjectsConfig) -> Stage:
    """Make the objects, one `<id>.json` each."""
    made = [FAMILIES.get(family).make(index, stage.header["seed"]) for index in range(config.count)]
    for obj in made:
        if not (stage.folder / f"{obj.id}.json").exists():
            save_object(stage.folder, obj)
    return stage.finish(count=len(made), test=sum(obj.split == "test" for obj in made))


def object_ids(folder: Path) -> list[str]:
    """Ids of all objects of a stage, in order."""
    return sorted(path.stem for path in folder.glob("*.json") if path.name != HEADER)


def read_objects(folder: Path, ids: Sequence[str] | None = None) -> dict[str, SceneObject]:
    """Objects of a finished stage by id, in order of their ids: those named, or all."""
    return {name: load_object(folder, name) for name in (object_ids(folder) if ids is None else sorted(ids))}


def find_object(name: str) -> SceneObject:
    """The object of a file `<id>.json`, or one made again from its id `<family>-<seed>-<index>`.

    Raises:
        UnknownName: There is no such family.
        BadObject: The name is neither; or the file holds no object.
        BadFile: There is no such file.
    """
    if name.endswith(".json"):
        return load_object(Path(name).parent, Path(name).stem)
    family, *numbers = name.rsplit("-", 2)
    if len(numbers) != 2 or not all(number.isascii() and number.isdecimal() for number in numbers):
        raise BadObject(
            f"{name!r} is no object's id such as chair-0-00042; give the object's .json file if it was imported"
        )
    made = FAMILIES.get(family).make(int(numbers[1]), int(numbers[0]))
    if made.id != name:
        raise BadObject(f"there is no object {name!r}; the one of those numbers is {made.id!r}")
    return made
