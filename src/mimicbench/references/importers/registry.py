"""All formats of human motion that can be imported, by name, and which of them a file is in."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mimicbench.core.errors import BadFile, BadMotion, UnknownName
from mimicbench.core.registry import Registry

if TYPE_CHECKING:
    from pathlib import Path

    from mimicbench.references.importers.format import Format
    from mimicbench.references.importers.recording import Recording, Wishes

FORMATS: Registry[Format] = Registry(
    what="format",
    package="mimicbench.references.importers",
    attribute="FORMAT",
    kind="mimicbench.references.importers.format:Format",
    group="mimicbench.importers",
    first=("unihsi", "unihsi-states", "roam", "core4d", "amass", "bvh", "intermimic"),
)
AUTO = "auto"
"""In place of a format: the one that the file seems to be in."""


def import_recording(path: Path, form: str = AUTO, wishes: Wishes | None = None) -> Recording:
    """Read one recording in a format of FORMATS, or in the one that it seems to be in.

    Raises BadFile, BadMotion or UnknownName.
    """
    from mimicbench.references.importers.format import OPTIONAL
    from mimicbench.references.importers.recording import Wishes, WrongUnit

    if form != AUTO and form not in FORMATS:
        raise UnknownName("format", form, [AUTO, *FORMATS])
    found, wishes = FORMATS.get(detect_format(path) if form == AUTO else form), wishes or Wishes()
    for name, option in OPTIONAL.items():
        if getattr(wishes, name) is not None and name not in found.heeds:
            raise BadFile(f"{path} is in format {found.name}, to which {option} does not apply; leave that out")
    try:
        return found.read(path, wishes)
    except WrongUnit as wrong:
        ways = ["unit of length (--unit)"] * ("unit" in found.heeds) + [wrong.other] * bool(wrong.other)
        said = f"say the {' or the '.join(ways)}" if ways else f"files in format {found.name} are in meters: convert it"
        raise BadMotion(f"{wrong}; {said}") from None


def files_read(path: Path, wishes: Wishes | None = None) -> list[Path]:
    """The files that a recording may be read from: its own, what any format reads beside it, and its object's mesh."""
    beside = sorted({name for form in FORMATS.all() for name in form.beside})
    mesh = [] if wishes is None or wishes.mesh is None else [wishes.mesh]
    return [found for found in (path, *(path.parent / name for name in beside), *mesh) if found.is_file()]


def detect_format(path: Path) -> str:
    """The format of a file, by its first bytes, its ending, and the names in it. Raises BadFile."""
    from mimicbench.references.importers.format import glimpse

    file = glimpse(path)
    found = [form.name for form in FORMATS.all() if form.recognizes(file)]
    if len(found) == 1:
        return found[0]
    if found:
        raise BadFile(f"{path} could be in several formats ({', '.join(found)}); say in which (--format)")
    if file.content == "zip":
        raise BadFile(
            f"{path} is an archive of {', '.join(sorted(file.names))[:100] or 'nothing'}, no known motion; say "
            "its format (--format)"
        )
    raise BadFile(f"{path} is in none of the known formats ({', '.join(FORMATS)}); if it is, say in which (--format)")
