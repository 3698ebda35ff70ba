"""What there is of a kind, by name: tasks, robots, formats of motion, methods, and so on.

The items of a registry are the modules of one package and what other installed packages register as entry points. To
list their names imports none of them; to get one imports that one alone. Another item is one more module, or one more
package of somebody else's, and nothing else.
"""

import pkgutil
import re
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Generic, TypeVar, cast

from mimicbench.core.errors import MimicbenchError, UnknownName

T = TypeVar("T")


@dataclass(frozen=True)
class Registry(Generic[T]):
    """All items of a kind. Iterating over it gives their names.

    An item that stands in module `sit_chair` of the package is called `sit-chair`, and so is its `name`.
    """

    what: str
    """What an item is, for messages, such as `task`."""
    package: str
    """Package whose modules hold one item each; its other modules are of use to them."""
    attribute: str
    """What the item is called in its module, such as `TASK`; a module without it is no item."""
    kind: str
    """The items' class, as `module:class`; the module is only imported with an item."""
    group: str
    """Group of the entry points by which other packages register items."""
    first: tuple[str, ...] = ()
    """Names that are listed first, in this order; the others follow by the alphabet."""

    def names(self) -> tuple[str, ...]:
        """All names. Nothing is imported but the package itself."""
        found = {*_modules(self.package, self.attribute), *(point.name for point in _foreign(self.group))}
        return (*(name for name in self.first if name in found), *sorted(found - set(self.first)))

    def get(self, name: str) -> T:
        """The item of this name.

        Raises:
            UnknownName: There is none.
            MimicbenchError: Somebody else's package registers something that is no such item.
        """
        foreign = [point for point in _foreign(self.group) if point.name == name]
        own = name in _modules(self.package, self.attribute)
        if not own and not foreign:
            raise UnknownName(self.what, name, list(self.names()))
        if own + len(foreign) > 1:
            packages = ", ".join(_package(point) for point in foreign)
            raise MimicbenchError(f"{self.what} {name!r} is registered more than once ({packages}); uninstall one")
        if own:
            return self._checked(name, getattr(import_module(f"{self.package}.{_module(name)}"), self.attribute))
        try:
            item = foreign[0].load()
        except Exception as error:
            raise MimicbenchError(
                f"{self.what} {name!r} of the package {_package(foreign[0])} cannot be imported "
                f"({type(error).__name__}: {error}); mend or uninstall it"
            ) from error
        return self._checked(name, item)

    def all(self) -> tuple[T, ...]:
        """All items, in the order of their names."""
        return tuple(self.get(name) for name in self.names())

    def __iter__(self) -> Iterator[str]:
        return iter(self.names())

    def __contains__(self, name: object) -> bool:
        return name in self.names()

    def __len__(self) -> int:
        return len(self.names())

    def _checked(self, name: str, item: object) -> T:
        module, _, kind = self.kind.partition(":")
        if not isinstance(item, getattr(import_module(module), kind)):
            raise MimicbenchError(f"{self.what} {name!r} is {type(item).__name__}, not a {module}.{kind}; mend it")
        if getattr(item, "name", None) != name:
            raise MimicbenchError(
                f"{self.what} {name!r} calls itself {getattr(item, 'name', None)!r}; give it one name in both places"
            )
        return cast("T", item)


@lru_cache
def _modules(package: str, attribute: str) -> tuple[str, ...]:
    """Names of the items in a package: of its modules that define the attribute. They are read, not imported."""
    defines = re.compile(rf"^{attribute}(:.*)? = ", re.MULTILINE)
    spec = find_spec(package)
    paths = [] if spec is None else list(spec.submodule_search_locations or [])
    found = []
    for module in pkgutil.iter_modules(paths):
        source = find_spec(f"{package}.{module.name}")
        if source is not None and source.origin and defines.search(Path(source.origin).read_text(encoding="utf-8")):
            found.append(module.name.replace("_", "-"))
    return tuple(found)


@lru_cache
def _foreign(group: str) -> tuple[EntryPoint, ...]:
    """What other packages register."""
    return tuple(entry_points(group=group))


def _module(name: str) -> str:
    return name.replace("-", "_")


def _package(point: EntryPoint) -> str:
    """The distribution that an entry point is from."""
    return point.value.partition(".")[0].partition(":")[0] if point.dist is None else point.dist.name
