"""What a format of human motion is: a name, a reader, and by what its files can be told from others."""

import io
import re
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from mimicbench.core.errors import BadFile
from mimicbench.core.foreign.untrusted import NPY, read_bytes
from mimicbench.references.importers.recording import MAX_BYTES, Recording, Wishes

OPTIONAL = {"unit": "--unit", "scale": "--scale", "mesh": "--object-mesh"}
"""Wishes that not every format can fulfill, and what they are called on the command line."""
_BEGINNING = 400
"""Bytes of an array that hold its header."""


@dataclass(frozen=True)
class Glimpse:
    """What a file shows without being read."""

    content: str
    """By its first bytes: `npy`, `zip`, `bvh`, or nothing for any other."""
    suffix: str
    """The ending of its name, in lower case."""
    names: frozenset[str] = frozenset()
    """Of a `zip`, what is in it, without the ending `.npy`."""
    array: str = ""
    """Header of the one array of an `npy`, or of a `zip`'s array `arr_0`."""

    @property
    def pickled(self) -> bool:
        """Whether that array holds Python objects."""
        return re.search(r"'descr':\s*'\|?O", self.array) is not None

    @property
    def shape(self) -> tuple[int, ...]:
        """That array's shape; none if it has no header."""
        shape = re.search(r"'shape':\s*\(([\d, ]*)\)", self.array)
        return tuple(int(number) for number in re.findall(r"\d+", shape[1])) if shape else ()


@dataclass(frozen=True)
class Format:
    """One format."""

    name: str
    read: Callable[[Path, Wishes], Recording]
    """Raises BadFile or BadMotion."""
    recognizes: Callable[[Glimpse], bool]
    """Whether a file seems to be in it."""
    heeds: tuple[str, ...] = ()
    """Which of the wishes OPTIONAL it can fulfill; the others are refused."""
    beside: tuple[str, ...] = ()
    """Names of files in the same folder of which it is read as well, where they are there."""


def glimpse(path: Path) -> Glimpse:
    """A first look at a file. Raises BadFile."""
    raw, suffix = read_bytes(path, MAX_BYTES), path.suffix.lower()
    if raw.startswith(NPY):
        return Glimpse("npy", suffix, array=raw[:_BEGINNING].decode("latin1"))
    if not raw.startswith(b"PK"):
        return Glimpse("bvh" if re.match(rb"(\xef\xbb\xbf)?\s*HIERARCHY", raw) else "", suffix)
    try:
        with zipfile.ZipFile(io.BytesIO(raw)) as archive:
            names = frozenset(name.removesuffix(".npy") for name in archive.namelist())
            first = archive.open("arr_0.npy").read(_BEGINNING) if "arr_0" in names else b""
    except (zipfile.BadZipFile, OSError, ValueError, RuntimeError, NotImplementedError, EOFError, KeyError, zlib.error):
        raise BadFile(f"{path} cannot be read; it is a damaged archive: get it again") from None
    return Glimpse("zip", suffix, names, first.decode("latin1"))
